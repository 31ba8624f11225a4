"""Level 1 of a tree, refined or not, with pictures and errors: shared by the measurements of `refine.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import stage  # noqa: F401 - makes the add-on importable
from fidelity import (
    CANDIDATES,
    KEPT,
    LEVELS,
    PICTURE_RADIUS,
    SEED,
    Pictures,
    coverage,
    flip,
    make_alternatives,
    rendered,
    smaller,
)
from refine_checks import SIZES

import leafcloud
from addon.plan.camera_visibility import far_off, pixels_of
from addon.plan.lod_range import View
from addon.plan.quality import distance_of, switch_sizes
from addon.settings.bake import BakeSettings

LARGEST, SAMPLES = 512, 8
"""Side of the pictures, and samples along a pixel's side. Smaller pictures are means of these."""
PAPER: dict[str, Any] = {"effort": "literal", "candidates": int(CANDIDATES), "seed": int(SEED), "extra_error": 0.0}
"""The fit of the published method."""
BAKES: dict[str, dict[str, Any]] = {effort: {"refine": effort} for effort in ("off", "short", "long")}
ABLATION: dict[str, dict[str, Any]] = {
    "paper's fit, off": {**PAPER, "refine": "off"},
    "paper's fit, long": {**PAPER, "refine": "long"},
    "long, texels": {"refine": "long", "refine_parts": ("texels",)},
    "long, planes": {"refine": "long", "refine_parts": ("planes",)},
    "long, a quarter": {"refine": "long", "texture_size": LEVELS["a quarter"]},
}
LIT: dict[str, dict[str, Any]] = {f"{effort}, with normals": {**more, "normals": 0.0} for effort, more in BAKES.items()}
"""Levels for light: with normals that are not bent."""


@dataclass(frozen=True)
class Built:
    """Level 1, and the seconds of its fit, bake and refinement."""

    level: leafcloud.Level
    seconds: float


@dataclass
class Subject:
    """A tree, with what its measurements have in common. Each thing is made once, when it is needed."""

    tree: Path
    built: dict[str, Built] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        return KEPT / self.tree.stem

    @property
    def leaves(self) -> Path:
        """File of the leaves alone."""
        return self.folder / "leaves.glb"

    @cached_property
    def billboards(self) -> int:
        """Number of billboards of the published method. Writes the files of the other methods, too."""
        return make_alternatives(self.tree, self.folder)

    @cached_property
    def base(self) -> leafcloud.Foliage:
        assert self.billboards  # Writes the file of the leaves.
        return leafcloud.read_gltf(str(self.leaves), names=["leaves"])

    @cached_property
    def seen(self) -> Pictures:
        """Pictures of the leaves."""
        return self.pictures(self.base)

    def pictures(self, shown: leafcloud.Foliage) -> Pictures:
        return rendered(self.base, [shown], LARGEST, SAMPLES)

    def level(self, name: str) -> Built:
        """Build level 1 as named in BAKES, ABLATION or LIT."""
        if name not in self.built:
            options: dict[str, Any] = {
                "max_billboards": self.billboards,
                "extra_error": 0.25,
                "texture_size": LEVELS["level 1"],
                "back_sides": False,
                "levels": 1,
                "cross": False,
                **{**BAKES, **ABLATION, **LIT}[name],
            }
            chain = leafcloud.build_chain(self.base, **options)
            self.built[name] = Built(chain.clouds[0], chain.seconds)
        return self.built[name]


def errors(base: Pictures, other: Pictures) -> dict[str, float]:
    """Return FLIP by the size of the pictures, and the coverage."""
    by_size = {str(size): flip(*(smaller(each, LARGEST // size) for each in (base, other))) for size in SIZES}
    return {**by_size, "coverage": coverage(base, other)}


def takes_over(level: leafcloud.Level, radius: float) -> float:
    """Return the crown's pixels where bake.py lets this level take over, without settings and without a camera."""
    settings, view = BakeSettings(), View()
    [by_picture] = switch_sizes(settings, [level])
    by_deviation = far_off(level.max_deviation_leaves * radius, settings.switch_pixels, view)
    return pixels_of(2.0 * radius, max(by_deviation, distance_of(by_picture.size, radius, view)), view)


def size_nearest(crown: float) -> int:
    """Return the size of the pictures in which a crown is nearest to so many pixels."""
    return min(SIZES, key=lambda size: abs(math.log(size / PICTURE_RADIUS / crown)))
