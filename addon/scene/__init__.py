"""From Blender to plain values: `load` opens a file, `extract` reads the tree's geometry, `describe` its materials."""

from __future__ import annotations


class SceneError(Exception):
    """What is in the scene or in the file cannot be baked. One line: the thing, its value, and what to do."""
