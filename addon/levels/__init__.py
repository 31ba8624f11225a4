"""Creation of Blender data from the core's arrays: meshes, morphs, materials, node groups and levels."""
