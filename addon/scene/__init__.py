"""Readers from Blender data to plain values: `load` opens files, `extract` reads geometry, `describe` materials."""

from __future__ import annotations


class SceneError(Exception):
    """Scene or file content that cannot be baked. The message is one line: the thing, its value, the remedy."""
