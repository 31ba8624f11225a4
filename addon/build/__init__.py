"""From the core's arrays to Blender's objects: meshes, morphs, materials, the node group, the levels."""
