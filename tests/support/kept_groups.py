"""Node groups of the add-on that the tests of a process build more than once: later scenes get them from a file.

Building one takes a tenth of a second and more, half of the time of the tests of nodes. Groups that hold others are
built each time: a file would bring a second copy of those.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import patch

import bpy
import pytest
from kept_chains import is_fresh

from addon.nodes import forest, laws, lod, octahedral, points, scene, sides, wind

_folder = tempfile.TemporaryDirectory(prefix="leafcloud-groups-")
_files: dict[tuple[object, ...], Path] = {}
"""The file of each group, by its name, key, layout and builders: a test may replace a builder."""
_build = laws.group_of_layout


def _group_of_layout(
    name: str, key: str, layout: int, *steps: Callable[[bpy.types.NodeTree], None], kind: str = "GeometryNodeTree"
) -> bpy.types.NodeTree:
    """Return the group that `laws.group_of_layout` would return."""
    if is_fresh():
        return _build(name, key, layout, *steps, kind=kind)
    known = any(tree.library is None and tree.get(key) == layout for tree in bpy.data.node_groups)
    file = _files.get((name, key, layout, *steps))
    if known or file is None:
        tree = _build(name, key, layout, *steps, kind=kind)
        if not known and not any(node.bl_idname.endswith("NodeGroup") for node in tree.nodes):
            file = _files[name, key, layout, *steps] = Path(_folder.name) / f"{len(_files)}.blend"
            bpy.data.libraries.write(str(file), {tree})
        return tree
    before = set(bpy.data.libraries)
    with bpy.data.libraries.load(str(file)) as (there, wanted):
        wanted.node_groups = there.node_groups
    for library in set(bpy.data.libraries) - before:
        bpy.data.libraries.remove(library)
    [tree] = wanted.node_groups
    return tree


@pytest.fixture(autouse=True, scope="session")
def _kept_groups() -> Iterator[None]:
    """Keep the groups of all modules of the add-on."""
    users = (forest, laws, lod, octahedral, points, scene, sides, wind)
    patches = [patch.object(module, "group_of_layout", _group_of_layout) for module in users]
    for each in patches:
        each.start()
    yield
    for each in patches:
        each.stop()
