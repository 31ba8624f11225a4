"""Tints of single leaves relative to the rendering of their material: by island, object and position.

All leaves are sampled at one UV point, where the rendering is opaque and near its mean color. A leaf's tint is its
color there divided by the rendering's. For multiplied variation (brightness, a tint) that is exact, and one rendering
is enough. For other variation, such as a hue shift or leaves that are red or blue, the material is rendered for several
random numbers of objects. A leaf's tint is then relative to the most similar rendering. Cycles bakes the leaves' colors
to their corners. The backs get tints of the same rendering.

Known limits:
- Variation by island and position always becomes a tint.
- Variation of alpha is ignored.
- Islands have random numbers of the same distribution as in Blender, but not the same numbers, because these depend on
  the order of vertices.
- Generated and Object coordinates are those of all leaves together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ..geometry import Geometry, world_positions
from .emission import Light
from .flatten import (
    RANDOM,
    SIDE,
    Flattened,
    RenderSettings,
    add_layers,
    color_shader,
    cycles_scene,
    emitting,
    flatten,
)
from .node_links import shown_nodes

GREATEST = 8.0
"""Upper limit of tints. A ratio to a nearly black rendering has no meaning."""

LEAST = 1e-3
"""Darker colors count as black, which no factor can brighten."""

SAME = 0.05
"""Allowed error of a tint at a second UV point, as a fraction of the leaf's brightest channel."""

MOST_LOOKS = 16
"""Greatest number of random numbers to render a material for."""

TEXELS = 2048
"""Side of a square in texels that bounds the area of all renderings of a material together, if there are several."""

_FEW = 64
"""Number of leaves to sample in checks of tints."""

Place = tuple[float, float]
"""(u, v)"""


@dataclass(frozen=True)
class Islands:
    """Leaves: world positions (v, 3), triangles (t, 3), and the random number (t,) of each triangle's object."""

    positions: NDArray[np.float32]
    triangles: NDArray[np.int32]
    randoms: NDArray[np.float32]

    @staticmethod
    def of_geometry(geometry: Geometry, matrix: NDArray[np.float64]) -> Islands:
        """Return all leaves of a geometry with this world matrix (4, 4)."""
        count = len(geometry.triangles)
        randoms = np.full(count, 0.5, np.float32) if geometry.randoms is None else geometry.randoms
        return Islands(world_positions(geometry, matrix).astype(np.float32), geometry.triangles, randoms)

    def of(self, chosen: NDArray[np.generic]) -> Islands:
        """Return only the triangles chosen by a mask or by indices."""
        return Islands(self.positions, self.triangles[chosen], self.randoms[chosen])


def settings_of(flat: Flattened, leaves: Islands) -> tuple[list[RenderSettings], list[str]]:
    """Return the settings to render a material with, and messages. Tints cover the remaining variation."""
    flat, messages = _between_sides(flat)
    said = f"material {flat.material.name!r}:"
    if not flat.varies or _are_tints(flat, leaves):
        return [flat.settings], messages
    if not flat.by_random:
        return [flat.settings], [
            *messages,
            f"{said} islands or positions change its leaves by more than a tint, and only the tint is kept; vary them "
            f"by Object Info > Random, which is rendered for several values",
        ]
    numbers = np.unique(leaves.randoms)
    count = len(numbers)
    if count > MOST_LOOKS:
        numbers = np.quantile(numbers, (np.arange(MOST_LOOKS) + 0.5) / MOST_LOOKS)
    largest = 1 << int(np.log2(TEXELS / len(numbers) ** 0.5))
    side = min(largest, len(flat.pixels))
    return [RenderSettings(float(number), flat.settings.side, largest) for number in numbers], [
        *messages,
        f"{said} Object Info > Random changes its leaves by more than a tint, so it is rendered for {len(numbers)} of "
        f"{count} random numbers, to images of {side} × {side} texels",
    ]


def _between_sides(front: Flattened) -> tuple[Flattened, list[str]]:
    """Return a rendering that both sides of the leaves are tints of, and messages.

    Tries the front, then a rendering halfway between front and back. If both fail, returns the front and a warning.
    """
    if not front.by_side:
        return front, []
    back = flatten(front.material, front.light, replace(front.settings, side=1.0))
    if _is_tint(back, front):
        return front, []
    between = flatten(front.material, front.light, replace(front.settings, side=0.5))
    if _is_tint(back, between) and _is_tint(front, between):
        return between, []
    said = f"material {front.material.name!r}: its back is more than a tint of its front, and only the tint is kept"
    return front, [f"{said}; give both sides the same pattern"]


@dataclass(frozen=True)
class Tints:
    """which: (t,) the most similar rendering of each triangle. front, back: (t, 3, 3) factors of it by corner."""

    which: NDArray[np.int64]
    front: NDArray[np.float32]
    back: NDArray[np.float32]


def nearest_tints(flats: Sequence[Flattened], leaves: Islands) -> Tints:
    """Return the leaves' tints of the most similar renderings. Leaves with equal random numbers share a rendering."""
    place, _ = _places(flats[0].pixels)
    seen, shown = _seen(flats[0], leaves, place), _shown(flats, leaves, place)
    randoms = np.array([flat.settings.random for flat in flats], np.float32)
    numbers, of_triangle = np.unique(leaves.randoms, return_inverse=True)
    counts = np.bincount(of_triangle)
    colors = np.stack([np.bincount(of_triangle, channel) for channel in seen.mean(axis=1).T], axis=1) / counts[:, None]
    # Colors tell on which side of a threshold a leaf is. Random numbers decide between similar colors.
    apart = np.abs(colors[:, None] - shown).sum(axis=2) + np.abs(numbers[:, None] - randoms)
    which = np.argmin(apart, axis=1)[of_triangle]
    front = _ratio(seen, shown[which][:, None])
    if not flats[0].by_side:
        return Tints(which, front, front)
    return Tints(which, front, _ratio(_seen(flats[0], leaves, place, side=1.0), shown[which][:, None]))


def _is_tint(other: Flattened, flat: Flattened) -> bool:
    """Return whether one rendering of a material equals another one times a tint."""
    colors, shown = (each.pixels[..., :3].mean(axis=(0, 1)) for each in (other, flat))
    opacity = max(float(flat.pixels[..., 3].mean()), 1e-9)
    if not _reaches(shown / opacity, colors / opacity):
        return False
    off = np.abs(other.pixels[..., :3] - _ratio(colors, shown) * flat.pixels[..., :3]).mean(axis=(0, 1))
    return bool((off <= SAME * colors.max() + LEAST * opacity).all())


def _are_tints(flat: Flattened, leaves: Islands) -> bool:
    """Return whether tints explain the variation of the leaves, judging by a sample of them at two UV points."""
    few, places = _some(leaves), _places(flat.pixels)
    shown, shown_there = (_shown([flat], leaves, place) for place in places)
    seen, seen_there = (_seen(flat, few, place) for place in places)
    off = np.abs(seen_there - _ratio(seen, shown) * shown_there)
    close = off <= SAME * seen_there.max(axis=2, keepdims=True) + LEAST
    return _reaches(shown, seen) and bool(close.all())


def _reaches(shown: NDArray[np.float32], seen: NDArray[np.float32]) -> bool:
    return not np.where(shown > LEAST, seen > GREATEST * shown, seen > 2.0 * LEAST).any()


def _some(leaves: Islands) -> Islands:
    """Return up to `_FEW` triangles with different random numbers, and up to `_FEW` spread over all triangles."""
    count = len(leaves.triangles)
    _, first = np.unique(leaves.randoms, return_index=True)
    first = first[np.linspace(0, len(first) - 1, min(len(first), _FEW)).astype(int)]
    chosen = np.union1d(first, np.linspace(0, count - 1, min(count, _FEW)).astype(int))
    return leaves.of(chosen)


def _ratio(seen: NDArray[np.float32], shown: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (…, 3) the leaves' colors divided by the rendering's; 1 where the rendering is black."""
    shown = np.broadcast_to(shown, seen.shape)
    return np.clip(np.divide(seen, shown, out=np.ones_like(seen), where=shown > LEAST), 0.0, GREATEST)


def _places(pixels: NDArray[np.float32]) -> tuple[Place, Place]:
    """Return two UV points where the rendering is opaque and smooth: near its mean color, and far from the first's.

    Smooth, because a texel is a mean over its area, and a leaf's color is that of a point.
    """
    alpha = pixels[..., 3]
    mean = pixels[..., :3].sum((0, 1)) / max(float(alpha.sum()), 1e-9)
    steps = sum(np.abs(slope).sum(axis=2) for slope in np.gradient(pixels, axis=(0, 1)))
    bad = 4.0 * (1.0 - alpha) + 4.0 * steps

    def best(off: NDArray[np.float32]) -> Place:
        row, column = np.unravel_index(int(np.argmin(off)), off.shape)
        return (float(column) + 0.5) / off.shape[1], 1.0 - (float(row) + 0.5) / off.shape[0]

    first = best(np.abs(pixels[..., :3] - mean).sum(axis=2) + bad)
    return first, best(bad - np.abs(pixels[..., :3] - _texel(pixels, first)).sum(axis=2))


def _shown(flats: Sequence[Flattened], leaves: Islands, place: Place) -> NDArray[np.float32]:
    """Return (k, 3) the colors of the renderings at a UV point, clipped to 1 as in an image.

    If leaves do not vary by position, the colors are sampled at the point itself, as for leaves; else they are texels.
    """
    first = flats[0]
    if first.by_place:
        return np.minimum([_texel(flat.pixels, place) for flat in flats], 1.0)
    randoms = np.array([flat.settings.random for flat in flats], np.float32)
    corners = np.arange(3 * len(randoms), dtype=np.int32).reshape(-1, 3)
    copies = Islands(np.tile(leaves.positions[leaves.triangles[0]], (len(randoms), 1)), corners, randoms)
    return np.minimum(_seen(first, copies, place, first.settings.side).mean(axis=1), 1.0)


def _texel(pixels: NDArray[np.float32], place: Place) -> NDArray[np.float32]:
    """Return (3,) the color of a rendering at a UV point, without premultiplication."""
    height, width = pixels.shape[:2]
    texel = pixels[int((1.0 - place[1]) * height), int(place[0] * width)]
    return texel[:3] / max(float(texel[3]), 1e-3)


def _seen(flat: Flattened, leaves: Islands, place: Place, side: float = 0.0) -> NDArray[np.float32]:
    """Return (t, 3, 3) the colors that the leaves' corners have with this UV, on this side (0: front, 1: back)."""
    color, alpha = (_emitted(flat, light, leaves, place, side) for light in (flat.light, "coverage"))
    return np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0.0)


def _emitted(flat: Flattened, light: Light, leaves: Islands, place: Place, side: float) -> NDArray[np.float32]:
    """Return (t, 3, 3) a part of the light, times alpha, at the leaves' corners."""
    with emitting(flat.material, lambda copy: color_shader(copy, light)) as shown, cycles_scene(flat.material) as scene:
        mesh = _mesh(leaves, shown_nodes(flat.material.node_tree), place, side)
        mesh.materials.append(shown)
        return _baked(scene, mesh).reshape(-1, 3, 3)


def _mesh(leaves: Islands, nodes: list[bpy.types.Node], place: Place, side: float) -> bpy.types.Mesh:
    count = len(leaves.triangles)
    mesh = bpy.data.meshes.new("leafcloud tints")
    mesh.vertices.add(len(leaves.positions))
    mesh.vertices.foreach_set("co", leaves.positions.ravel())
    mesh.loops.add(3 * count)
    mesh.loops.foreach_set("vertex_index", leaves.triangles.ravel())
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    add_layers(mesh, nodes, np.tile(np.array(place, np.float32), (3 * count, 1)))
    mesh.attributes.new(RANDOM, "FLOAT", "FACE").data.foreach_set("value", leaves.randoms)
    mesh.attributes.new(SIDE, "FLOAT", "FACE").data.foreach_set("value", np.full(count, side, np.float32))
    mesh.color_attributes.active_color = mesh.color_attributes.new("leafcloud tints", "FLOAT_COLOR", "CORNER")
    mesh.update(calc_edges=True)
    return mesh


def _baked(scene: bpy.types.Scene, mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """Return (corners, 3) the baked emission of the mesh."""
    obj = bpy.data.objects.new("leafcloud tints", mesh)
    scene.collection.objects.link(obj)
    scene.cycles.samples = 1
    [layer] = scene.view_layers
    layer.update()
    chosen = {"object": obj, "active_object": obj, "selected_objects": [obj], "selected_editable_objects": [obj]}
    obj.select_set(True, view_layer=layer)
    layer.objects.active = obj
    with bpy.context.temp_override(scene=scene, view_layer=layer, **chosen):
        bpy.ops.object.bake(type="EMIT", target="VERTEX_COLORS")
    colors = np.empty(4 * len(mesh.loops), np.float32)
    mesh.color_attributes["leafcloud tints"].data.foreach_get("color", colors)
    return colors.reshape(-1, 4)[:, :3]
