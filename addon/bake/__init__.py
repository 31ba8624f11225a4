"""One bake from the scene to its levels, the same for the operator and the command line."""
