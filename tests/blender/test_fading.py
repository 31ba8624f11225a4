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
from addon.levels.morphs import add_point_attribute
from addon.nodes.laws import HIDDEN_SHARE, OWN_BILLBOARD, PARENT
from addon.nodes.lod import LodSettings, add_lod_modifier, set_manual

pytestmark = pytest.mark.version

SQUARE = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]


def hidden(obj: bpy.types.Object) -> float | None:
    """Return the share for materials that the nodes store, or None without one."""
    attribute = evaluate(obj).attributes.get(HIDDEN_SHARE)
    if attribute is None:
        return None
    values = {item.value for item in attribute.data}
    assert len(values) == 1
    return values.pop()


@pytest.mark.parametrize(
    ("distance", "expected"),
    [(4.0, -1.0), (4.5, -0.75), (5.0, -0.5), (6.0, None), (8.0, None), (9.0, 0.25), (10.0, 0.5), (11.5, 0.875)],
)
def test_a_level_fades_in_and_out_by_distance(distance: float, expected: float | None) -> None:
    """The level is visible from 4 to 12, and fully visible from 6 to 8. While it fades in, its share is negative."""
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


@pytest.mark.parametrize("distance", [10.0, 10.01, 11.0, 12.5, 14.0, 14.99])
def test_each_billboard_takes_the_place_of_its_leaves(distance: float) -> None:
    """At every distance a billboard is drawn, or else its leaves; at both ends only one of the levels."""
    count, fades = 64, {"start": 100.0, "end": 200.0}
    leaves, cloud = (place(triangles(count, name)) for name in (PARENT, OWN_BILLBOARD))
    add_lod_modifier(leaves, LodSettings(**fades, fade_out_start=10.0, vanish=15.0))
    add_lod_modifier(cloud, LodSettings(**fades, appear=10.0, fade_in_end=15.0))
    add_camera((0.0, 0.0, distance))
    left, come = ({round(v.co.x) for v in evaluate(obj).vertices} for obj in (leaves, cloud))
    assert left | come == set(range(count))
    assert not left & come
    assert len(come) == pytest.approx(count * (distance - 10.0) / 5.0, abs=2.0)
    assert hidden(cloud) in (0.0, None)


def triangles(count: int, name: str) -> bpy.types.Mesh:
    """Return triangles at x = 0, 1, 2 …, with their number as the attribute `name`."""
    numbers = np.repeat(np.arange(count), 3)
    points = np.stack([numbers, 0.1 * (np.arange(3 * count) % 3), 0.1 * (np.arange(3 * count) % 3 == 1)], axis=1)
    mesh = bpy.data.meshes.new("triangles")
    mesh.from_pydata(points.tolist(), [], np.arange(3 * count).reshape(-1, 3).tolist())
    add_point_attribute(mesh, name, "INT", numbers.astype(np.int32))
    return mesh


def shining() -> bpy.types.Material:
    """White, and opaque."""
    material, principled, _ = new_material()
    principled.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    principled.inputs["Specular IOR Level"].default_value = 0.0
    principled.inputs["Emission Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    principled.inputs["Emission Strength"].default_value = 1.0
    return material


@pytest.mark.parametrize("share", [None, 0.0, 0.25, 1.0, -0.25, -1.0])
def test_materials_show_the_rest(share: float | None, tmp_path: Path) -> None:
    fading_square(share)
    mean = render(tmp_path, (0.0, 0.0, 2.0), width=1.0, size=(8, 8), samples=256).mean((0, 1))
    np.testing.assert_allclose(mean, 1.0 - abs(share or 0.0), atol=0.03)


def test_no_ray_passes_between_two_levels(tmp_path: Path) -> None:
    """One fades out by a third, the other, behind it, has come by a third."""
    for share, height in ((1.0 / 3.0, 0.1), (-2.0 / 3.0, 0.0)):
        fading_square(share).location.z = height
    seen = render(tmp_path, (0.0, 0.0, 2.0), width=1.0, size=(8, 8), samples=64)
    np.testing.assert_allclose(seen, 1.0, atol=0.02)


@pytest.mark.parametrize(("share", "seen"), [(0.4, 1.0), (0.6, 0.0), (-0.6, 0.0), (-0.4, 1.0)])
def test_the_cross_impostor_replaces_its_level_in_the_middle_in_cycles(
    share: float, seen: float, tmp_path: Path
) -> None:
    fading_square(share, to_cross=True)
    mean = render(tmp_path, (0.0, 0.0, 2.0), width=1.0, size=(4, 4), samples=4).mean((0, 1))
    np.testing.assert_allclose(mean, seen, atol=1e-3)


def fading_square(share: float | None, *, to_cross: bool = False) -> bpy.types.Object:
    copy = fading_copy(shining(), to_cross=to_cross)
    obj = add_mesh("square", SQUARE, [(0, 1, 2, 3)], materials=[copy])
    if share is not None:
        store(obj.data, HIDDEN_SHARE, np.full(4, share, np.float32))
    return obj


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
