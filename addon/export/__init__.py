"""Output files of a bake: glTF, `.blend`, preview and report. A folder gets all of them or none."""
