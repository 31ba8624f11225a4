"""The shadow proxy: it casts the leaves' shadow, is invisible itself, and has its own file for engines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from glb import read_glb
from plan_scenes import add_crown
from renders import LUMINANCE, render
from scenes import add_mesh, bake, read

from addon.bake.values import Baked, TreeSet
from addon.export.files import write
from addon.levels.shadow_proxy import shadow_proxy_of
from addon.plan.decision import Decision
from addon.plan.effects import plan_effects
from addon.plan.facts import Facts
from addon.settings.bake import BakeSettings

MANY_LEAVES = Facts("three", leaves=5000, triangles=20_000)


def planned(settings: BakeSettings, facts: Facts) -> Decision:
    [effect] = [each for each in plan_effects(settings, facts) if each.name == "shadow_proxy"]
    return effect


def test_the_plan_makes_a_shadow_proxy_for_engines_and_many_leaves() -> None:
    effect = planned(BakeSettings(engine="three"), MANY_LEAVES)
    assert effect.on is True
    assert effect.reason == "every light in three would draw 20000 triangles of leaves again for its shadows"


@pytest.mark.parametrize(
    ("settings", "facts", "why"),
    [
        (BakeSettings(), replace(MANY_LEAVES, engine="generic"), "casts its own shadow"),
        (BakeSettings(engine="three"), replace(MANY_LEAVES, triangles=400), "400 triangles"),
        (BakeSettings(engine="three", unlit=True), MANY_LEAVES, "the target is unlit"),
        (BakeSettings(engine="three", chain="pruning"), MANY_LEAVES, "no cloud"),
    ],
    ids=["who draws is not known", "few leaves", "unlit", "no cloud"],
)
def test_the_plan_makes_no_shadow_proxy_without_need(settings: BakeSettings, facts: Facts, why: str) -> None:
    effect = planned(settings, facts)
    assert effect.on is False
    assert why in effect.reason


def baked(effects: str) -> Baked:
    """Bake a crown of cards around the origin."""
    leaves = add_crown()
    result = bake(read([leaves], ["leaves"]), BakeSettings(epsilon=0.1, quality=0.1, texture_size=256, effects=effects))
    bpy.data.objects.remove(leaves)
    return result


def shadow(result: Baked, folder: Path) -> float:
    """Return the area of the shadow on a ground below, cast by level 1 and the objects that all levels share.

    The camera stands between the levels and the ground.
    """
    for level in result.levels:
        level.object.hide_render = level.number != 1
        level.object.modifiers.clear()
    ground = add_mesh("ground", [(-2, -2, -1.2), (2, -2, -1.2), (2, 2, -1.2), (-2, 2, -1.2)], [(0, 1, 2, 3)])
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    bpy.context.scene.collection.objects.link(sun)
    pixels = render(folder, (0.0, 0.0, -1.1), width=2.4, size=(96, 96), samples=16, pixel_filter="BOX")
    for obj in (ground, sun):
        bpy.data.objects.remove(obj)
    light = pixels[..., :3] @ LUMINANCE
    return float((1.0 - light / np.median(light)).mean()) * 2.4**2


def test_the_proxy_casts_the_shadow_of_the_leaves(tmp_path: Path) -> None:
    areas = []
    for effects in ("transitions", "transitions,shadow_proxy"):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        areas.append(shadow(baked(effects), tmp_path))
    cards = 60 * 0.1**2 / 2.0  # in the mean half of a card's area is seen from anywhere
    assert 0.5 * cards < areas[0] < 1.5 * cards
    assert areas[1] == pytest.approx(areas[0], rel=0.05)


def test_the_proxy_is_invisible_and_the_leaves_cast_no_shadow(tmp_path: Path) -> None:
    result = baked("transitions,shadow_proxy")
    proxy = shadow_proxy_of(result.collection)
    assert proxy is not None
    for level in result.levels:
        assert not level.object.visible_shadow
        level.object.hide_render = True
    assert not render(tmp_path, (0.0, 0.0, 3.0), width=2.4)[..., 3].any()
    proxy.visible_camera = True
    assert render(tmp_path, (0.0, 0.0, 3.0), width=2.4)[..., 3].any()


def test_the_trunk_keeps_its_own_shadow() -> None:
    trunk = add_mesh("trunk", [(0, 0, -1), (0.1, 0, -1), (0, 0, 1)], [(0, 1, 2)])
    settings = BakeSettings(epsilon=0.1, quality=0.1, texture_size=64, effects="shadow_proxy", cross=False)
    result = bake(read([add_crown(), trunk], ["leaves"]), settings)
    assert all(level.trunk is not None and level.trunk.visible_shadow for level in result.levels)


def test_the_proxy_has_its_own_file(tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]) -> None:
    result = baked("transitions,shadow_proxy")
    name = result.collection.name
    report = write(TreeSet.of(result), tmp_path, lambda stage, fraction: None, blend=False)
    assert f"{name}_shadow.glb" in report["files"]
    [(node, mesh)] = read_glb(tmp_path / f"{name}_shadow.glb").items()
    assert node == f"{name}_shadow"
    assert mesh.extras["leafcloud"]["shadow_only"]
    [primitive] = mesh.primitives
    assert primitive.material["alphaMode"] == "MASK"
    assert not primitive.targets, "it does not move"
    assert f"{name}_shadow" not in read_glb(tmp_path / f"{name}.glb"), "who draws all of a file would draw it"
    assert shadow_proxy_of(result.collection) is not None, "it is in the scene again"
    assert gltf_issues(*tmp_path.glob("*.glb")) == []


def test_the_page_of_the_proxy_stores_only_opacity(tmp_path: Path) -> None:
    proxy = shadow_proxy_of(baked("shadow_proxy").collection)
    assert proxy is not None
    image = proxy.data.materials[0].node_tree.nodes["Leafcloud Page"].image
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    colors, alpha = np.split(pixels.reshape(-1, 4), [3], axis=1)
    assert (colors == 1.0).all()
    assert 0.0 < alpha.mean() < 1.0
