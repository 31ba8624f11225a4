"""Nodes of GLB files."""

from __future__ import annotations

from typing import Any

import numpy as np
from mathutils import Matrix, Quaternion, Vector
from numpy.typing import NDArray


def node_matrix(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return the transform (4, 4) of a node of the document, relative to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    place = Vector(node.get("translation", (0.0, 0.0, 0.0)))
    scale = Vector(node.get("scale", (1.0, 1.0, 1.0)))
    return np.array(Matrix.LocRotScale(place, Quaternion((w, x, y, z)), scale), np.float64)
