"""The effect baked_light: the scene's light on a tree, in the form that the core and the levels take."""

from __future__ import annotations

import time
from dataclasses import dataclass

import bpy
import numpy as np

from ..geometry import Tree
from ..levels.trunk import geometry_mesh
from ..scene.light import Light, LitScene, bake_light

BRIGHTEST = 99.9
"""Percentile of the leaves' light that atlas pages hold. Brighter light is clipped where base colors are bright."""

DARK = 1e-3
"""Light below this value counts as no light."""


@dataclass(frozen=True)
class BakedLight:
    """Baked light of the leaves and the trunk, divided by `strength`, and the seconds of the bake.

    strength: factor, at least 1, by which renderers multiply the drawn color.
    """

    leaves: Light
    trunk: Light | None
    strength: float
    seconds: float
    warnings: tuple[str, ...]


def light_of(tree: Tree, layer: bpy.types.ViewLayer, *, with_trunk: bool) -> BakedLight:
    """Bake the light in the scene of `layer` on the tree's leaves and, with `with_trunk`, on its trunk.

    The trunk casts shadows either way. Raise `SceneError` if Cycles cannot bake.
    """
    begin = time.perf_counter()
    casting = [tree.leaves] if tree.trunk is None else [tree.leaves, tree.trunk]
    meshes: list[bpy.types.Mesh] = []
    try:
        meshes.extend(geometry_mesh("leafcloud shadow", geometry) for geometry in casting)
        around = LitScene(layer, tree.sources, meshes)
        leaves, *trunk = bake_light(casting if with_trunk else casting[:1], tree.matrix, around)
    finally:
        for mesh in meshes:
            bpy.data.meshes.remove(mesh)
    brightest = float(np.percentile(np.stack([leaves.front, leaves.back]), BRIGHTEST))
    strength = max(1.0, brightest)
    warnings = () if brightest > DARK else (_no_light(layer),)
    seconds = time.perf_counter() - begin
    return BakedLight(leaves.over(strength), trunk[0].over(strength) if trunk else None, strength, seconds, warnings)


def _no_light(layer: bpy.types.ViewLayer) -> str:
    return (
        f"no light of the scene {layer.id_data.name!r} reaches the leaves, so baked_light makes them black: "
        f"add a light, or a world"
    )
