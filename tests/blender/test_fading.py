"""Cross-fading of levels without a morph: the hidden fraction by distance, and the materials that use it."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from lod_scenes import FOUR, add_camera, build, evaluate, place, store
from node_trees import new_material
from renders import render
from scenes import add_mesh

from addon.levels.fading import add_fade, fading_copy
from addon.nodes.laws import HIDDEN_SHARE
from addon.nodes.lod import LodSettings, add_lod_modifier, set_manual

pytestmark = pytest.mark.version

SQUARE = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]


def hidden(obj: bpy.types.Object) -> float | None:
    """Return the hidden fraction that the nodes store, or None without one."""
    attribute = evaluate(obj).attributes.get(HIDDEN_SHARE)
    if attribute is None:
        return None
    values = {item.value for item in attribute.data}
    assert len(values) == 1
    return values.pop()


@pytest.mark.parametrize(
    ("distance", "expected"),
    [(4.0, 1.0), (4.5, 0.75), (5.0, 0.5), (6.0, None), (8.0, None), (9.0, 0.25), (10.0, 0.5), (11.5, 0.875)],
)
def test_a_level_fades_in_and_out_by_distance(distance: float, expected: float | None) -> None:
    """The level is visible from 4 to 12, and fully visible from 6 to 8."""
    obj = place(build(FOUR))
    add_lod_modifier(obj, LodSettings(100.0, 200.0, appear=4.0, fade_in_end=6.0, fade_out_start=8.0, vanish=12.0))
    add_camera((0.0, 0.0, distance))
    assert hidden(obj) == (None if expected is None else pytest.approx(expected, abs=1e-6))


@pytest.mark.parametrize("distance", [3.99, 12.01])
def test_a_level_outside_of_its_lod_range_is_empty(distance: float) -> None:
    obj = place(build(FOUR))
    add_lod_modifier(obj, LodSettings(100.0, 200.0, appear=4.0, fade_in_end=6.0, fade_out_start=8.0, vanish=12.0))
    add_camera((0.0, 0.0, distance))
    assert len(evaluate(obj).vertices) == 0


def test_without_a_band_nothing_fades() -> None:
    obj = place(build(FOUR))
    add_lod_modifier(obj, LodSettings(100.0, 200.0, appear=4.0, vanish=12.0))
    camera = add_camera((0.0, 0.0, 4.0))
    for distance in (4.0, 8.0, 11.99):
        camera.location.z = distance
        assert hidden(obj) is None
        assert len(evaluate(obj).vertices) == 12


def test_a_level_under_manual_control_is_fully_visible() -> None:
    obj = place(build(FOUR))
    modifier = add_lod_modifier(obj, LodSettings(100.0, 200.0, appear=4.0, fade_in_end=6.0))
    add_camera((0.0, 0.0, 5.0))
    set_manual(modifier, transition=0.0, keep=1.0)
    assert hidden(obj) is None


def shining() -> bpy.types.Material:
    """White, and opaque."""
    material, principled, _ = new_material()
    principled.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    principled.inputs["Specular IOR Level"].default_value = 0.0
    principled.inputs["Emission Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    principled.inputs["Emission Strength"].default_value = 1.0
    return material


@pytest.mark.parametrize("share", [None, 0.0, 0.25, 1.0])
def test_materials_show_the_rest(share: float | None, tmp_path: Path) -> None:
    copy = fading_copy(shining())
    obj = add_mesh("square", SQUARE, [(0, 1, 2, 3)], materials=[copy])
    if share is not None:
        store(obj.data, HIDDEN_SHARE, np.full(4, share, np.float32))
    mean = render(tmp_path, (0.0, 0.0, 2.0), width=1.0, size=(4, 4), samples=256).mean((0, 1))
    np.testing.assert_allclose(mean, 1.0 - (share or 0.0), atol=0.02)


def test_a_copy_fades_and_the_artists_material_stays() -> None:
    material = shining()
    nodes = len(material.node_tree.nodes)
    copy = fading_copy(material)
    assert copy is not None
    assert copy != material
    assert len(material.node_tree.nodes) == nodes
    everywhere = copy.node_tree.get_output_node("ALL")
    assert everywhere.inputs["Surface"].links[0].from_node.type == "BSDF_PRINCIPLED", "exporters read this one"


def test_nothing_to_fade() -> None:
    assert fading_copy(None) is None
    empty = bpy.data.materials.new("empty")
    if empty.node_tree is None:  # From Blender 5.0 on every material has nodes.
        empty.use_nodes = True
    empty.node_tree.nodes.clear()
    assert fading_copy(empty) == empty


def test_an_output_of_a_renderers_own_fades_as_it_was() -> None:
    """Cycles has an output of its own, and keeps it."""
    material = shining()
    tree = material.node_tree
    own, glow = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeEmission")
    own.target = "CYCLES"
    tree.links.new(glow.outputs[0], own.inputs["Surface"])
    add_fade(tree)
    mixes = {
        renderer: tree.get_output_node(renderer).inputs["Surface"].links[0].from_node
        for renderer in ("CYCLES", "EEVEE")
    }
    assert tree.get_output_node("CYCLES") == own
    assert mixes["CYCLES"].inputs[1].links[0].from_node == glow
    assert mixes["EEVEE"].inputs[1].links[0].from_node.type == "BSDF_PRINCIPLED"
