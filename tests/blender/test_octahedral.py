"""The octahedral impostor in Blender: Cycles draws it by the law, files have a cross impostor, and bakes replace it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from command_line import QUICK
from command_line import bake as bake_files
from glb import read_chunks, read_glb, read_scene
from mathutils import Euler, Matrix, Vector
from night import rest_at_night
from octahedral import Impostor, shown
from renders import render
from scenes import add_mesh, bake, import_part, read

import leafcloud
from addon.bake.values import Baked
from addon.levels.octahedral import plain_files
from addon.mesh.baked_levels import EXTRAS, plain_mesh
from addon.settings.bake import BakeSettings
from addon.settings.setting import SettingsError

SIDE, GRID = 32, 4
SHAPE: dict[str, Any] = {"levels": 1, "epsilon": 0.1, "quality": 0.1, "texture_size": 128, "last": "octahedral"}


def baked(shrub: Path, matrix: Matrix | None = None, **settings: Any) -> Baked:
    import_part(shrub)
    bpy.context.view_layer.update()
    objects = [obj for obj in bpy.context.scene.objects if obj.type == "MESH"]
    for obj in objects:
        obj.parent = None
        obj.matrix_world = (matrix or Matrix()) @ obj.matrix_world
    bpy.context.view_layer.update()
    return bake(read(objects, ["leaves"]), BakeSettings(**{**SHAPE, **settings}))


def last_of(tree: Baked) -> leafcloud.OctahedralLevel:
    last = tree.chain.levels[-1]
    assert isinstance(last, leafcloud.OctahedralLevel)
    return last


PLACES = {
    "as it is": Matrix(),
    "turned and scaled": Matrix.LocRotScale(Vector((3.0, -2.0, 5.0)), Euler((0.3, 0.2, 2.0)), Vector((2.0,) * 3)),
    "mirrored": Matrix.LocRotScale(Vector((0.0, 1.0, 0.0)), Euler((0.0, 0.0, 0.7)), Vector((-1.5, 1.5, 1.5))),
}


@pytest.mark.parametrize("place", rest_at_night(["turned and scaled", "as it is", "mirrored"]))
@pytest.mark.parametrize("rotation", rest_at_night([[1.2, 0.0, 0.4], [0.6, 0.0, 2.5], [2.0, 0.0, -1.0]]))
def test_cycles_draws_it_by_the_law(
    shrub: Path, tmp_path: Path, place: str, rotation: tuple[float, float, float]
) -> None:
    tree = baked(shrub, PLACES[place], effects="none")
    level, obj = last_of(tree), tree.levels[-1].object
    for each in bpy.context.scene.objects:
        each.hide_render = each != obj
    shine(obj)
    middle = obj.matrix_world @ Vector(np.linalg.solve(level.to_layout[:, :3], -level.to_layout[:, 3]).tolist())
    turn = Euler(rotation).to_matrix()
    width, away = 2.4 * tree.prepared.foliage.radius, 10.0 * tree.prepared.foliage.radius
    camera = middle + turn @ Vector((0.0, 0.0, away))
    picture = render(tmp_path, tuple(camera), rotation, width=width, size=(SIDE, SIDE), samples=128, pixel_filter="BOX")
    expected = by_the_law(level, obj, np.array(middle), np.array(turn), width)
    # 128 samples of Cycles, 16 of the reference.
    assert np.abs(picture - expected).mean() < 0.01
    assert np.abs(picture[..., 3] - expected[..., 3]).max() < 0.2
    assert expected[..., 3].mean() > 0.1


def shine(obj: bpy.types.Object) -> None:
    """Make the impostor emit its color, so that no light is needed."""
    tree = obj.data.materials[0].node_tree
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(surface.inputs["Base Color"].links[0].from_socket, surface.inputs["Emission Color"])
    surface.inputs["Emission Strength"].default_value = 1.0
    surface.inputs["Specular IOR Level"].default_value = 0.0


def by_the_law(
    level: leafcloud.OctahedralLevel, obj: bpy.types.Object, middle: np.ndarray, turn: np.ndarray, width: float
) -> np.ndarray:
    """Return the picture (SIDE, SIDE, 4), linear, premultiplied, with the lowest row first."""
    numbers = {"extent": level.extent, "grid": level.grid, "texels": level.view_texels}
    impostor = Impostor.of(level.color, level.normal_depth, numbers)
    steps = ((np.arange(SIDE * GRID) + 0.5) / (SIDE * GRID) - 0.5) * width
    across, upward = np.meshgrid(steps, steps)
    world = middle + (across[..., None] * turn[:, 0] + upward[..., None] * turn[:, 1]).reshape(-1, 3)
    to_tree = np.linalg.inv(np.array(obj.matrix_world))
    points = (world @ to_tree[:3, :3].T + to_tree[:3, 3]) @ level.to_layout[:, :3].T + level.to_layout[:, 3]
    eye = level.to_layout[:, :3] @ (to_tree[:3, :3] @ turn[:, 2])
    seen, _, light = shown(impostor, points, np.tile(eye / np.linalg.norm(eye), (len(points), 1)))
    seen[:, :3] *= seen[:, 3:] * light[:, None]
    return seen.reshape(SIDE, GRID, SIDE, GRID, 4).mean(axis=(1, 3))


def test_the_ground_below_the_tree_has_its_shadow(shrub: Path, tmp_path: Path) -> None:
    """The ground lies inside of the ellipsoid. The camera sees neither tree, only their shadows."""
    tree = baked(shrub, effects="none")
    leaves, impostor = tree.levels[0], tree.levels[-1]
    middle, radius = tree.prepared.foliage.world_centre, tree.prepared.foliage.radius
    foot = float(middle[2]) - 0.6 * radius
    square = [(x * radius, y * radius, foot) for x, y in ((-3, -3), (3, -3), (3, 3), (-3, 3))]
    ground = add_mesh("ground", square, [(0, 1, 2, 3)])
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.rotation_euler = (0.5, 0.2, 0.0)
    bpy.context.scene.collection.objects.link(sun)
    pictures = []
    for casting in ((leaves.object, leaves.trunk), (impostor.object,)):
        for obj in bpy.context.scene.objects:
            obj.hide_render = obj not in (*casting, ground, sun)
            obj.visible_camera = obj == ground
        above = (float(middle[0]), float(middle[1]), foot + 9.0 * radius)
        pictures.append(render(tmp_path, above, width=4.0 * radius, samples=128, pixel_filter="BOX")[..., 1])
    true, found = (1.0 - picture / np.median(picture) for picture in pictures)  # Most of the ground is lit.
    assert true.max() > 0.9
    assert found.sum() == pytest.approx(true.sum(), rel=0.15)
    assert np.corrcoef(found.ravel(), true.ravel())[0, 1] > 0.7


def test_the_surface_holds_the_whole_tree(shrub: Path) -> None:
    """Every corner of leaves and trunk is inside of each triangle of the ellipsoid."""
    tree = baked(shrub, PLACES["mirrored"], effects="none")
    mesh = tree.levels[-1].object.data
    parts = [tree.prepared.tree.leaves, tree.prepared.tree.trunk]
    corners = np.concatenate([part.positions for part in parts if part is not None])
    for polygon in mesh.polygons:
        heights = (corners - np.array(polygon.center)) @ np.array(polygon.normal)
        assert heights.max() < 0.0


def test_the_surface_is_hardly_larger_than_the_tree(shrub: Path) -> None:
    """An artist sees its outline where the level is selected."""
    tree = baked(shrub, effects="none")
    parts = [tree.prepared.tree.leaves, tree.prepared.tree.trunk]
    corners = np.concatenate([part.positions for part in parts if part is not None])
    around = np.array([vertex.co for vertex in tree.levels[-1].object.data.vertices])
    assert (np.ptp(around, axis=0) < 1.4 * np.ptp(corners, axis=0)).all()


def test_files_have_the_cross_impostor_and_the_data_of_the_octahedral_one(shrub: Path, tmp_path: Path) -> None:
    report = bake_files(shrub, tmp_path, *QUICK, "--last", "octahedral", "--levels", "1")
    [row] = [each for each in report["levels"] if each["method"] == "octahedral"]
    assert (row["triangles"], row["texture_size"], row["trunk_triangles"]) == (2, [1024, 1024], 0)
    node = read_glb(tmp_path / "shrub.glb")["shrub_LOD2"]
    assert sum(len(each.indices) for each in node.primitives) == row["plain"]["triangles"]
    assert row["drawing"]["written_triangles"] == row["plain"]["triangles"]
    extras = node.extras[EXTRAS]
    assert "leafcloud_plain" not in node.extras
    assert extras["switch_distance"] == row["plain"]["switch_distance"]
    assert extras["octahedral"]["switch_distance"] == row["switch_distance"]
    assert len(extras["octahedral"]["to_layout"]) == 12
    [primitive] = node.primitives
    textures = primitive.material["extras"]["leafcloud"]
    document, _ = read_chunks(tmp_path / "shrub.glb")
    names = [document["images"][document["textures"][textures[key]["index"]]["source"]]["name"] for key in textures]
    assert names == ["shrub_LOD2_octahedral", "shrub_LOD2_octahedral_normal"]
    assert list(read_scene(tmp_path / "shrub.glb")) == ["shrub_LOD0"]


def test_the_transform_in_files_is_that_of_gltfs_axes(shrub: Path) -> None:
    tree = baked(shrub, effects="none")
    level, numbers = last_of(tree), tree.levels[-1].object[EXTRAS]["octahedral"]
    point = np.array([0.3, -0.2, 0.7])
    rows = np.array(numbers["to_layout"]).reshape(3, 4)
    in_gltf = np.array([point[0], point[2], -point[1]])
    assert rows[:, :3] @ in_gltf + rows[:, 3] == pytest.approx(level.to_layout[:, :3] @ point + level.to_layout[:, 3])


def test_the_level_is_itself_again_after_files_are_written(shrub: Path) -> None:
    tree = baked(shrub, effects="none")
    obj = tree.levels[-1].object
    own, extras, plain = obj.data, obj[EXTRAS].to_dict(), plain_mesh(obj)
    with plain_files(tree.levels, 7.0):
        assert (obj.data, obj[EXTRAS]["switch_distance"], list(obj.keys())) == (plain, 7.0, [EXTRAS])
    assert (obj.data, obj[EXTRAS].to_dict(), plain_mesh(obj)) == (own, extras, plain)


def test_it_takes_over_where_its_picture_is_good_enough(shrub: Path) -> None:
    tree = baked(shrub, effects="transitions", epsilon=None)
    schedule = tree.schedule
    assert schedule.switch_distances[-1] < schedule.plain_distances[-1]
    assert schedule.switch_distances[:-1] == schedule.plain_distances[:-1]


def test_it_fades_in(shrub: Path) -> None:
    tree = baked(shrub, effects="transitions")
    nodes = tree.levels[-1].object.data.materials[0].node_tree.nodes
    assert any(node.type == "ATTRIBUTE" and node.attribute_name == "leaf_hidden_share" for node in nodes)


def test_engines_that_do_not_draw_it_get_a_cross_impostor(shrub: Path) -> None:
    tree = baked(shrub, effects="none", last="auto", engine="godot", epsilon=None)
    assert tree.chain.levels[-1].method == "cross"


def test_it_needs_a_cross_impostor() -> None:
    with pytest.raises(SettingsError, match="`last=octahedral` needs the cross impostor"):
        BakeSettings(last="octahedral", cross=False)
