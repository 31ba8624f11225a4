"""A forest in a GLB file: the chain of a tree with its level 0 in many places, by `EXT_mesh_gpu_instancing`.

A reader that knows the extension draws all trees in one call, with their leaves. Our packages draw each tree by the
level for its distance: they take the places from the extension, and the levels from `MSFT_lod`. A reader without the
extension shows one tree.

A place moves, turns and scales a tree from the origin. The extension places instances within the node N of level 0,
which turns and scales as A does, and moves. So the transform of the instance at the place P is N⁻¹ · P · A. It has no
shear if A scales all axes alike.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..errors import ExportError
from .glb_file import Glb
from .glb_nodes import node_matrix

INSTANCING = "EXT_mesh_gpu_instancing"

_Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From Blender's axes to those of glTF."""
_SHEAR = 1e-4
"""Largest difference of scales along the axes, relative to their mean, that counts as one scale."""


def write_forest(tree_file: Path, forest_file: Path, places: NDArray[np.float64]) -> None:
    """Write the trees of the chain `tree_file` (NAME.glb) at `places`, (n, 4, 4) in Blender's axes, n ≥ 1.

    A place scales all axes alike.

    Raises `ExportError` if the chain cannot be read, is none, or has another scale along each axis.
    """
    if not tree_file.is_file():
        raise ExportError(
            f"{tree_file.name} is not in {tree_file.parent}: choose the folder with the files of all trees of the "
            f"forest, or export the tree there"
        )
    try:
        glb = Glb.read(tree_file)
        node = next(each for each in glb.document["nodes"] if "level" in _numbers(each))
    except (OSError, ValueError, LookupError, TypeError, AttributeError, StopIteration) as error:
        raise ExportError(f"{tree_file} is no file of a baked tree: export the tree for the engine again") from error
    add_instances(glb, node, places)
    glb.write(forest_file)


def _numbers(node: dict[str, Any]) -> dict[str, Any]:
    numbers: dict[str, Any] = node.get("extras", {}).get("leafcloud", {})
    return numbers


def add_instances(glb: Glb, node: dict[str, Any], places: NDArray[np.float64]) -> None:
    """Add the places, see `write_forest`, to a node of the file."""
    own = node_matrix(node)
    _check_scale(f"{node['name']} is", own, "apply the scale of the tree before the bake")
    for place in places:
        _check_scale("a place of the forest is", place, "apply the scale of its object")
    turned = own.copy()
    turned[:3, 3] = 0.0
    parts = [_parts(row) for row in np.linalg.inv(own) @ (_Y_UP @ places @ _Y_UP.T) @ turned]
    attributes = {
        "TRANSLATION": [part[0] for part in parts],
        "ROTATION": [part[1] for part in parts],
        "SCALE": [(part[2],) * 3 for part in parts],
    }
    accessors = {name: glb.append_accessor(np.array(rows)) for name, rows in attributes.items()}
    for accessor in accessors.values():
        # No vertex buffer: readers copy the numbers.
        del glb.document["bufferViews"][glb.document["accessors"][accessor]["bufferView"]]["target"]
    node.setdefault("extensions", {})[INSTANCING] = {"attributes": accessors}
    glb.use_extension(INSTANCING)


def _check_scale(owner: str, transform: NDArray[np.float64], remedy: str) -> None:
    """Raise `ExportError` unless the transform has one scale, other than 0, along all axes."""
    axes = transform[:3, :3]
    square = axes.T @ axes
    if not np.abs(square - np.eye(3) * square[0, 0]).max() <= _SHEAR * square[0, 0] or square[0, 0] == 0.0:
        scales = ", ".join(f"{each:.3g}" for each in Matrix(axes.tolist()).to_4x4().to_scale())
        raise ExportError(f"{owner} scaled by {scales}: a forest needs one scale along all axes; {remedy}")


def _parts(transform: NDArray[np.float64]) -> tuple[list[float], tuple[float, float, float, float], float]:
    """Return translation, rotation (x, y, z, w) and scale of a transform with one scale."""
    axes = transform[:3, :3]
    scale = float(np.cbrt(np.linalg.det(axes)))
    w, x, y, z = Matrix((axes / scale).tolist()).to_quaternion()
    return transform[:3, 3].tolist(), (x, y, z, w), scale
