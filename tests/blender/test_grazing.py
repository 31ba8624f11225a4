"""Billboards that are seen on edge fade where that is asked for: by nodes, in materials, in files and in the viewer."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from command_line import QUICK, bake
from glb import read_glb
from laws import grazing
from lod_scenes import add_camera, evaluate
from node_trees import new_material
from numpy.typing import NDArray
from plan_scenes import add_crown
from renders import render
from scenes import add_mesh, read
from scenes import bake as bake_here
from viewing import PAGE, PATIENCE

from addon.build.grazing_nodes import GRAZING_SHARE, WIDTH, add_grazing_fade, add_grazing_modifier
from addon.settings import BakeSettings
from addon.versions import set_modifier_input
from addon.viewport.draw import inputs_of
from bench.browser import ask

ANGLES = np.radians([0.0, 45.0, 70.0, 80.0, 85.0, 88.0, 90.0])


def fan(*materials: bpy.types.Material) -> bpy.types.Object:
    """Quads in the origin that are turned about the y axis by `ANGLES`."""
    across = np.stack([np.cos(ANGLES), 0.0 * ANGLES, np.sin(ANGLES)], axis=-1)
    along = np.array([0.0, 1.0, 0.0])
    corners = np.stack([-across - along, across - along, across + along, -across + along], axis=1)
    return add_mesh("fan", corners.reshape(-1, 3).tolist(), np.arange(28).reshape(-1, 4).tolist(), materials=materials)


def hidden(obj: bpy.types.Object) -> NDArray[np.float64] | None:
    """The share that is not shown, by point; None where nothing is stored."""
    attribute = evaluate(obj).attributes.get(GRAZING_SHARE)
    return None if attribute is None else np.array([item.value for item in attribute.data])


@pytest.mark.parametrize("width", [WIDTH, 0.9])
def test_faces_fade_out_at_grazing_angles(width: float) -> None:
    obj = fan()
    set_modifier_input(add_grazing_modifier(obj), "Width", width)
    add_camera((0.0, 0.0, 1e5))
    np.testing.assert_allclose(hidden(obj), np.repeat(1.0 - grazing(np.cos(ANGLES), width), 4), atol=2e-4)


def test_without_a_camera_or_a_width_nothing_fades() -> None:
    obj = fan()
    modifier = add_grazing_modifier(obj)
    assert hidden(obj) is None
    add_camera((0.0, 0.0, 10.0))
    assert hidden(obj) is not None
    set_modifier_input(modifier, "Width", 0.0)
    assert hidden(obj) is None


def test_materials_show_the_rest_and_their_shadow_stays(tmp_path: Path) -> None:
    """A card that is hidden by half, over a floor: it is half as dark itself, and so is not what it shades."""
    material, principled, _ = new_material()
    principled.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    principled.inputs["Specular IOR Level"].default_value = 0.0
    add_grazing_fade(material.node_tree)
    card = add_mesh("card", [(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], [(0, 1, 2, 3)], materials=[material])
    share = card.data.attributes.new(GRAZING_SHARE, "FLOAT", "POINT")
    for hides in (0.0, 0.5):
        share.data.foreach_set("value", [hides] * 4)
        alpha = render(tmp_path, (0.0, 0.0, 2.0), width=1.0, size=(4, 4), samples=256)[..., 3].mean()
        assert alpha == pytest.approx(1.0 - hides, abs=0.02)

    floor = add_mesh("floor", [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2, 3)])
    floor.data.materials.append(new_material()[0])
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.rotation_euler = (0.6, 0.0, 0.0)
    bpy.context.scene.collection.objects.link(sun)
    below = render(tmp_path, (0.0, 0.7, 0.5), width=0.2, size=(4, 4))[..., :3].mean()
    aside = render(tmp_path, (5.0, 0.7, 0.5), width=0.2, size=(4, 4))[..., :3].mean()
    assert below < 0.05 * aside


def test_a_bake_that_is_asked_for_it_fades_its_clouds() -> None:
    baked = bake_here(read([add_crown()]), BakeSettings(texture_size=64, epsilon=0.2, effects="auto,+grazing_fade"))
    for level in baked.levels:
        extras = level.object["leafcloud"]
        assert ("grazing" in extras, "Leafcloud Grazing" in level.object.modifiers) == (level.number > 0,) * 2
        if level.number > 0:
            assert extras["grazing"] == WIDTH
            assert inputs_of(level.object).grazing == pytest.approx(WIDTH)


def test_it_stands_behind_all_that_moves_a_billboard_but_what_parts_pairs() -> None:
    effects = "auto,+grazing_fade,+wind,+back_sides"
    baked = bake_here(read([add_crown()]), BakeSettings(texture_size=64, epsilon=0.2, effects=effects))
    names = [modifier.name for modifier in baked.levels[1].object.modifiers]
    assert names == ["Leafcloud LOD", "Leafcloud Wind", "Leafcloud Grazing", "Leafcloud Sides"]


@pytest.mark.browser
def test_the_viewer_fades_as_the_file_says(shrub: Path, tmp_path: Path) -> None:
    bake(shrub, tmp_path / "fading", *QUICK, "--effects=+grazing_fade")
    bake(shrub, tmp_path / "whole", *QUICK)
    extras = read_glb(tmp_path / "fading" / "shrub.glb")["shrub_LOD1"].extras["leafcloud"]
    assert extras["grazing"] == WIDTH
    away = 1.2 * extras["switch_distance"]
    # From some sides no billboard is seen on edge.
    eyes = [[away * part for part in side] for side in ((0, 0, 1), (1, 0, 0), (0.6, 0.8, 0), (0, 0.6, 0.8))]

    def pixels(folder: str, **settings: float) -> list[str]:
        question = {"tree": "/files/shrub.glb", "settings": settings, "eyes": eyes}
        return [view["pixels"] for view in ask(PAGE, question, patience=PATIENCE, files=tmp_path / folder)["seen"]]

    as_told = pixels("fading")
    assert as_told == pixels("whole", grazing=WIDTH)
    assert as_told != pixels("whole")
    assert pixels("whole") == pixels("fading", grazing=0.0)
