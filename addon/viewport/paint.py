"""Materials as the preview draws them: the atlas page of a level, or the color and alpha of leaves and trunk."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ..levels.baked_light import BACK, FRONT, strength_of
from ..levels.material import page_of
from ..material.surface import read_surface
from ..material.textures import Texture

_FROM_EYE = 0.5
"""The share of the preview's light that comes from the eye; the rest comes from everywhere."""

_ALPHA, _LUMINANCE = (0.0, 0.0, 0.0, 1.0), (0.2126, 0.7152, 0.0722, 0.0)


@dataclass(frozen=True)
class Paint:
    """A material for the shader: tint · color image · colors of corners, where its alpha is above a cutoff.

    `color` and `opacity` are images, None for white. `opacity_weights`: how much each channel of `opacity` counts in
    alpha. `tint`: linear RGBA. `cutoff`: nothing is drawn up to this alpha; 0 dithers by alpha, −1 ignores alpha.
    `headlight`: the share of the light that comes from the eye. `layout`: how both images lie on the mesh.
    `color_name`, `alpha_name`: color attributes, "" for the one that renders. `light_names`: the color attributes that
    hold baked light, of the front and of the back.
    """

    color: bpy.types.Image | None
    opacity: bpy.types.Image | None
    opacity_weights: tuple[float, float, float, float]
    tint: tuple[float, float, float, float]
    cutoff: float
    double_sided: bool
    headlight: float
    layout: Texture | None = None
    color_name: str | None = None
    alpha_name: str | None = None
    light_names: tuple[str, str] | None = None


def paint_of(material: bpy.types.Material | None) -> Paint:
    """Return the paint of a material, baked or original. Unreadable parts get the viewport color."""
    page, strength = page_of(material), strength_of(material)
    headlight = _FROM_EYE if strength is None else 0.0
    bright = 1.0 if strength is None else strength
    if material is not None and page is not None:
        image, cutoff = page
        double_sided = not material.use_backface_culling
        return Paint(image, image, _ALPHA, (bright, bright, bright, 1.0), cutoff, double_sided, headlight)
    surface = read_surface(material, as_exported=True)
    color, alpha = surface.color_texture, surface.alpha_texture
    red, green, blue = (bright * part for part in surface.color)
    return Paint(
        color=None if color is None else color.image,
        opacity=None if alpha is None else alpha.image,
        opacity_weights=_ALPHA if surface.alpha_channel == "alpha" else _LUMINANCE,
        tint=(red, green, blue, surface.alpha),
        cutoff={"MASK": surface.alpha_cutoff, "BLEND": 0.0, "OPAQUE": -1.0}[surface.alpha_mode],
        double_sided=surface.double_sided,
        headlight=headlight,
        layout=color or alpha,
        color_name=surface.color_attribute,
        alpha_name=surface.alpha_attribute,
        light_names=None if strength is None else (FRONT, BACK),
    )
