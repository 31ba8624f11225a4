"""The effects, one file each: rule and reasons, cost, options of the core, additions to levels and files.

A file defines a subclass of `plan.effect.Effect` and an instance `EFFECT`; the file's name is the effect's name.
`plan.registry` finds the files, so adding an effect adds a file. Rules and costs need no Blender: methods that build
or export import Blender's modules themselves.
"""
