"""Front and back billboards are apart in Blender, so that Cycles shows the billboard of the visible side."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import pytest
from lod_scenes import evaluate, points_of
from numpy.typing import NDArray
from renders import render
from scenes import add_mesh

from addon.levels.material import Page, atlas_image, atlas_material
from addon.nodes.sides import add_side_modifier, apart

SQUARE = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
RED, BLUE = (0.8, 0.0, 0.0), (0.0, 0.0, 0.8)


def side(color: tuple[float, float, float]) -> bpy.types.Material:
    """Return a single-sided material of one emitted color. The scene needs no light."""
    pixels = np.full((4, 4, 4), 255, np.uint8)
    material = atlas_material("side", Page(atlas_image("side", pixels)), alpha_cutoff=0.5, double_sided=False)
    surface = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    for link in list(surface.inputs["Base Color"].links):
        material.node_tree.links.remove(link)
    surface.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    surface.inputs["Specular IOR Level"].default_value = 0.0
    surface.inputs["Emission Color"].default_value = (*color, 1.0)
    surface.inputs["Emission Strength"].default_value = 1.0
    return material


def pair() -> bpy.types.Object:
    """Return two squares in one place, red from above and blue from below."""
    faces = [(0, 1, 2, 3), (7, 6, 5, 4)]
    obj = add_mesh("pair", [*SQUARE, *SQUARE], faces, materials=[side(RED), side(BLUE)])
    obj.data.polygons.foreach_set("material_index", np.array([0, 1], np.int32))
    obj.data.uv_layers.new(name="UVMap")
    return obj


def seen(folder: Path, height: float) -> NDArray[np.float32]:
    """Return the mean color (4,) of a view from above, or from below if the height is negative."""
    turned = (0.0, 0.0 if height > 0.0 else math.pi, 0.0)
    return render(folder, (0.0, 0.0, height), turned, width=1.0, size=(8, 8), samples=16).mean((0, 1))


@pytest.mark.parametrize("height", [2.0, 60.0])
def test_cycles_shows_each_side_from_its_own_direction(height: float, tmp_path: Path) -> None:
    add_side_modifier(pair(), apart(np.array(SQUARE), 1))
    np.testing.assert_allclose(seen(tmp_path, height), (*RED, 1.0), atol=1e-5)
    np.testing.assert_allclose(seen(tmp_path, -height), (*BLUE, 1.0), atol=1e-5)


def test_a_single_side_is_invisible_from_behind(tmp_path: Path) -> None:
    obj = add_mesh("side", SQUARE, [(0, 1, 2, 3)], materials=[side(RED)])
    obj.data.uv_layers.new(name="UVMap")
    np.testing.assert_allclose(seen(tmp_path, 2.0), (*RED, 1.0), atol=1e-5)
    np.testing.assert_allclose(seen(tmp_path, -2.0), 0.0, atol=1e-6)


def test_each_side_moves_along_its_normal_and_the_mesh_is_unchanged() -> None:
    obj = pair()
    add_side_modifier(obj, 0.25)
    moved = points_of(evaluate(obj))
    np.testing.assert_allclose(moved[:, 2], [0.25] * 4 + [-0.25] * 4, atol=1e-7)
    np.testing.assert_allclose(moved[:, :2], [point[:2] for point in (*SQUARE, *SQUARE)], atol=1e-7)
    assert points_of(obj.data)[:, 2].tolist() == [0.0] * 8


def test_the_offset_depends_on_the_extent_and_the_level() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [16384.0, 0.0, 0.0], [0.0, 5.0, 7.0]])
    assert [apart(corners, number) for number in (1, 2)] == [1.0, 2.0]
