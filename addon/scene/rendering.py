"""Find and correct settings that show plants wrongly: transparent bounces, lens, Clip End, Transparent Shadows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import bpy
from mathutils import Vector

from ..material.surface import read_surface
from ..nodes.laws import LOD_DISTANCE

BOUNCES = 64
"""Transparent bounces that show crowns as without a limit. 8 darken crowns of leaf cards by up to a quarter, 32 by half
a percent (docs/decisions/renderers.md)."""


@dataclass(frozen=True)
class Fault:
    """A setting that shows a plant wrongly: the text for artists, and the function that mends it."""

    text: str
    mend: Callable[[], None]


def faults(
    scene: bpy.types.Scene, place: Vector, radius: float, materials: Sequence[bpy.types.Material | None]
) -> list[Fault]:
    """Return the faults of a scene for a plant: its center and radius in world units, and its materials."""
    found = [_clip_end(scene.camera, place, radius), *map(_shadows, dict.fromkeys(materials))]
    return [*faults_of_all(scene), *(fault for fault in found if fault is not None)]


def faults_of_all(scene: bpy.types.Scene) -> list[Fault]:
    """Return the faults of a scene for all plants."""
    fault = _bounces(scene)
    return [] if fault is None else [fault]


def lens_fault(root: bpy.types.Object, magnification: float) -> list[Fault]:
    """Return the fault of a camera that shows a tree larger than its levels are set for; empty if it does not.

    An artist's own LOD Distance is left alone.
    """
    now = root.get(LOD_DISTANCE, 1.0)
    if now not in (1.0, root.get(_FITTED)) or magnification < _MAGNIFIED * now:
        return []

    def mend() -> None:
        root[LOD_DISTANCE] = root[_FITTED] = magnification
        root.update_tag()

    times = f"{magnification / now:.1f}"
    said = f"The camera shows trees {times} × larger than the levels are set for: they take over too near"
    return [Fault(f"{said}. {LOD_DISTANCE} {magnification:.1f} fits", mend)]


_MAGNIFIED = 1.1

_FITTED = "leafcloud_fitted"
"""Custom property of a root: the LOD Distance that `lens_fault` has set."""


def allow_bounces(scene: bpy.types.Scene) -> None:
    """Let rays of Cycles pass the layers of leaves and of billboards, in scenes that Cycles has settings for."""
    if hasattr(scene, "cycles"):
        scene.cycles.transparent_max_bounces = max(scene.cycles.transparent_max_bounces, BOUNCES)


def _bounces(scene: bpy.types.Scene) -> Fault | None:
    if scene.render.engine != "CYCLES" or scene.cycles.transparent_max_bounces >= BOUNCES:
        return None
    limit = scene.cycles.transparent_max_bounces
    text = f"Light Paths › Transparent is {limit}: leaves turn dark behind {limit} layers. {BOUNCES} is enough"
    return Fault(text, lambda: allow_bounces(scene))


def _clip_end(camera: bpy.types.Object | None, place: Vector, radius: float) -> Fault | None:
    if camera is None or camera.type != "CAMERA" or camera.data.library is not None:
        return None
    farthest = (camera.matrix_world.translation - place).length + radius
    if camera.data.clip_end >= farthest:
        return None

    def mend() -> None:
        camera.data.clip_end = 2.0 * farthest

    return Fault(f"The camera's Clip End is {camera.data.clip_end:.4g}, the tree ends at {farthest:.4g}", mend)


def _shadows(material: bpy.types.Material | None) -> Fault | None:
    if material is None or material.library is not None or getattr(material, "use_transparent_shadow", True):
        return None
    if read_surface(material).alpha_mode == "OPAQUE":
        return None

    def mend() -> None:
        material.use_transparent_shadow = True

    return Fault(f"Transparent Shadows is off in {material.name}: its leaves cast the shadows of whole cards", mend)
