"""Pairs of front and back billboards are one polygon in Blender, with the texture of the visible side."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from lod_scenes import evaluate
from node_trees import atlas_image
from numpy.typing import NDArray
from renders import render
from scenes import add_mesh

from addon.levels.material import Page, atlas_material
from addon.levels.mesh import polygon_faces
from addon.levels.sides import add_sides, back_polygons, two_sided_material
from addon.nodes.sides import add_side_modifier

pytestmark = pytest.mark.version

SQUARE = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
RED, BLUE = (200, 20, 10), (10, 20, 200)
FRONT_UV = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 1.0], [0.0, 1.0]], np.float32)
BACK_UV = np.array([[1.0, 1.0], [0.5, 1.0], [0.5, 0.0], [1.0, 0.0]], np.float32)
"""The back's first axis is opposite to the front's, and its corners are in the opposite order."""
LEVEL = SimpleNamespace(
    polygon_sizes=np.array([4, 4], np.uint32),
    polygon_billboards=np.array([0, 1], np.uint32),
    plane_ids=np.array([7, 7], np.uint32),
    uvs=np.concatenate([FRONT_UV, BACK_UV]),
)
"""A pair, with the arrays that a level of the core has."""
CORNERS = [*SQUARE, *reversed(SQUARE)]


def page() -> Page:
    """Return a page with the front to the left and the back to the right, each with its color and its own normal."""
    color, normal = np.zeros((2, 8, 8, 4), np.uint8)
    color[:, :4], color[:, 4:] = (*RED, 255), (*BLUE, 255)
    color[:2, 5:] = 0  # The back is cut out above and to its right.
    normal[:, :4], normal[:, 4:] = (170, 90, 220, 255), (80, 180, 215, 255)
    return Page(atlas_image("color", color), normal=atlas_image("normal", normal, data=True), specular=0.0)


def pair(name: str = "pair") -> bpy.types.Object:
    """Return front and back in one place, as a level's mesh has them."""
    material = atlas_material("pair", page(), alpha_cutoff=0.5, double_sided=False)
    obj = add_mesh(name, CORNERS, [(0, 1, 2, 3), (4, 5, 6, 7)], materials=[material])
    obj.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", LEVEL.uvs.ravel())
    faces = polygon_faces(LEVEL.polygon_sizes, np.zeros(4, np.int32), np.array([0, 1]), mirrored=False)
    add_sides(obj.data, LEVEL, faces)
    return obj


def seen(folder: Path, height: float) -> NDArray[np.float32]:
    """Return the view from above, or from below if the height is negative."""
    turned = (0.0, 0.0 if height > 0.0 else math.pi, 0.0)
    return render(folder, (0.0, 0.0, height), turned, width=2.0, size=(16, 16), samples=16, pixel_filter="BOX")


def suns() -> None:
    for tilt, turn in ((0.7, 0.4), (math.pi - 0.5, 1.9)):
        lamp = bpy.data.lights.new("sun", "SUN")
        lamp.energy, lamp.angle = 3.0, 0.0
        obj = bpy.data.objects.new("sun", lamp)
        obj.rotation_euler = (tilt, 0.0, turn)
        bpy.context.scene.collection.objects.link(obj)


@pytest.mark.parametrize("height", [2.0, -2.0, 60.0, -60.0])
def test_one_polygon_looks_like_the_pair(height: float, tmp_path: Path) -> None:
    """The reference has the two billboards a little apart, each invisible from behind."""
    suns()
    obj = pair()
    for vertex in obj.data.vertices:
        vertex.co.z = 0.01 if vertex.index < 4 else -0.01
    expected = seen(tmp_path, height)
    for vertex in obj.data.vertices:
        vertex.co.z = 0.0
    add_side_modifier(obj, two_sided_material(obj.data.materials[0]))
    found = seen(tmp_path, height)
    np.testing.assert_allclose(found, expected, atol=5e-3)
    color = 0 if height > 0.0 else 2
    shown = found[..., 3] > 0.5
    assert (found[shown][:, :3].argmax(axis=1)[found[shown][:, color] > 0.05] == color).all()
    assert shown.all() == (height > 0.0), "the back is cut out in part"


def test_the_modifier_draws_the_fronts_and_the_mesh_is_unchanged() -> None:
    obj = pair()
    both = two_sided_material(obj.data.materials[0])
    add_side_modifier(obj, both)
    drawn = evaluate(obj)
    assert [len(polygon.vertices) for polygon in drawn.polygons] == [4]
    assert drawn.polygons[0].normal.z == 1.0
    assert drawn.materials[drawn.polygons[0].material_index].name == both.name
    assert len(obj.data.polygons) == 2
    assert [material.name for material in obj.data.materials] == ["pair"]


def test_a_single_side_is_invisible_from_behind(tmp_path: Path) -> None:
    suns()
    material = atlas_material("side", page(), alpha_cutoff=0.5, double_sided=False)
    obj = add_mesh("side", SQUARE, [(0, 1, 2, 3)], materials=[material])
    obj.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", FRONT_UV.ravel())
    assert (seen(tmp_path, 2.0)[..., 3] == 1.0).all()
    assert (seen(tmp_path, -2.0)[..., 3] == 0.0).all()


def test_polygons_behind_follow_by_the_number_of_the_fronts_polygons() -> None:
    level = SimpleNamespace(
        polygon_sizes=np.array([3, 4, 3, 4, 5, 5], np.uint32),
        polygon_billboards=np.array([0, 0, 1, 1, 2, 3], np.uint32),
        plane_ids=np.array([0, 0, 4, 4], np.uint32),
    )
    assert back_polygons(level).tolist() == [2, 3, -1, -1, 5, -1]
