"""Pictures of preview.png and report.html: each level beside the leaves at the size where it takes over.

The size at which a level takes over is its *swap size*: the pixels that the tree covers at the level's LOD distance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..bake.drawing import level_trunks
from ..bake.values import Baked
from ..levels.results import level_name
from ..plan.camera_visibility import pixels_of
from . import canvas
from .canvas import Block, Box, Picture

LARGEST, SMALLEST = 480, 8
"""Range of the size of a picture in pixels, before it is framed. Labels name swap sizes outside the range."""
WIDEST = 360
"""Maximum side of an enlarged picture, and of one at twice the swap size."""
GAP = 12
MARGIN = 16
TITLE, NAME, FIGURES, LABEL = 26, 20, 14, 12
"""Sizes of text in pixels."""
NARROWEST = 560
"""Minimum width of a line of figures."""
SMALL = 128
"""Side in pixels of pictures up to which a pixel gets 4 × 4 samples; in larger ones it gets 2 × 2."""
FRAMES_LEFT = 0.96
"""Fraction of the views' width for the leaves; levels are a little wider."""
TALLEST_VIEW = 300
"""Maximum height of a picture in the views."""

DIRECTION = (0.45, -1.0, 0.2)
"""Direction from the tree to the eye."""
VIEWS: Mapping[str, tuple[float, float, float]] = {
    "front": (0.0, -1.0, 0.2),
    "right": (1.0, 0.0, 0.2),
    "back": (0.0, 1.0, 0.2),
    "left": (-1.0, 0.0, 0.2),
    "above": (0.45, -1.0, 1.6),
}


@dataclass(frozen=True)
class Subject:
    """A level as it is drawn: its name, and its foliage and trunk, or the impostor that shows both."""

    name: str
    parts: tuple[leafcloud.Foliage, ...]
    impostor: leafcloud.OctahedralLevel | None = None

    def render(
        self, direction: Sequence[float], side: int, *, centre: Sequence[float], radius: float, samples: int
    ) -> Picture:
        """Render as `leafcloud.render` does."""
        if self.impostor is not None:
            return self.impostor.render(direction, side, centre=centre, radius=radius, samples=samples)
        return leafcloud.render(self.parts, direction, side, centre=centre, radius=radius, samples=samples)


@dataclass(frozen=True)
class Sphere:
    """The sphere around leaves and trunk, in the world."""

    centre: tuple[float, float, float]
    radius: float

    def picture(self, subject: Subject, size: float, direction: Sequence[float] = DIRECTION, times: int = 1) -> Picture:
        """Return a picture in which the sphere's diameter covers `times` · `size` pixels; `size` need not be whole."""
        side = max(int(np.ceil(size)), 1)
        radius = self.radius * side / size
        samples = 4 if times * side <= SMALL else 2
        return subject.render(direction, times * side, centre=self.centre, radius=radius, samples=samples)


@dataclass(frozen=True)
class LevelFigure:
    """A level's name, its figures as short texts, and its pictures beside those of the leaves; LOD 0 has none."""

    name: str
    figures: tuple[str, ...]
    panel: Block | None


@dataclass(frozen=True)
class TreeFigures:
    """All pictures of a tree, except the flights."""

    name: str
    levels: tuple[LevelFigure, ...]
    views: Block


def subjects_of(
    foliage: leafcloud.Foliage, trunks: Sequence[leafcloud.Foliage | None], levels: Sequence[leafcloud.AnyLevel]
) -> list[Subject]:
    """Return all levels, the leaves first. `trunks`: the trunk of each."""

    def subject(level: leafcloud.AnyLevel, number: int) -> Subject:
        name, trunk = level_name(level, number), trunks[number]
        if isinstance(level, leafcloud.OctahedralLevel):
            return Subject(name, (), level)
        return Subject(name, (level.foliage(),) if trunk is None else (level.foliage(), trunk))

    leaves = Subject("Leaves", (foliage,) if trunks[0] is None else (foliage, trunks[0]))
    return [leaves, *(subject(level, number) for number, level in enumerate(levels, 1))]


@dataclass(frozen=True)
class Pictures:
    """The levels' names and pictures, LOD 0 first, and the table of their views."""

    names: tuple[str, ...]
    panels: tuple[Block | None, ...]
    views: Block


def pictures_of(tree: Baked) -> Pictures:
    """Draw the pictures of a tree. It uses nothing of Blender, so any thread may call it."""
    subjects = subjects_of(tree.prepared.foliage, level_trunks(tree), tree.chain.levels)
    sphere = sphere_of(subjects[0].parts)
    panels: list[Block | None] = [None]
    for subject, distance in zip(subjects[1:], tree.switch_distances[1:], strict=True):
        panels.append(level_panel(subjects[0], subject, sphere, pixels_of(2.0 * sphere.radius, distance, tree.view)))
    widest = max([NARROWEST, *(panel.shape[1] for panel in panels if panel is not None)])
    return Pictures(tuple(each.name for each in subjects), tuple(panels), views(subjects, sphere, widest))


def tree_figures(tree: Baked, rows: Sequence[Mapping[str, Any]], pictures: Pictures) -> TreeFigures:
    """Return the pictures of a tree with its figures. `rows`: the levels of its report."""
    are_shared = [False, *(level.page_share < 1.0 for level in tree.chain.levels)]
    levels = [
        LevelFigure(name, tuple(figures_of(row, tree.prepared.foliage.radius, is_shared=shared)), panel)
        for name, row, panel, shared in zip(pictures.names, rows, pictures.panels, are_shared, strict=True)
    ]
    return TreeFigures(tree.collection.name, tuple(levels), pictures.views)


def figures_of(row: Mapping[str, Any], radius: float, *, is_shared: bool = False) -> list[str]:
    """Return the figures of a level's row of the report as short texts.

    radius: R of the leaves. is_shared: whether other trees are on the level's atlas page.
    """
    total = row["triangles"] + row["trunk_triangles"]
    triangles = f"{total:,} triangles" + (" with trunk" if row["trunk_triangles"] else "")
    if row["level"] == 0:
        return [triangles]
    texture = "the leaves' textures"
    if row["texture_size"] is not None:
        width, height = row["texture_size"]
        texture = f"texture {width} × {height}" + (" for all trees" if is_shared else "")
    distance, size = row["switch_distance"], row["drawing"]["size"]
    return [
        triangles,
        texture,
        f"image error {row['image_error']:.3f} at 128 pixels",
        f"LOD distance {canvas.number(distance)} ({canvas.number(distance / radius)} R)",
        f"crown {size:.{0 if size > 0.095 else 1}%} of the picture's height there",
    ]


def sheet(figures: TreeFigures) -> Block:
    """Return the image of one tree for preview.png: its levels with their figures, then all views."""
    panels = [level.panel for level in figures.levels if level.panel is not None]
    width = max([NARROWEST, figures.views.shape[1], *(panel.shape[1] for panel in panels)])
    blocks = [canvas.text(figures.name, TITLE)]
    for level in figures.levels:
        heading = _heading(level, width)
        blocks.append(heading if level.panel is None else canvas.below([heading, level.panel], 6))
    blocks.append(canvas.below([canvas.text("All levels from five directions", NAME), figures.views], 6))
    return canvas.framed(canvas.below(blocks, MARGIN), MARGIN)


def _heading(level: LevelFigure, width: int) -> Block:
    """Return the level's name with its figures beside it, or below it where they need more than one line."""
    name = canvas.text(level.name, NAME)
    told = canvas.wrapped(level.figures, FIGURES, width)
    if told.shape[0] < name.shape[0] and name.shape[1] + GAP + told.shape[1] <= width:
        return canvas.beside([name, told], GAP, "bottom")
    return canvas.below([name, told], 2)


def preview_image(trees: Sequence[TreeFigures]) -> Block:
    """Return the image of preview.png."""
    return canvas.below([sheet(tree) for tree in trees], 0)


def level_panel(leaves: Subject, level: Subject, sphere: Sphere, pixels: float) -> Block:
    """Return the leaves, the level and their difference at swap size, and both at twice that. `pixels`: diameter of the
    sphere.
    """
    size = float(np.clip(pixels, SMALLEST, LARGEST))
    pair, twice = ([sphere.picture(subject, size, times=times) for subject in (leaves, level)] for times in (1, 2))
    box = canvas.silhouette(pair)
    errors = canvas.cropped(leafcloud.flip_map(*pair), box)
    colors = [canvas.over(canvas.cropped(picture, box)) for picture in pair]
    names = [leaves.name, level.name, "Difference (FLIP)"]
    own_size = "swap size" if size == pixels else f"{size / pixels:.2g} × swap size"
    height, width, _ = colors[0].shape
    times = max(min(WIDEST // height, WIDEST // width), 1)
    columns: list[Block] = []
    if times > 1:
        small = [_labelled(name, color) for name, color in zip(names, colors, strict=False)]
        columns.append(_column(own_size.capitalize(), small))
    labels = [f"{name}, {own_size}" if times == 1 else f"{name} × {times}" for name in names]
    window = worst_window(errors, (max(height * times, 2) // 2, WIDEST // 2))
    is_whole = window == (0, height, 0, width)
    columns += _triple(labels, colors, errors, times, None if is_whole else window)
    starts = (box[0], box[0], box[2], box[2])
    top, bottom, left, right = (2 * (edge + start) for edge, start in zip(window, starts, strict=True))
    for name, picture in zip(names, twice, strict=False):
        near = canvas.over(canvas.cropped(picture, (top, bottom, left, right)))
        columns.append(_column(f"{name}, twice the size" if is_whole else f"{name}, frame at twice the size", [near]))
    return canvas.beside(columns, GAP)


def _triple(
    labels: Sequence[str], colors: Sequence[Block], errors: NDArray[np.float32], times: int, window: Box | None
) -> list[Block]:
    """Return the two pictures and the heat map of their difference, enlarged, with a frame around the window."""
    frames = [canvas.INK, canvas.INK, canvas.PAPER]
    blocks = []
    for color, frame in zip([*colors, canvas.heat(errors)], frames, strict=True):
        block = canvas.enlarged(color, times)
        if window is not None:
            top, bottom, left, right = (times * edge for edge in window)
            block = canvas.outlined(block, (top, bottom, left, right), frame)
        blocks.append(block)
    blocks[2] = canvas.beside([blocks[2], canvas.color_bar(blocks[2].shape[0])], 4)
    return [_column(label, [block]) for label, block in zip(labels, blocks, strict=True)]


def worst_window(errors: NDArray[np.float32], sides: tuple[int, int]) -> Box:
    """Return the box of at most `sides` (rows, columns) with the greatest mean error."""
    height, width = errors.shape
    rows, columns = min(sides[0], height), min(sides[1], width)
    total = np.zeros((height + 1, width + 1))
    total[1:, 1:] = errors.astype(np.float64).cumsum(axis=0).cumsum(axis=1)
    sums = total[rows:, columns:] - total[:-rows, columns:] - total[rows:, :-columns] + total[:-rows, :-columns]
    top, left = np.unravel_index(int(np.argmax(sums)), sums.shape)
    return int(top), int(top) + rows, int(left), int(left) + columns


def views(subjects: Sequence[Subject], sphere: Sphere, width: int) -> Block:
    """Return a table of pictures at most `width` pixels wide: a row for each subject, a column for each direction.

    All pictures have about the same height.
    """
    # Level 1 has the shape of the leaves and far fewer triangles.
    shape = subjects[min(1, len(subjects) - 1)]
    shapes = [_framed_shape(shape, sphere, direction) for direction in VIEWS.values()]
    height = (width - (len(VIEWS) - 1) * GAP) / sum(across / up for up, across in shapes) * FRAMES_LEFT
    sizes = [min(height, TALLEST_VIEW) / up for up, _ in shapes]
    pictured = list(zip(VIEWS.values(), sizes, strict=True))
    columns = [[sphere.picture(subject, size, direction) for subject in subjects] for direction, size in pictured]
    boxes = [canvas.silhouette(column) for column in columns]
    rows = []
    for number, subject in enumerate(subjects):
        row = [canvas.over(canvas.cropped(column[number], box)) for column, box in zip(columns, boxes, strict=True)]
        if number == 0:
            row = [_column(name, [tile]) for name, tile in zip(VIEWS, row, strict=True)]
        rows.append(canvas.below([canvas.text(subject.name, LABEL), canvas.beside(row, GAP)], 2))
    return canvas.below(rows, 6)


def sphere_of(parts: Sequence[leafcloud.Foliage]) -> Sphere:
    """Return a sphere around the bounding spheres of the parts."""
    centre, radius = np.asarray(parts[0].world_centre), parts[0].radius
    for part in parts[1:]:
        offset = np.asarray(part.world_centre) - centre
        distance = float(np.linalg.norm(offset))
        if distance + part.radius <= radius:
            continue
        if distance + radius <= part.radius:
            centre, radius = np.asarray(part.world_centre), part.radius
            continue
        grown = (distance + radius + part.radius) / 2.0
        centre, radius = centre + offset * ((grown - radius) / distance), grown
    x, y, z = centre.tolist()
    return Sphere((x, y, z), radius)


def _framed_shape(subject: Subject, sphere: Sphere, direction: Sequence[float]) -> tuple[float, float]:
    """Return height and width of the subject's silhouette as fractions of the sphere's diameter."""
    side = 64
    top, bottom, left, right = canvas.silhouette([sphere.picture(subject, side, direction)], 0)
    return (bottom - top) / side, (right - left) / side


def _column(heading: str, blocks: Sequence[Block]) -> Block:
    return canvas.below([canvas.text(heading, LABEL, canvas.GRAY), *blocks], 3)


def _labelled(name: str, block: Block) -> Block:
    return canvas.below([block, canvas.text(name, LABEL, canvas.GRAY)], 2)
