# Levels that also bear a second look, at the cost of more triangles and texels.
import bpy

settings = bpy.context.scene.leafcloud
kept = ("rna_type", "name", "leaves", "trees", "engine", "compress", "files", "directory", "seed")
for each in settings.bl_rna.properties:
    if each.identifier not in kept:
        settings.property_unset(each.identifier)
settings.quality = 0.75
