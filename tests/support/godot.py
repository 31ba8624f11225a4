"""Reader of GLB files that follows the rules of Godot 4.6 (`GLTFDocument`). It shares no code with the add-on.

- Godot makes only the nodes of the default scene.
- A surface has only the vertices that its indices use, in their order. The second and third corner of each triangle
  are swapped. Morph targets become blend shapes.
- TEXCOORD_0 is UV, TEXCOORD_1 is UV2. Each of CUSTOM0 to CUSTOM2 is one pair of TEXCOORD_2 to TEXCOORD_7, unchanged.
  The first missing pair ends the list. A pair without its second set gives two numbers. Every other pair gives four,
  with 0 for a missing first set.
- Godot drops other attributes, such as those with names that start with an underscore.
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
    """A surface: `vertices` (v, 3), `indices` (t, 3), up to three `customs` (v, 2) or (v, 4), `blend_shapes` (v, 3)."""

    vertices: Floats
    indices: NDArray[np.int64]
    uv: Floats | None
    uv2: Floats | None
    customs: list[Floats]
    blend_shapes: list[Floats]


def read_as_godot(path: Path) -> dict[str, list[Surface]]:
    """Return the surfaces of each imported node by the node's name."""
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
