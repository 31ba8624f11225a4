"""Warnings of parts of a bake that the engine's own package or script does not read."""

from __future__ import annotations

from collections.abc import Sequence

from .decision import Decision, is_on

UNDRAWN = {"bevy": ("wind", "pruning")}
"""Effects that the package for an engine does not draw."""

ONE_TREE = ("unity", "unreal")
"""The scripts for these engines read files with one tree only."""


def undrawn_warnings(engine: str, effects: Sequence[Decision]) -> list[str]:
    """Return a warning for each effect of the bake that the engine's package does not draw."""
    names = [name for name in UNDRAWN.get(engine, ()) if is_on(effects, name)]
    return [
        f"the package for {engine.title()} does not draw the effect {name}, which makes the files larger: set "
        f"`effects=-{name}`"
        for name in names
    ]


def several_trees_warnings(engine: str, trees: int) -> list[str]:
    """Return a warning if the engine's script cannot read a file with so many trees."""
    if trees == 1 or engine not in ONE_TREE:
        return []
    return [
        f"the script for {engine.title()} reads one tree a file, and refuses these {trees}: bake each one by itself"
    ]
