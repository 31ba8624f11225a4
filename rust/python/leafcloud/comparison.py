"""Pictures and drawing costs of the levels of a GLB file, by any tool, beside the leaves of another."""

from __future__ import annotations

import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from . import FRAGMENTS_PER_TRIANGLE, Foliage, LeafcloudError, drawing_cost, flip_map, read_gltf, render
from ._glb import GlbFile
from .inspection import below, levels_of, reading

SIZES = (256, 128, 64, 32)
"""Sides of the pictures in pixels, in which a file is compared with the leaves."""

_VIEWS = [(1.0, 0.0, 0.2), (-0.5, 0.85, 0.1), (-0.5, -0.85, 0.35), (0.2, 0.3, 0.95)]

_REACH = 4
"""FLIP counts within this many pixels of a silhouette."""


@dataclass(frozen=True)
class Score:
    """A level beside the leaves in pictures of one size.

    level: its name. size: of the pictures in pixels. flip: within 4 pixels of the silhouettes, in [0, 1]. coverage,
    cost: of drawing, over those of the leaves.
    """

    level: str
    size: int
    flip: float
    coverage: float
    cost: float


def compare(path: Path, leaves: Path) -> list[Score]:
    """Compare each level of a file with the finest level of another, in pictures of falling sizes.

    Raises `LeafcloudError` for files that cannot be read.
    """
    with reading(leaves):
        of_leaves = GlbFile(leaves)
        base = _foliage(of_leaves, levels_of(of_leaves)[0][2])
    with reading(path):
        file = GlbFile(path)
        return [score for name, _, nodes in levels_of(file) for score in _scores(name, base, _foliage(file, nodes))]


def _foliage(file: GlbFile, nodes: list[int]) -> Foliage:
    """Return all meshes below nodes, in their place."""
    with TemporaryDirectory() as folder:
        alone = Path(folder).resolve() / "level.glb"
        alone.write_bytes(file.with_only(below(file, nodes)))
        for image in file.items("images"):
            _copy_beside(str(image.get("uri", "")), file.path.parent.resolve(), alone.parent)
        try:
            return read_gltf(str(alone), names=[""])
        except LeafcloudError as error:
            raise LeafcloudError(str(error).replace(str(alone), str(file.path))) from error


def _copy_beside(name: str, home: Path, folder: Path) -> None:
    """Copy an image from one folder into another, under the same name. Do nothing for a name that leaves a folder."""
    source, copy = (home / name).resolve(), (folder / name).resolve()
    if not name or name.startswith("data:") or not (source.is_relative_to(home) and copy.is_relative_to(folder)):
        return
    with suppress(OSError):  # The reader tells of a missing image.
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, copy)


def _scores(name: str, base: Foliage, other: Foliage) -> list[Score]:
    centre, radius = list(base.world_centre), float(base.radius) * 1.05
    pairs = [
        [render([shown], view, SIZES[0], centre=centre, radius=radius, samples=2) for shown in (base, other)]
        for view in _VIEWS
    ]
    scores = []
    for size in SIZES:
        halves = [[_reduced(picture, size) for picture in pair] for pair in pairs]
        errors = [flip_near(*pair) for pair in halves]
        covered = [sum(float(pair[i][..., 3].sum()) for pair in halves) for i in (0, 1)]
        costs = [_cost(shown, size / (2.0 * radius)) for shown in (base, other)]
        scores.append(Score(name, size, float(np.mean(errors)), covered[1] / max(covered[0], 1.0), costs[1] / costs[0]))
    return scores


def _cost(foliage: Foliage, scale: float) -> float:
    """Return the cost of drawing in fragments: a triangle costs as much as `FRAGMENTS_PER_TRIANGLE` of them."""
    cost = drawing_cost([foliage], scale)
    return float(cost["fragments"] + FRAGMENTS_PER_TRIANGLE * cost["triangles"])


def _reduced(picture: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Return a smaller picture, of means of colors weighted by alpha."""
    step = picture.shape[0] // size
    values = picture.astype(np.float64)
    values[..., :3] *= values[..., 3:] / 255.0
    means = values.reshape(size, step, size, step, 4).mean(axis=(1, 3))
    means[..., :3] *= 255.0 / np.maximum(means[..., 3:], 1e-9)
    return np.rint(means).clip(0, 255).astype(np.uint8)


def flip_near(base: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Return the mean FLIP of two RGBA pictures within 4 pixels of either silhouette; 0 if both are empty."""
    near = (base[..., 3] > 127) | (other[..., 3] > 127)
    for _ in range(_REACH):
        grown = near.copy()
        grown[1:] |= near[:-1]
        grown[:-1] |= near[1:]
        grown[:, 1:] |= near[:, :-1]
        grown[:, :-1] |= near[:, 1:]
        near = grown
    return float(flip_map(base, other)[near].mean()) if near.any() else 0.0
