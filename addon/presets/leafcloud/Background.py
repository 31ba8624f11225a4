# Cheap levels for plants in the distance: differences are seen if one looks for them.
import bpy

settings = bpy.context.scene.leafcloud
for name in ("epsilon", "form", "pixels", "triangles", "texture_size", "texture_height", "samples", "effort"):
    settings.property_unset(name)
settings.quality = 0.25
