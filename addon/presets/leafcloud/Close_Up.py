# Levels that also bear a second look, at the cost of more triangles and texels.
import bpy

settings = bpy.context.scene.leafcloud
for name in ("epsilon", "form", "pixels", "triangles", "texture_size", "texture_height", "samples", "effort"):
    settings.property_unset(name)
settings.quality = 0.75
