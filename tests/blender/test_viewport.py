"""The preview in the 3D view: visible levels, their shares of the pixels, and the shader's places of the leaves."""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
import pytest
from browser import ask
from laws import KNOTS, drawn_share, kept, trend
from lod_scenes import FOUR, add_camera, build, evaluate, many_leaves, place, points_of
from node_trees import atlas_image
from numpy.typing import NDArray
from preview_pictures import PAGE, PATIENCE, attributes_of, numbers, shader
from scenes import add_mesh

from addon.levels.fading import add_fade
from addon.levels.material import Page, atlas_material
from addon.levels.prune_tables import area_shares
from addon.mesh.baked_levels import EXTRAS
from addon.nodes.lod import LodSettings, add_lod_modifier
from addon.viewport.corners import parts_of
from addon.viewport.draw import inputs_of, levels_in
from addon.viewport.look import LevelInputs, look_at
from addon.viewport.paint import paint_of
from addon.viewport.shader import uniforms_of

NEVER = 1e9


def level(**inputs: Any) -> LevelInputs:
    rest = {"start": NEVER, "end": NEVER, "prune_start": NEVER, "prune_half": 0.5, "appear": 0.0, "vanish": NEVER}
    return LevelInputs(**{**rest, "fade_in_end": 0.0, "fade_out_start": NEVER, **inputs})


def test_a_level_is_drawn_between_appear_and_vanish() -> None:
    drawn = [look_at(level(appear=2.0, vanish=5.0), distance) is not None for distance in (0.0, 1.99, 2.0, 4.99, 5.0)]
    assert drawn == [False, False, True, True, False]


def test_levels_that_cross_fade_share_the_pixels() -> None:
    last = level(vanish=12.5, fade_out_start=10.0)
    cross = level(appear=10.0, fade_in_end=12.5)
    for distance, share in ((10.5, 0.2), (11.25, 0.5), (12.0, 0.8)):
        going, coming = look_at(last, distance), look_at(cross, distance)
        assert going is not None
        assert coming is not None
        assert [going.next_share, coming.next_share] == pytest.approx([share, share])
        assert [going.coming, coming.coming] == [False, True]
    for alone in (look_at(last, 9.9), look_at(cross, 12.6)):
        assert alone is not None
        assert (alone.next_share, alone.coming) == (1.0, True)


def test_the_scale_combines_the_area_table_and_the_measured_growth() -> None:
    shares = np.linspace(0.0, 1.0, 65) ** 1.5
    inputs = level(prune_start=2.0, prune_half=0.3, growth=(0.1, 0.02), area_shares=tuple(shares.tolist()))
    for distance in (1.0, 2.5, 9.0, 70.0):
        look = look_at(inputs, distance)
        keep = kept(np.array(distance), np.array(2.0), np.array(0.3))
        expected = trend(keep, np.array(0.1), np.array(0.02)) / math.sqrt(drawn_share(keep, shares))
        assert look is not None
        assert look.scale == pytest.approx(float(expected if keep < 1.0 else 1.0), rel=1e-12)
    assert KNOTS.shape == shares.shape


def test_a_mesh_without_morph_and_pruning_keeps_its_corners() -> None:
    obj = add_mesh("square", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)])
    [part] = parts_of(obj)
    corners = part.attributes
    assert corners["position"].shape == (6, 3)
    assert (corners["rank"] == -1.0).all()
    for name in ("target", "pivot", "pivot_target"):
        np.testing.assert_array_equal(corners[name], corners["position"])
    np.testing.assert_array_equal(corners["normal"], np.tile(np.float32([0.0, 0.0, 1.0]), (6, 1)))
    assert (part.paint.color, part.paint.cutoff) == (None, -1.0)


@pytest.mark.parametrize("cutoff", [0.0, 0.4])
@pytest.mark.parametrize("double_sided", [False, True])
@pytest.mark.parametrize("translucent", [False, True])
def test_the_preview_finds_the_atlas_page_of_a_baked_material(
    cutoff: float, double_sided: bool, translucent: bool
) -> None:
    """The material is cut out or blended, single- or double-sided, translucent or opaque. It always has a fade."""
    page, light = (atlas_image(name, np.full((2, 2, 4), 255, np.uint8)) for name in ("page", "light"))
    images = Page(page, translucency=light if translucent else None, share=0.3)
    material = atlas_material("level", images, alpha_cutoff=cutoff, double_sided=double_sided)
    add_fade(material.node_tree)
    paint = paint_of(material)
    assert (paint.color, paint.opacity, paint.opacity_weights) == (page, page, (0.0, 0.0, 0.0, 1.0))
    assert (paint.cutoff, paint.double_sided) == (pytest.approx(cutoff), double_sided)
    assert paint.tint == (1.0, 1.0, 1.0, 1.0)


def test_each_material_becomes_a_part() -> None:
    mesh = build(FOUR)
    colors = [(0.1, 0.2, 0.3, 1.0), (0.6, 0.5, 0.4, 1.0)]
    for color in colors:
        material = bpy.data.materials.new("leaf")
        if material.node_tree is None:  # From Blender 5.0 on every material has nodes.
            material.use_nodes = True
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", np.array([0, 1, 0, 1], np.int32))
    parts = parts_of(place(mesh))
    np.testing.assert_allclose([part.paint.tint for part in parts], colors, rtol=1e-6)
    for part, leaves in zip(parts, ([0, 2], [1, 3]), strict=True):
        np.testing.assert_array_equal(part.attributes["position"], FOUR.points.reshape(-1, 3, 3)[leaves].reshape(-1, 3))
        np.testing.assert_array_equal(part.attributes["rank"], np.repeat(FOUR.ranks[leaves], 3))


def shown_points(obj: bpy.types.Object, distances: list[float]) -> list[NDArray[np.float32] | None]:
    """Return the shader's places of an object's corners (c, 3) for each distance, or None if the object is not drawn.

    The object must have one material.
    """
    [part] = parts_of(obj)
    looks = [look_at(inputs_of(obj), distance) for distance in distances]
    views = [numbers(uniforms_of(look)) for look in looks if look is not None]
    question = {**shader(), "attributes": attributes_of(part), "views": views}
    points = iter(ask(PAGE, question, patience=PATIENCE)["points"])
    return [None if look is None else np.float32(next(points)).reshape(-1, 3) for look in looks]


@pytest.mark.browser
def test_the_shader_draws_the_leaves_of_the_node_group() -> None:
    """Leaves half way to the billboards, on the billboards, and pruned to several shares.

    The shader reads s from a table, so places differ by up to 0.01.
    """
    leaves = many_leaves(400)
    mesh = build(leaves)
    shares = area_shares(leaves.areas.astype(np.float32), leaves.ranks)
    mesh[EXTRAS] = {"area_shares": shares}
    obj = place(mesh)
    settings = LodSettings(start=4.0, end=8.0, prune_start=5.0, prune_half=0.4, growth=(0.1, 0.02), vanish=40.0)
    add_lod_modifier(obj, settings)
    camera = add_camera((0.0, 0.0, 1.0))
    assert levels_in(bpy.context.scene) == [obj]

    distances = [1.0, 4.5, 6.0, 7.99, 12.0, 39.0, 41.0]
    for distance, points in zip(distances, shown_points(obj, distances), strict=True):
        camera.location.z = distance
        bpy.context.view_layer.update()
        by_nodes = points_of(evaluate(obj))
        if points is None:
            assert len(by_nodes) == 0
            continue
        triangles = points.reshape(-1, 3, 3)
        drawn = np.ptp(triangles, axis=1).max(axis=1) > 0.0
        assert 3 * drawn.sum() == len(by_nodes)
        np.testing.assert_allclose(triangles[drawn].reshape(-1, 3), by_nodes, atol=0.01)
