# Cheap levels for plants in the distance: differences are seen if one looks for them.
import bpy

settings = bpy.context.scene.leafcloud
kept = ("rna_type", "name", "leaves", "trees", "engine", "compress", "files", "directory", "seed")
for each in settings.bl_rna.properties:
    if each.identifier not in kept:
        settings.property_unset(each.identifier)
settings.quality = 0.25
