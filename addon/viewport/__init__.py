"""Preview of baked levels from a 3D view: morphs, pruning and fades by shaders/leafcloud.glsl."""
