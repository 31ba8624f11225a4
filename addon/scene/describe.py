"""Materials as the core takes them: factors, one image, how alpha counts."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Literal, TypedDict

import bpy
import numpy as np
from numpy.typing import NDArray

from .extract import Geometry, world_positions
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
"""Tints that differ less from white tell no leaves apart."""

_FEW = 0.01
"""Of a material's texels: so many may be cut without a word."""

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""Of linear Rec. 709 colours, which is what Blender turns a colour into where a value is wanted."""


class MaterialDescription(TypedDict):
    """The keywords of `leafcloud.Material`."""

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
    """materials: by their number in the geometry, and behind those further looks of them. colors: (t, 3, 4) linear
    factors by corner, `None` for white; back_colors: (t, 3, 3) in their place on the back, `None` for the same.
    material_ids: (t,) into `materials`, whose numbers in the geometry are `owners`.
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
    """A material in the words of the core, and a sentence for each thing that could not be read.

    `channels` out of "normals" and "gloss" are described, too; without them a leaf is smooth and rough. `share`: of the
    light that shines through the tree's leaves (see `translucency`); where it is 0 they are opaque.

    `base_color` is linear; `image` is (h, w, 4) sRGB with straight alpha, row 0 on top, `None` where no image counts.
    A colour attribute that multiplies them is not here but in `Geometry.colors`.
    Raises `SceneError` when an image has no pixels, because its file is missing or cannot be read.
    """
    description, messages, _ = _described(material, channels, share, lambda: 1.0)
    return description, messages


def describe_materials(
    geometry: Geometry,
    channels: Collection[str] = (),
    matrix: NDArray[np.float64] | None = None,
    share: float = 0.0,
) -> Described:
    """All materials of a geometry, and what tells its leaves apart, which `matrix` carries to the world.

    `channels` and `share` as in `describe_material`. Raises `SceneError` as `describe_material`.
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
    """The colours of both sides by corner, of colours (t, 3, 4) and tints (2, t, 3, 3) of either; `None` of backs
    that are as the fronts."""
    if sides is None:
        return colors, None
    front, back = sides
    tinted = np.ones((*front.shape[:2], 4), np.float32) if colors is None else colors.copy()
    tinted[..., :3] *= front
    if np.abs(back - front).max(initial=0.0) < _SEEN:
        return tinted, None
    return tinted, back if colors is None else back * colors[..., :3]


def _share_shading(of: MaterialDescription, description: MaterialDescription) -> None:
    """Gives a description the gloss and the normals of another."""
    description["normal"], description["gloss"] = of["normal"], of["gloss"]
    description["roughness"], description["metallic"] = of["roughness"], of["metallic"]


def _looks(material: bpy.types.Material, flat: Flattened, leaves: Islands) -> tuple[list[Look], list[str]]:
    """The looks for which a material is to be rendered so that tints say the rest, and what there is to say of it."""
    flat, said = _between_sides(material, flat)
    if not flat.varies or are_tints(material, flat, leaves):
        return [flat.look], said
    if not flat.by_random:
        return [flat.look], [
            *said,
            f"material {material.name!r}: islands or places make more of its leaves than a tint, which is all that is "
            f"kept of it; let Object Info > Random tell them apart, for it is rendered for several random numbers",
        ]
    looks, count = typical_looks(leaves, flat.look.side), len(np.unique(leaves.randoms))
    side = min(looks[0].largest, len(flat.pixels))
    return looks, [
        *said,
        f"material {material.name!r}: Object Info > Random makes more of its leaves than a tint, so it is rendered for "
        f"{len(looks)} of {count} random numbers, to images of {side} texels a side",
    ]


def _between_sides(material: bpy.types.Material, front: Flattened) -> tuple[Flattened, list[str]]:
    """A rendering of which both sides of the leaves are tints: that of the front, if it is one, or of what lies between
    them; and what there is to say where neither is."""
    if not front.by_side:
        return front, []
    back = flatten(material, front.light, replace(front.look, side=1.0))
    if is_tint(back, front):
        return front, []
    between = flatten(material, front.light, replace(front.look, side=0.5))
    if is_tint(back, between) and is_tint(front, between):
        return between, []
    said = f"material {material.name!r}: its back is more than a tint of its front, which is all that is kept of it"
    return front, [f"{said}; give both sides the same pattern"]


def _unit_sizes(geometry: Geometry, matrix: NDArray[np.float64]) -> Callable[[int], float | None]:
    """How long a unit of texture coordinates is on a material's leaves, which is found out once somebody asks."""
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
    """What it is, what there is to say of it, and its rendering where there is one.

    `size`: how long one unit of texture coordinates is on the leaves, `None` where they have none.
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
    # A mix whose translucency is read is read whole.
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
            description["alpha_mode"] = surface.alpha_mode  # which is understood
    if through.share > 0.0:
        assert material is not None  # which is opaque
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
    """Describes gloss and normals as far as the channels ask for them, and says what is rendered."""
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
    """What a rendering of a material says."""

    base_color: tuple[float, float, float, float]
    image: Pixels
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"]
    alpha_cutoff: float


def _flat(material: bpy.types.Material, surface: Surface, light: Light, look: Look) -> tuple[Flattened | None, str]:
    """The material as Cycles renders it, if it can, and what there is to say of it."""
    said = f"material {surface.name!r}: {' and '.join(surface.gaps)}"
    if surface.layout is None:
        shown = ", ".join(f"{value:.3g}" for value in (*surface.color, surface.alpha))
        return None, (
            f"{said}; the viewport display colour ({shown}) stands for it. Connect an Image Texture to a Principled "
            f"BSDF, or set the viewport colour"
        )
    for node in shown_nodes(material.node_tree):
        if node.type == "TEX_IMAGE":
            check_readable(node.image, surface.name)
    flat = flatten(material, light, look)
    said = f"{said}; it is rendered to an image of {len(flat.pixels)} texels a side"
    maps = sorted(uv_maps(shown_nodes(material.node_tree)))
    if len(maps) > 1:
        named = " and ".join(repr(name) if name else "the active one" for name in maps)
        laid = repr(surface.layout.uv_map) if surface.layout.uv_map else "the active one"
        said += f", as if its UV maps ({named}) were all {laid}"
    # A colour attribute that was understood multiplies the rendering as it multiplies the rest.
    lost = [name for name in flat.lost if surface.color_attribute is None or "Attribute" not in name]
    if lost:
        said += f", so what the nodes {' and '.join(lost)} say of single leaves is lost"
    alike = ", alike for all leaves" if flat.varies else ""
    return flat, f"{said}; the leaves' own material in glTF is what Blender's exporter reads of it{alike}"


def _of_rendering(pixels: NDArray[np.float32]) -> _Flat:
    mode = _alpha_mode(pixels[..., 3:])
    return {"base_color": (1.0, 1.0, 1.0, 1.0), "image": _straight(pixels), "alpha_mode": mode, "alpha_cutoff": 0.5}


def _straight(pixels: NDArray[np.float32]) -> Pixels:
    """A rendering in sRGB with straight alpha."""
    alpha = pixels[..., 3:]
    color = np.divide(pixels[..., :3], alpha, out=np.zeros_like(pixels[..., :3]), where=alpha > 1e-4)
    return as_bytes(np.concatenate([encoded(color), alpha], axis=2))


def _alpha_mode(alpha: NDArray[np.float32]) -> Literal["OPAQUE", "MASK", "BLEND"]:
    """How a rendered alpha counts: as a mask where it has edges, but hardly anything between."""
    if alpha.min() > 0.999:
        return "OPAQUE"
    between = np.mean((alpha > 0.1) & (alpha < 0.9))
    covered = np.mean(alpha >= 0.9)
    return "MASK" if between <= covered else "BLEND"


def opacity_of(surface: Surface) -> NDArray[np.float64]:
    """(h, w) what a surface's alpha and its image make of it; (1, 1) without an image. Raises `SceneError` for one that
    is missing."""
    image = _image(surface)
    return surface.alpha * (np.ones((1, 1)) if image is None else image[..., 3] / 255.0)


def _part_light(
    description: MaterialDescription, material: bpy.types.Material, through: Translucency, share: float, look: Look
) -> list[str]:
    """Parts the light of a translucent material by the `share` of the tree's leaves, and says what has no room.

    See `translucency` for the form.
    """
    red, green, blue, alpha = description["base_color"]
    reflected = _brightened((red, green, blue), description["image"], through.reflected / (1.0 - share))
    shining = _brightened(through.color, _translucency_image(material, through.texture, look), 1.0 / share)
    description["base_color"], description["image"] = (*reflected.factor, alpha), reflected.image
    description["translucency"], description["translucency_image"] = shining.factor, shining.image
    limits = [(reflected.cut, "reflects", 1.0 - share), (shining.cut, "lets through", share)]
    return [
        f"material {material.name!r} {does} more than {limit:.0%} of the light, which is all that fits the most "
        f"translucent leaves of the tree: its brightest colours are cut there; give it darker ones"
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
    """Whether more than a few of its colours would be brighter than 1."""


def _brightened(factor: Rgb, image: Pixels | None, by: float) -> _Brightened:
    """factor · image, brighter: neither may be greater than 1, so what is too much for the one goes into the other."""
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
    """(h, w, 4) the codes of an image that holds data, no colours, rendered where there is none; and what to say."""
    if texture is None:
        return None, []
    if texture.image is not None:
        return pixels_of(texture.image, material.name, data=True), []
    unit = size()
    if unit is None:
        said = f"material {material.name!r}: its gloss or normals have to be rendered over a UV map, and its leaves"
        return None, [f"{said} have none; rough and smooth stands for it, unwrap the leaves"]
    rendering = render(material, texture, unit)
    return rendering.pixels, [rendering.said]


def _image(surface: Surface) -> Pixels | None:
    """The colours of one image and the alpha of the same or another, white or opaque where there is none.

    As large as the larger of both: a mask keeps its detail over a palette.
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
        assert opacity is not None  # there is one for colour or for alpha
        result = np.full((*opacity.shape, 4), 255, np.uint8)
    if opacity is not None:
        height, width = (max(sides) for sides in zip(result.shape[:2], opacity.shape, strict=True))
        result, opacity = resized(result, height, width), resized(opacity[..., None], height, width)[..., 0]
    result[..., 3] = 255 if opacity is None else opacity
    return result


def _opacity(pixels: Pixels, texture: Texture, channel: Literal["alpha", "luminance"]) -> Pixels:
    """(h, w) the alpha that an image stands for."""
    if channel == "alpha":
        return pixels[..., 3]
    values = pixels[..., :3].astype(np.float32) / 255.0
    return as_bytes(decoded(values) @ _LUMINANCE)
