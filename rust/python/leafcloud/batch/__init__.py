"""Bakes of many trees, each in a process of its own: `leafcloud-batch TREES … --out DIR`.

`trees` finds the files and tells whether a tree is baked already, `process` runs one bake within limits, `run` runs
all of them, `sheet` writes the contact sheet, `command` is the command line.
"""
