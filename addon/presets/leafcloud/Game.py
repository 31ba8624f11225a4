# The default: nobody notices the change from level to level.
import bpy

settings = bpy.context.scene.leafcloud
for name in ("epsilon", "form", "pixels", "triangles", "texture_size", "texture_height", "samples", "effort"):
    settings.property_unset(name)
settings.quality = 0.5
