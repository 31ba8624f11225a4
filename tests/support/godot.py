"""Meshes of a GLB file as Godot 4.6 imports them, by the rules of its `GLTFDocument` and with nothing of the add-on.

- Of the nodes only those of the default scene are made.
- A surface has the vertices that its indices use, in their order; the second and third corner of each triangle change
  places. Morph targets become blend shapes.
- TEXCOORD_0 is UV, TEXCOORD_1 is UV2. CUSTOM0 to CUSTOM2 are made of the pairs TEXCOORD_2 and _3, _4 and _5, _6 and
  _7, unchanged. The first pair that is missing ends that. The first set alone gives two numbers, else there are four,
  with 0 for a first set that is missing.
- Other attributes, such as those whose names begin with an underscore, are dropped.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from glb import Primitive, read_scene
from numpy.typing import NDArray

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Surface:
    """`vertices` (v, 3); `indices` (t, 3); `customs`, up to three, (v, 2) or (v, 4); `blend_shapes` (v, 3) places."""

    vertices: Floats
    indices: NDArray[np.int64]
    uv: Floats | None
    uv2: Floats | None
    customs: list[Floats]
    blend_shapes: list[Floats]


def read_as_godot(path: Path) -> dict[str, list[Surface]]:
    """The surfaces of each node that is made, by its name."""
    return {name: [_surface(each) for each in node.primitives] for name, node in read_scene(path).items()}


def _surface(primitive: Primitive) -> Surface:
    used, indices = np.unique(primitive.indices[:, [0, 2, 1]], return_inverse=True)
    kept = {
        name: values[used].astype(np.float32)
        for name, values in primitive.attributes.items()
        if name in ("POSITION", "NORMAL", "TANGENT") or name.startswith("TEXCOORD_")
    }
    return Surface(
        vertices=kept["POSITION"],
        indices=indices.reshape(-1, 3),
        uv=kept.get("TEXCOORD_0"),
        uv2=kept.get("TEXCOORD_1"),
        customs=_customs(kept),
        blend_shapes=[kept["POSITION"] + target["POSITION"][used] for target in primitive.targets],
    )


def _customs(kept: dict[str, Floats]) -> list[Floats]:
    customs = []
    for first in (2, 4, 6):
        pair = [kept.get(f"TEXCOORD_{number}") for number in (first, first + 1)]
        if pair[0] is None and pair[1] is None:
            break
        nothing = np.zeros((len(kept["POSITION"]), 2), np.float32)
        one, other = (nothing if each is None else each for each in pair)
        customs.append(one if pair[1] is None else np.hstack([one, other]))
    return customs
