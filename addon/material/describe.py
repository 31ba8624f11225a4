"""Material descriptions for the core: factors, images, alpha mode, and the colors of single leaves."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, TypedDict

import bpy
import numpy as np
from numpy.typing import NDArray

from ..geometry import Geometry, world_positions
from .flatten import USUAL_SETTINGS, Flattened, RenderSettings, flatten
from .images import Pixels, as_bytes, brightened, check_images, encoded, image_of, pixels_of
from .losses import lit_with_others, losses
from .node_links import shown_nodes
from .shading import read_shading, render_normals, render_orm
from .surface import Rgb, Surface, read_surface
from .textures import Texture, transform_matrix, uv_maps
from .tints import Islands, nearest_tints, settings_of
from .translucency import MaterialTranslucency, read_translucency

_SEEN = 1.0 / 512.0
"""Tints closer to white than this are dropped."""


class MaterialDescription(TypedDict):
    """Keyword arguments of `leafcloud.Material`."""

    name: str
    base_color: tuple[float, float, float, float]
    image: Pixels | None
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"]
    alpha_cutoff: float
    double_sided: bool
    normal: Pixels | None
    roughness: float
    metallic: float
    orm: Pixels | None
    translucency: Rgb
    translucency_image: Pixels | None


@dataclass(frozen=True)
class Descriptions:
    """Descriptions of a geometry's materials.

    materials: one per material of the geometry, in its order, then further renderings of the same materials.
    colors: (t, 3, 4) linear factors by corner; `None` for white.
    back_colors: (t, 3, 3) the factors of the back; `None` if they equal `colors`.
    material_ids: (t,) indices into `materials`.
    owners: the index in the geometry's materials of each of `materials`.
    """

    materials: list[MaterialDescription]
    colors: NDArray[np.float32] | None
    back_colors: NDArray[np.float32] | None
    messages: list[str]
    material_ids: NDArray[np.int32]
    owners: tuple[int, ...]


_Described = tuple[MaterialDescription, list[str], Flattened | None]
"""A material's description, messages, and its rendering if it had to be rendered."""


def describe_material(
    material: bpy.types.Material | None, channels: Collection[str] = (), share: float = 0.0
) -> tuple[MaterialDescription, list[str]]:
    """Return a material's description for the core, and a sentence for each feature that could not be read.

    `channels`: the channels to describe, out of "normals" and "orm" (roughness and metallic). Without them the leaf
    gets flat normals, roughness 1 and metallic 0. `share`: the share of light that passes through the tree's leaves
    (see `translucency`); 0 for opaque leaves.

    `base_color` is linear. `image` is (h, w, 4) sRGB with straight alpha, row 0 on top; `None` without an image.
    A color attribute that multiplies them is in `Geometry.colors`.
    Raises `SceneError` when an image has no pixels because its file is missing or cannot be read.
    """
    description, messages, _ = _described(material, channels, share, lambda: 1.0)
    return description, messages


def describe_materials(
    geometry: Geometry,
    channels: Collection[str] = (),
    matrix: NDArray[np.float64] | None = None,
    share: float = 0.0,
) -> Descriptions:
    """Describe all materials of a geometry, and the tints of single leaves.

    `channels` and `share` as in `describe_material`. `matrix`: (4, 4) the geometry's world matrix; `None` is the
    identity. Raises `SceneError` as `describe_material`.
    """
    world = np.eye(4) if matrix is None else matrix
    sizes = cache(lambda: unit_sizes(geometry, world))

    def described(number: int, channels: Collection[str], settings: RenderSettings = USUAL_SETTINGS) -> _Described:
        def size() -> float | None:
            return None if geometry.uvs is None else float(sizes()[number])

        return _described(geometry.materials[number], channels, share, size, settings)

    first = [described(number, channels) for number in range(len(geometry.materials))]
    materials, owners = [description for description, _, _ in first], list(range(len(first)))
    messages = [*(message for _, messages, _ in first for message in messages), *lit_with_others(geometry.materials)]
    material_ids = geometry.material_ids.copy()
    sides = np.ones((2, len(material_ids), 3, 3), np.float32)
    for number, (description, _, flat) in enumerate(first):
        chosen = geometry.material_ids == number
        if flat is None or not (flat.varies or flat.by_side) or not chosen.any():
            continue
        leaves = Islands.of_geometry(geometry, world).of(chosen)
        choices, said = settings_of(flat, leaves)
        messages += said
        flats = [flat]
        if choices != [USUAL_SETTINGS]:
            rendered = [described(number, (), settings) for settings in choices]
            flats = [each for _, _, each in rendered if each is not None]
            more = [each | _shading_of(description) for each, _, _ in rendered]
            materials[number], materials[len(materials) :] = more[0], more[1:]
            owners += [number] * (len(more) - 1)
        found = nearest_tints(flats, leaves)
        ids = np.array([number, *range(len(materials) - len(flats) + 1, len(materials))], np.int32)
        material_ids[chosen] = ids[found.which]
        sides[:, chosen] = found.front, found.back
    front, back = _tinted(geometry.colors, sides)
    return Descriptions(materials, front, back, messages, material_ids, tuple(owners))


def _shading_of(description: MaterialDescription) -> MaterialDescription:
    """Return roughness, metallic and normals of a description."""
    keys = ("normal", "orm", "roughness", "metallic")
    return {key: description[key] for key in keys}  # type: ignore[literal-required, return-value]  # some of its keys


def _tinted(
    colors: NDArray[np.float32] | None, sides: NDArray[np.float32]
) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """Return the corner colors of fronts (t, 3, 4) and backs (t, 3, 3), from colors (t, 3, 4) and tints (2, t, 3, 3).

    The backs are `None` if they equal the fronts.
    """
    front, back = sides
    if np.abs(sides - 1.0).max(initial=0.0) < _SEEN:
        return colors, None
    tinted = np.ones((*front.shape[:2], 4), np.float32) if colors is None else colors.copy()
    tinted[..., :3] *= front
    if np.abs(back - front).max(initial=0.0) < _SEEN:
        return tinted, None
    return tinted, back if colors is None else back * colors[..., :3]


def texture_uvs(geometry: Geometry) -> NDArray[np.float32] | None:
    """Return (t, 3, 2) the coordinates of image lookups: `uvs` transformed by the materials' Mapping nodes."""
    if geometry.uvs is None:
        return None
    transforms = np.array([transform_matrix(read_surface(material).texture) for material in geometry.materials])
    if (transforms == np.eye(2, 3)).all():
        return geometry.uvs
    of_triangle = transforms[geometry.material_ids]
    moved = np.einsum("tij,tcj->tci", of_triangle[:, :, :2], geometry.uvs) + of_triangle[:, None, :, 2]
    return moved.astype(np.float32)


def unit_sizes(geometry: Geometry, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (materials,) the mean world size of one UV unit by material; 1 for a material without area or UV area."""
    count = len(geometry.materials)
    uvs = texture_uvs(geometry)
    if uvs is None:
        return np.ones(count)
    corners = world_positions(geometry, matrix)[geometry.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    (u1, v1), (u2, v2) = ((uvs[:, i] - uvs[:, 0]).T.astype(np.float64) for i in (1, 2))
    of_materials, of_uvs = (
        np.bincount(geometry.material_ids, weights, count) for weights in (area, np.abs(u1 * v2 - u2 * v1))
    )
    known = (of_materials > 0.0) & (of_uvs > 0.0)
    return np.sqrt(np.divide(of_materials, of_uvs, out=np.ones(count), where=known))


def _described(
    material: bpy.types.Material | None,
    channels: Collection[str],
    share: float,
    size: Callable[[], float | None],
    settings: RenderSettings = USUAL_SETTINGS,
) -> _Described:
    """Describe a material. `size` returns the world size of one UV unit on the leaves; `None` without a UV map."""
    surface = read_surface(material)
    through = read_translucency(material, surface) if share > 0.0 else MaterialTranslucency()
    description = MaterialDescription(
        name=surface.name,
        base_color=(*surface.color, surface.alpha),
        image=image_of(surface),
        alpha_mode=surface.alpha_mode,
        alpha_cutoff=surface.alpha_cutoff,
        double_sided=surface.double_sided,
        normal=None,
        roughness=1.0,
        metallic=0.0,
        orm=None,
        translucency=(0.0, 0.0, 0.0),
        translucency_image=None,
    )
    if material is None:
        return description, [], None
    # The surface warns that it reads only part of a mix of shaders; with translucency all of the mix is read.
    messages = [*(() if through.share > 0.0 else surface.warnings), *losses(material)]
    flat = None
    shown = replace(surface, gaps=(through.gap,), layout=through.texture) if through.gap else surface
    if shown.gaps and shown.layout is None:
        messages.append(_viewport_message(shown))
    elif shown.gaps:
        check_images(shown_nodes(material.node_tree), material.name)
        flat = flatten(material, "reflected" if through.share > 0.0 else "all", settings)
        messages.append(_rendering_message(shown, flat))
        mode = _alpha_mode(flat.pixels[..., 3:]) if surface.gaps else surface.alpha_mode
        description |= {"base_color": (1.0,) * 4, "image": _straight(flat.pixels), "alpha_mode": mode}
        description["alpha_cutoff"] = 0.5
    if through.share > 0.0:
        messages += _part_light(description, material, through, share, settings)
    messages += _shade(description, material, surface.texture, channels, size)
    return description, messages, flat


def _shade(
    description: MaterialDescription,
    material: bpy.types.Material,
    colors: Texture | None,
    channels: Collection[str],
    size: Callable[[], float | None],
) -> list[str]:
    """Describe roughness, metallic and normals if `channels` asks for them. Return messages about renderings."""
    shading, messages = read_shading(material, colors) if channels else None, list[str]()
    if shading is not None and "orm" in channels:
        description["orm"], messages = _data(material, shading.orm, render_orm, size)
        if shading.orm is None or description["orm"] is not None:
            description |= {"roughness": shading.roughness, "metallic": shading.metallic}
    if shading is not None and "normals" in channels:
        description["normal"], said = _data(material, shading.normal, render_normals, size)
        messages += said
    return messages


def _data(
    material: bpy.types.Material,
    texture: Texture | None,
    render: Callable[[bpy.types.Material, Texture, float], tuple[Pixels, str]],
    size: Callable[[], float | None],
) -> tuple[Pixels | None, list[str]]:
    """Return (h, w, 4) the 8-bit values of a data texture, rendered if it has no image, and messages."""
    if texture is None:
        return None, []
    if texture.image is not None:
        return pixels_of(texture.image, material.name, data=True), []
    unit = size()
    if unit is None:
        said = f"material {material.name!r}: its roughness, metallic or normals have to be rendered over a UV map, and"
        return None, [
            f"{said} its leaves have none; roughness 1, metallic 0 and mesh normals are used; unwrap the leaves"
        ]
    pixels, said = render(material, texture, unit)
    return pixels, [said]


def _viewport_message(surface: Surface) -> str:
    shown = ", ".join(f"{value:.3g}" for value in (*surface.color, surface.alpha))
    return (
        f"material {surface.name!r}: {' and '.join(surface.gaps)}; the viewport display color ({shown}) replaces it. "
        f"Connect an Image Texture to a Principled BSDF, or set the viewport color"
    )


def _rendering_message(surface: Surface, flat: Flattened) -> str:
    side, maps = len(flat.pixels), sorted(uv_maps(shown_nodes(flat.material.node_tree)))
    said = (
        f"material {surface.name!r}: {' and '.join(surface.gaps)}; it is rendered to an image of {side} × {side} texels"
    )
    if len(maps) > 1 and surface.layout is not None:
        named = " and ".join(repr(name) if name else "the active one" for name in maps)
        laid = repr(surface.layout.uv_map) if surface.layout.uv_map else "the active one"
        said += f", as if its UV maps ({named}) were all {laid}"
    # A color attribute that was read multiplies the rendering through `Geometry.colors`.
    lost = [name for name in flat.lost if surface.color_attribute is None or "Attribute" not in name]
    if lost:
        said += f", so per-leaf variation from {' and '.join(lost)} is dropped"
    alike = ", the same for all leaves" if flat.varies else ""
    return f"{said}; glTF level 0 uses Blender's own material export{alike}"


def _straight(pixels: NDArray[np.float32]) -> Pixels:
    """Convert a linear premultiplied rendering to sRGB with straight alpha."""
    alpha = pixels[..., 3:]
    color = np.divide(pixels[..., :3], alpha, out=np.zeros_like(pixels[..., :3]), where=alpha > 1e-4)
    return as_bytes(np.concatenate([encoded(color), alpha], axis=2))


def _alpha_mode(alpha: NDArray[np.float32]) -> Literal["OPAQUE", "MASK", "BLEND"]:
    """Return the alpha mode of a rendered alpha: a mask if few texels are between transparent and opaque."""
    if alpha.min() > 0.999:
        return "OPAQUE"
    between = np.mean((alpha > 0.1) & (alpha < 0.9))
    covered = np.mean(alpha >= 0.9)
    return "MASK" if between <= covered else "BLEND"


def _part_light(
    description: MaterialDescription,
    material: bpy.types.Material,
    through: MaterialTranslucency,
    share: float,
    settings: RenderSettings,
) -> list[str]:
    """Split a material's light into reflected and transmitted by the tree's `share`. Return warnings about clipping.

    See `translucency` for the formula.
    """
    *color, alpha = description["base_color"]
    shining = None
    if through.texture is not None and through.texture.image is None:
        shining = _straight(flatten(material, "transmitted", settings).pixels)
    elif through.texture is not None:
        shining = pixels_of(through.texture.image, material.name)
    factor, description["image"], dark = brightened(color, description["image"], through.reflected / (1.0 - share))
    description["base_color"] = (*factor, alpha)
    description["translucency"], description["translucency_image"], dim = brightened(
        through.color, shining, 1.0 / share
    )
    limits = [(dark, "reflects", 1.0 - share), (dim, "transmits", share)]
    return [
        f"material {material.name!r} {does} more than {limit:.0%} of the light, the limit set by the tree's most "
        f"translucent leaves: its brightest colors are clipped there; give it darker ones"
        for cut, does, limit in limits
        if cut
    ]
