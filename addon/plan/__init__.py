"""Decisions made before a bake starts, as functions of plain values. Nothing here imports `bpy`."""
