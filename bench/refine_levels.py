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
    directions,
    flip,
    make_alternatives,
    premultiplied,
    rendered,
    smaller,
)
from read_pages import Page
from refine_checks import SIZES

import leafcloud
from addon.plan.camera_visibility import far_off, pixels_of
from addon.plan.lod_range import View
from addon.plan.pages import halvings
from addon.plan.quality import distance_of, switch_sizes
from addon.settings.bake import BakeSettings

LARGEST, SAMPLES = 512, 8
"""Side of the pictures, and samples along a pixel's side. Smaller pictures are means of these."""
SMALL = 64
"""Side of the pictures in which the coverage of pages for engines is measured: about where levels take over."""
MOST_SAMPLES = 16
"""Most samples along a side of a pixel that the metrics take."""
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


def file_size(level: leafcloud.Level, radius: float) -> tuple[int, float]:
    """Return how often bake.py halves the page in a GLB file of this level, and the crown's pixels at its take-over.

    As bake.py chooses them without settings and without a camera in the scene.
    """
    settings, view = BakeSettings(), View()
    [by_picture] = switch_sizes(settings, [level])
    by_deviation = far_off(level.max_deviation_leaves * radius, settings.switch_pixels, view)
    takes_over = max(by_deviation, distance_of(by_picture.size, radius, view))
    return halvings(pixels_of(level.texel_size, takes_over, view)), pixels_of(2.0 * radius, takes_over, view)


def size_nearest(crown: float) -> int:
    """Return the size of the pictures in which a crown is nearest to so many pixels."""
    return min(SIZES, key=lambda size: abs(math.log(size / PICTURE_RADIUS / crown)))


def pictures_as_read(base: leafcloud.Foliage, page: Page, size: int, samples: int) -> Pictures:
    """Render the compared views of a page as an engine reads it."""
    radius = PICTURE_RADIUS * base.radius
    frame = {"centre": base.world_centre.tolist(), "radius": radius, "samples": samples, "filtered": False}
    views = ((list(page.read(direction, 2.0 * radius / size)), direction) for direction in directions())
    return premultiplied([leafcloud.render(parts, direction, size, **frame) for parts, direction in views])


def engine_errors(seen: Pictures, base: leafcloud.Foliage, level: leafcloud.Level, halved: int) -> dict[str, float]:
    """Return the errors of the billboards with the page of a GLB file as engines read it, by the size of the pictures,
    and the coverage at SMALL."""
    page = Page(level, halved)
    found = {}
    for size in SIZES:
        pictures = pictures_as_read(base, page, size, min(SAMPLES * LARGEST // size, MOST_SAMPLES))
        leaves = smaller(seen, LARGEST // size)
        found[str(size)] = flip(leaves, pictures)
        if size == SMALL:
            found["coverage"] = coverage(leaves, pictures)
    return found
