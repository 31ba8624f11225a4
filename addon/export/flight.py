"""Short films of the flight across each hand-over: the level before morphs and fades, the next level takes over."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..bake.drawing import level_trunks
from ..bake.values import Baked
from ..plan.camera_visibility import pixels_of
from ..plan.lod_range import LodRange, View, trunk_range
from . import canvas
from .preview import DIRECTION, Sphere, Subject, sphere_of, subjects_of

SIDE = 216
"""Maximum side of the pictures of a film in pixels."""
MOST = 16
"""Maximum enlargement."""
NARROWEST = 224
"""Minimum width, for the text below the picture."""
APPROACH, FADING = 8, 6
"""Frames before and after the next level appears."""
NEARER, BEYOND = 0.95, 1.04
"""The flight begins and ends at these multiples of the distances where the transition begins and ends."""
LEAST_MORPH = 0.15
"""Without a morph the flight begins this fraction of the distance before the next level appears."""
FRAME, FIRST, LAST = 110, 600, 1200
"""Durations of frames in milliseconds."""
COLORS = 64
SAMPLES = 2
"""Samples along each side of a drawn pixel."""
TEXT = 11
"""Size of the text in pixels."""
INDENT = 4


@dataclass(frozen=True)
class HandOver:
    """Two consecutive levels, and the LOD ranges of the levels and of the trunk before."""

    before: Subject
    after: Subject
    level: leafcloud.AnyLevel
    ranges: tuple[LodRange, LodRange]
    trunk: LodRange

    @property
    def distances(self) -> NDArray[np.float64]:
        """The distances of all frames."""
        first, second = self.ranges
        begin = first.start if math.isfinite(first.start) else second.appear * (1.0 - LEAST_MORPH)
        approach = np.geomspace(NEARER * begin, second.appear, APPROACH, endpoint=False)
        return np.concatenate([approach, np.geomspace(second.appear, BEYOND * first.vanish, FADING)])


def flights(tree: Baked) -> list[bytes]:
    """Return one animated PNG for each level after LOD 0."""
    subjects = subjects_of(tree.prepared.foliage, level_trunks(tree), tree.chain.levels)
    sphere = sphere_of(subjects[0].parts)
    ranges = tree.schedule.lod_ranges
    films = []
    for number, level in enumerate(tree.chain.levels, 1):
        hand_over = HandOver(
            subjects[number - 1],
            subjects[number],
            level,
            (ranges[number - 1], ranges[number]),
            trunk_range(ranges, number - 1),
        )
        films.append(film(hand_over, sphere, tree.view))
    return films


def film(hand_over: HandOver, sphere: Sphere, view: View) -> bytes:
    """Return an animated PNG of one hand-over."""
    camera = Camera.of(hand_over, sphere, view)
    blocks = [_frame(hand_over, camera, distance) for distance in hand_over.distances.tolist()]
    durations = [FIRST, *[FRAME] * (len(blocks) - 2), LAST]
    return leafcloud.encode_png([canvas.opaque(block) for block in blocks], milliseconds=durations, colors=COLORS)


@dataclass(frozen=True)
class Camera:
    """A camera that flies away from the tree.

    pixels: side of the square that is drawn. box: the part that a film shows. scale: fraction of the size on screen.
    times: pixels of the film along each side of a drawn pixel.
    """

    sphere: Sphere
    view: View
    pixels: int
    box: canvas.Box
    scale: float
    times: int

    @classmethod
    def of(cls, hand_over: HandOver, sphere: Sphere, view: View) -> Camera:
        """Return a camera. Where the next level appears, the crown fills its pictures."""
        distance = hand_over.ranges[1].appear
        size = pixels_of(2.0 * sphere.radius, distance, view)
        scale = min(1.0, SIDE / size)
        side = max(math.ceil(scale * size), 4)
        whole = cls(sphere, view, side, (0, side, 0, side), scale, 1)
        seen = [whole.picture(each, distance) for each in (hand_over.before, hand_over.after)]
        top, bottom, left, right = canvas.silhouette(seen)
        times = max(min(SIDE // (bottom - top), SIDE // (right - left), MOST), 1)
        # The square grows until the box is as wide as the text.
        wider = max(math.ceil(NARROWEST / times) - (right - left), 0)
        box = (top + wider, bottom + wider, left + wider - wider // 2, right + 2 * wider - wider // 2)
        return cls(sphere, view, side + 2 * wider, box, scale, times)

    def picture(self, subject: Subject, distance: float) -> canvas.Picture:
        """Return the picture (h, w, 4) of the box from `distance`."""
        size = self.scale * pixels_of(2.0 * self.sphere.radius, distance, self.view)
        radius = self.sphere.radius * self.pixels / size
        picture = subject.render(DIRECTION, self.pixels, centre=self.sphere.centre, radius=radius, samples=SAMPLES)
        return canvas.cropped(picture, self.box)


def _frame(hand_over: HandOver, camera: Camera, distance: float) -> canvas.Block:
    first, second = hand_over.ranges
    morph = leafcloud.transition(distance, first.start, first.end) if math.isfinite(first.end) else 0.0
    going, coming = _share_left(first, distance), _share_come(second, distance)
    before, after, level = hand_over.before, hand_over.after, hand_over.level
    # Near levels have one trunk at a time. An impostor shows it in its textures.
    trunk = (before if distance < hand_over.trunk.vanish else after).parts[1:]
    height, width = camera.box[1] - camera.box[0], camera.box[3] - camera.box[2]
    ground = canvas.empty(height, width, canvas.GROUND)
    shown = []
    if going > 0.0:
        leaves = before.parts[0]
        if morph > 0.0 and not isinstance(level, leafcloud.OctahedralLevel):
            leaves = level.morphed(leaves, morph)
        shown.append((camera.picture(replace(before, parts=(leaves, *trunk)), distance), going))
    if coming > 0.0:
        drawn = replace(after, parts=(after.parts[0], *trunk)) if len(after.parts) > 1 else after
        shown.append((camera.picture(drawn, distance), coming))
    color = _faded(shown, ground)
    told = [f"distance {canvas.number(distance)}"]
    if 0.0 < coming < 1.0:
        told.append(f"cross-fade {coming:.0%}")
    elif morph > 0.0 and going > 0.0:
        told.append(f"morph {morph:.0%}")
    names = f"{hand_over.before.name} → {hand_over.after.name}"
    picture = canvas.enlarged(color, camera.times)
    lines = [canvas.text(names, TEXT), canvas.text(", ".join(told), TEXT, canvas.GRAY)]
    indented = [canvas.beside([canvas.empty(1, INDENT), line], 0)[:, : picture.shape[1]] for line in lines]
    return canvas.below([picture, *indented], 0)


def _faded(pictures: Sequence[tuple[canvas.Picture, float]], ground: canvas.Block) -> canvas.Block:
    """Return the pictures over a background, each on its share of the places, as a dither shows them."""
    color = ground.astype(np.float32)
    for picture, share in pictures:
        alpha = picture[..., 3:].astype(np.float32) * np.float32(share / 255.0)
        color += alpha * (picture[..., :3] - ground.astype(np.float32))
    return np.rint(color.clip(0.0, 255.0)).astype(np.uint8)


def _share_left(lod_range: LodRange, distance: float) -> float:
    """Return the share of a level that its fading out leaves."""
    if distance >= lod_range.vanish:
        return 0.0
    fade = lod_range.vanish - lod_range.fade_out_start
    return 1.0 if fade <= 0.0 else min(1.0, (lod_range.vanish - distance) / fade)


def _share_come(lod_range: LodRange, distance: float) -> float:
    """Return the share of a level that its fading in has reached."""
    if distance < lod_range.appear:
        return 0.0
    fade = lod_range.fade_in_end - lod_range.appear
    return 1.0 if fade <= 0.0 else min(1.0, (distance - lod_range.appear) / fade)
