"""Material descriptions for the core: factors, images, alpha mode."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Literal, TypedDict

import bpy
import numpy as np
from numpy.typing import NDArray

from ..mesh.extract import Geometry, world_positions
from .flatten import USUAL_LOOK, Flattened, Look, flatten
from .images import Pixels, as_bytes, check_readable, decoded, encoded, pixels_of, resized
from .losses import losses
from .node_links import shown_nodes
from .products import Rgb
from .rendered_shading import Rendering, render_gloss, render_normals, unit_sizes
from .shader_sums import Light
from .shading import Shading, read_shading
from .surface import Surface, read_surface
from .textures import Texture, uv_maps
from .tints import Islands, are_tints, is_tint, nearest_tints, typical_looks
from .translucency import Translucency, read_translucency

_SEEN = 1.0 / 512.0
"""Tints closer to white than this are dropped."""

_FEW = 0.01
"""Share of a material's texels that may be clipped without a warning."""

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""Weights for linear Rec. 709 colors. Blender uses them to convert a color to a value."""


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
    gloss: Pixels | None
    translucency: Rgb
    translucency_image: Pixels | None


@dataclass(frozen=True)
class Described:
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


def describe_material(
    material: bpy.types.Material | None, channels: Collection[str] = (), share: float = 0.0
) -> tuple[MaterialDescription, list[str]]:
    """Return a material's description for the core, and a sentence for each feature that could not be read.

    `channels`: the channels to describe, out of "normals" and "gloss" (roughness and metallic). Without them the leaf
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
) -> Described:
    """Describe all materials of a geometry, and the tints of single leaves.

    `channels` and `share` as in `describe_material`. `matrix`: (4, 4) the geometry's world matrix; `None` is the
    identity. Raises `SceneError` as `describe_material`.
    """
    world = np.eye(4) if matrix is None else matrix
    sizes = _unit_sizes(geometry, world)
    described = [
        _described(material, channels, share, partial(sizes, number))
        for number, material in enumerate(geometry.materials)
    ]
    materials, owners = [description for description, _, _ in described], list(range(len(described)))
    messages = [message for _, messages, _ in described for message in messages]
    material_ids = geometry.material_ids.copy()
    sides: NDArray[np.float32] | None = None
    for number, (material, (_, _, flat)) in enumerate(zip(geometry.materials, described, strict=True)):
        chosen = geometry.material_ids == number
        if material is None or flat is None or not (flat.varies or flat.by_side) or not chosen.any():
            continue
        randoms = np.full(len(chosen), 0.5, np.float32) if geometry.randoms is None else geometry.randoms
        places = world_positions(geometry, world).astype(np.float32)
        leaves = Islands(places, geometry.triangles[chosen], randoms[chosen])
        looks, said = _looks(material, flat, leaves)
        messages += said
        rendered = [described[number]]
        if looks != [USUAL_LOOK]:
            rendered = [_described(material, (), share, partial(sizes, number), look) for look in looks]
            for description, _, _ in rendered:
                _share_shading(materials[number], description)
        materials[number], *more = [description for description, _, _ in rendered]
        ids = np.array([number, *range(len(materials), len(materials) + len(more))], np.int32)
        materials += more
        owners += [number] * len(more)
        flats = [each for _, _, each in rendered if each is not None]
        found = nearest_tints(material, flats, leaves)
        material_ids[chosen] = ids[found.which]
        factors = np.stack([found.front, found.back])
        if np.abs(factors - 1.0).max() >= _SEEN:
            sides = np.ones((2, len(chosen), 3, 3), np.float32) if sides is None else sides
            sides[:, chosen] *= factors
    front, back = _tinted(geometry.colors, sides)
    return Described(materials, front, back, messages, material_ids, tuple(owners))


def _tinted(
    colors: NDArray[np.float32] | None, sides: NDArray[np.float32] | None
) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """Return the corner colors of fronts (t, 3, 4) and backs (t, 3, 3), from colors (t, 3, 4) and tints (2, t, 3, 3).

    The backs are `None` if they equal the fronts.
    """
    if sides is None:
        return colors, None
    front, back = sides
    tinted = np.ones((*front.shape[:2], 4), np.float32) if colors is None else colors.copy()
    tinted[..., :3] *= front
    if np.abs(back - front).max(initial=0.0) < _SEEN:
        return tinted, None
    return tinted, back if colors is None else back * colors[..., :3]


def _share_shading(of: MaterialDescription, description: MaterialDescription) -> None:
    """Copy roughness, metallic and normals from the description `of` to another."""
    description["normal"], description["gloss"] = of["normal"], of["gloss"]
    description["roughness"], description["metallic"] = of["roughness"], of["metallic"]


def _looks(material: bpy.types.Material, flat: Flattened, leaves: Islands) -> tuple[list[Look], list[str]]:
    """Return the looks to render a material for, and messages. Tints cover the remaining variation."""
    flat, said = _between_sides(material, flat)
    if not flat.varies or are_tints(material, flat, leaves):
        return [flat.look], said
    if not flat.by_random:
        return [flat.look], [
            *said,
            f"material {material.name!r}: islands or positions change its leaves by more than a tint, and only the "
            f"tint is kept; vary them by Object Info > Random, which is rendered for several values",
        ]
    looks, count = typical_looks(leaves, flat.look.side), len(np.unique(leaves.randoms))
    side = min(looks[0].largest, len(flat.pixels))
    return looks, [
        *said,
        f"material {material.name!r}: Object Info > Random changes its leaves by more than a tint, so it is rendered "
        f"for {len(looks)} of {count} random numbers, to images of {side} × {side} texels",
    ]


def _between_sides(material: bpy.types.Material, front: Flattened) -> tuple[Flattened, list[str]]:
    """Return a rendering that both sides of the leaves are tints of, and messages.

    Tries the front, then a rendering halfway between front and back. If both fail, returns the front and a warning.
    """
    if not front.by_side:
        return front, []
    back = flatten(material, front.light, replace(front.look, side=1.0))
    if is_tint(back, front):
        return front, []
    between = flatten(material, front.light, replace(front.look, side=0.5))
    if is_tint(back, between) and is_tint(front, between):
        return between, []
    said = f"material {material.name!r}: its back is more than a tint of its front, and only the tint is kept"
    return front, [f"{said}; give both sides the same pattern"]


def _unit_sizes(geometry: Geometry, matrix: NDArray[np.float64]) -> Callable[[int], float | None]:
    """Return a function that gives the world size of one UV unit on a material's leaves, computed on first use."""
    if geometry.uvs is None:
        return lambda _: None
    known = cache(lambda: unit_sizes(geometry, matrix))
    return lambda number: float(known()[number])


def _described(
    material: bpy.types.Material | None,
    channels: Collection[str],
    share: float,
    size: Callable[[], float | None],
    look: Look = USUAL_LOOK,
) -> tuple[MaterialDescription, list[str], Flattened | None]:
    """Return a material's description, messages, and its rendering if it had to be rendered.

    `size` returns the world size of one UV unit on the leaves; `None` if they have no UV map.
    """
    surface = read_surface(material)
    through = read_translucency(material, surface) if share > 0.0 else Translucency()
    description = MaterialDescription(
        name=surface.name,
        base_color=(*surface.color, surface.alpha),
        image=_image(surface),
        alpha_mode=surface.alpha_mode,
        alpha_cutoff=surface.alpha_cutoff,
        double_sided=surface.double_sided,
        normal=None,
        roughness=1.0,
        metallic=0.0,
        gloss=None,
        translucency=(0.0, 0.0, 0.0),
        translucency_image=None,
    )
    # The surface warns that it reads only part of a mix of shaders; with translucency all of the mix is read.
    messages = [] if through.share > 0.0 else list(surface.warnings)
    messages += [] if material is None else losses(material)
    flat = None
    shown = replace(surface, gaps=(through.gap,), layout=through.texture) if through.gap else surface
    if shown.gaps and material is not None:
        flat, said = _flat(material, shown, "reflected" if through.share > 0.0 else "all", look)
        messages.append(said)
        if flat is not None:
            description.update(_of_rendering(flat.pixels))  # type: ignore[typeddict-item]  # some of its keys
        if not surface.gaps:
            description["alpha_mode"] = surface.alpha_mode  # read from the nodes
    if through.share > 0.0:
        assert material is not None  # a missing material counts as opaque
        messages += _part_light(description, material, through, share, look)
    if material is not None and channels:
        messages += _shade(description, material, read_shading(material, surface.texture), channels, size)
    return description, messages, flat


def _shade(
    description: MaterialDescription,
    material: bpy.types.Material,
    shading: Shading,
    channels: Collection[str],
    size: Callable[[], float | None],
) -> list[str]:
    """Describe roughness, metallic and normals if `channels` asks for them. Return messages about renderings."""
    messages = []
    if "gloss" in channels:
        description["gloss"], said = _data(material, shading.gloss, render_gloss, size)
        messages += said
        if shading.gloss is None or description["gloss"] is not None:
            description |= {"roughness": shading.roughness, "metallic": shading.metallic}
    if "normals" in channels:
        description["normal"], said = _data(material, shading.normal, render_normals, size)
        messages += said
    return messages


class _Flat(TypedDict, total=False):
    """The keys of `MaterialDescription` that a rendering sets."""

    base_color: tuple[float, float, float, float]
    image: Pixels
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"]
    alpha_cutoff: float


def _flat(material: bpy.types.Material, surface: Surface, light: Light, look: Look) -> tuple[Flattened | None, str]:
    """Return the material as Cycles renders it, `None` if it cannot be rendered, and a message."""
    said = f"material {surface.name!r}: {' and '.join(surface.gaps)}"
    if surface.layout is None:
        shown = ", ".join(f"{value:.3g}" for value in (*surface.color, surface.alpha))
        return None, (
            f"{said}; the viewport display color ({shown}) replaces it. Connect an Image Texture to a Principled "
            f"BSDF, or set the viewport color"
        )
    for node in shown_nodes(material.node_tree):
        if node.type == "TEX_IMAGE":
            check_readable(node.image, surface.name)
    flat = flatten(material, light, look)
    said = f"{said}; it is rendered to an image of {len(flat.pixels)} × {len(flat.pixels)} texels"
    maps = sorted(uv_maps(shown_nodes(material.node_tree)))
    if len(maps) > 1:
        named = " and ".join(repr(name) if name else "the active one" for name in maps)
        laid = repr(surface.layout.uv_map) if surface.layout.uv_map else "the active one"
        said += f", as if its UV maps ({named}) were all {laid}"
    # A color attribute that was read multiplies the rendering through `Geometry.colors`.
    lost = [name for name in flat.lost if surface.color_attribute is None or "Attribute" not in name]
    if lost:
        said += f", so per-leaf variation from {' and '.join(lost)} is dropped"
    alike = ", the same for all leaves" if flat.varies else ""
    return flat, f"{said}; glTF level 0 uses Blender's own material export{alike}"


def _of_rendering(pixels: NDArray[np.float32]) -> _Flat:
    mode = _alpha_mode(pixels[..., 3:])
    return {"base_color": (1.0, 1.0, 1.0, 1.0), "image": _straight(pixels), "alpha_mode": mode, "alpha_cutoff": 0.5}


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


def opacity_of(surface: Surface) -> NDArray[np.float64]:
    """Return (h, w) a surface's alpha times that of its image; (1, 1) without an image.

    Raises `SceneError` for a missing image.
    """
    image = _image(surface)
    return surface.alpha * (np.ones((1, 1)) if image is None else image[..., 3] / 255.0)


def _part_light(
    description: MaterialDescription, material: bpy.types.Material, through: Translucency, share: float, look: Look
) -> list[str]:
    """Split a material's light into reflected and transmitted by the tree's `share`. Return warnings about clipping.

    See `translucency` for the formula.
    """
    red, green, blue, alpha = description["base_color"]
    reflected = _brightened((red, green, blue), description["image"], through.reflected / (1.0 - share))
    shining = _brightened(through.color, _translucency_image(material, through.texture, look), 1.0 / share)
    description["base_color"], description["image"] = (*reflected.factor, alpha), reflected.image
    description["translucency"], description["translucency_image"] = shining.factor, shining.image
    limits = [(reflected.cut, "reflects", 1.0 - share), (shining.cut, "transmits", share)]
    return [
        f"material {material.name!r} {does} more than {limit:.0%} of the light, the limit set by the tree's most "
        f"translucent leaves: its brightest colors are clipped there; give it darker ones"
        for cut, does, limit in limits
        if cut
    ]


def _translucency_image(material: bpy.types.Material, texture: Texture | None, look: Look) -> Pixels | None:
    if texture is None:
        return None
    if texture.image is None:
        return _straight(flatten(material, "transmitted", look).pixels)
    return pixels_of(texture.image, material.name)


@dataclass(frozen=True)
class _Brightened:
    factor: Rgb
    image: Pixels | None
    cut: bool
    """Whether more than `_FEW` of the texels were clipped at 1."""


def _brightened(factor: Rgb, image: Pixels | None, by: float) -> _Brightened:
    """Brighten factor · image. Neither may exceed 1, so the excess of the factor goes into the image."""
    red, green, blue = (by * part for part in factor)
    most = max(red, green, blue)
    if most <= 1.0 + 1e-6 or image is None:
        return _Brightened((min(red, 1.0), min(green, 1.0), min(blue, 1.0)), image, most > 1.0 + 1e-6)
    rest = (red / most, green / most, blue / most)
    color, alpha = most * decoded(image[..., :3].astype(np.float32) / 255.0), image[..., 3:]
    drawn = alpha[..., 0] > 0
    cut = bool((color[drawn] * rest > 1.0).any(axis=1).mean() > _FEW) if drawn.any() else False
    return _Brightened(rest, np.concatenate([as_bytes(encoded(color)), alpha], axis=2), cut)


def _data(
    material: bpy.types.Material,
    texture: Texture | None,
    render: Callable[[bpy.types.Material, Texture, float], Rendering],
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
    rendering = render(material, texture, unit)
    return rendering.pixels, [rendering.said]


def _image(surface: Surface) -> Pixels | None:
    """Return (h, w, 4) the colors of one image with the alpha of the same or another; `None` without images.

    A missing color is white, a missing alpha opaque. The result has the larger size of both, so that a mask keeps its
    detail over a small palette.
    """
    color, alpha = surface.color_texture, surface.alpha_texture
    if color is None and alpha is None:
        return None
    pixels = {
        texture.image: pixels_of(texture.image, surface.name) for texture in (color, alpha) if texture is not None
    }
    opacity = None if alpha is None else _opacity(pixels[alpha.image], alpha, surface.alpha_channel)
    if color is not None:
        result = pixels[color.image].copy()
    else:
        assert opacity is not None  # one of both textures exists
        result = np.full((*opacity.shape, 4), 255, np.uint8)
    if opacity is not None:
        height, width = (max(sides) for sides in zip(result.shape[:2], opacity.shape, strict=True))
        result, opacity = resized(result, height, width), resized(opacity[..., None], height, width)[..., 0]
    result[..., 3] = 255 if opacity is None else opacity
    return result


def _opacity(pixels: Pixels, texture: Texture, channel: Literal["alpha", "luminance"]) -> Pixels:
    """Return (h, w) the alpha from a channel of an image."""
    if channel == "alpha":
        return pixels[..., 3]
    values = pixels[..., :3].astype(np.float32) / 255.0
    return as_bytes(decoded(values) @ _LUMINANCE)
