# The default: nobody notices the change from level to level.
import bpy

settings = bpy.context.scene.leafcloud
kept = ("rna_type", "name", "leaves", "trees", "engine", "compress", "files", "directory", "seed")
for each in settings.bl_rna.properties:
    if each.identifier not in kept:
        settings.property_unset(each.identifier)
settings.quality = 0.5
