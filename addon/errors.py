"""Errors that end a bake."""

from __future__ import annotations


class SceneError(Exception):
    """Scene or file content that cannot be baked. The message is one line: the thing, its value, the remedy."""


class ExportError(OSError):
    """Blender could not write a file. The message is one line: the file and the reason."""
