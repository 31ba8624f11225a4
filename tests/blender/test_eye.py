"""The eye of 3D views: levels are drawn for the place of the view there, and for the scene's camera in renders."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest
from lod_scenes import FOUR, add_camera, build, evaluate, place
from mathutils import Matrix, Quaternion, Vector

from addon.nodes.eye import GROUP_NAME, eye_groups, look_from, place_of_eye
from addon.nodes.laws import NEVER
from addon.nodes.lod import LodSettings, add_lod_modifier
from addon.versions import set_modifier_input
from addon.viewport.eye import place_of

pytestmark = pytest.mark.version

FAR = 100.0


@pytest.fixture
def level() -> bpy.types.Object:
    """Return a level in the origin that is drawn nearer than 50, seen by a camera at 100."""
    add_camera((FAR, 0.0, 0.0))
    obj = place(build(FOUR))
    add_lod_modifier(obj, LodSettings(centre=(0.0, 0.0, 0.0), start=NEVER, end=NEVER, vanish=50.0))
    return obj


def is_drawn(obj: bpy.types.Object) -> bool:
    bpy.context.view_layer.update()
    return len(evaluate(obj).polygons) > 0


def test_a_level_follows_the_view_and_again_the_camera(level: bpy.types.Object) -> None:
    assert not is_drawn(level)
    look_from(Vector((0.0, 49.0, 0.0)))
    assert is_drawn(level)
    look_from(Vector((0.0, 51.0, 0.0)))
    assert not is_drawn(level)
    look_from(None)
    bpy.context.scene.camera.location.x = 49.0
    assert is_drawn(level)


def test_the_eye_is_seen_from_where_the_tree_is(level: bpy.types.Object) -> None:
    level.matrix_world = Matrix.LocRotScale(Vector((500.0, 0.0, 0.0)), None, Vector((2.0, 2.0, 2.0)))
    look_from(Vector((500.0, 0.0, 99.0)))
    assert is_drawn(level)
    look_from(Vector((500.0, 0.0, 101.0)))
    assert not is_drawn(level)


def test_a_render_sees_from_the_camera(level: bpy.types.Object, tmp_path: Path) -> None:
    scene = bpy.context.scene
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 16.0
    scene.camera.rotation_euler = (1.5708, 0.0, 1.5708)
    scene.render.engine, scene.cycles.samples, scene.render.film_transparent = "CYCLES", 1, True
    scene.render.resolution_x = scene.render.resolution_y = 64

    def drawn() -> float:
        scene.render.filepath = str(tmp_path / "picture.png")
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(scene.render.filepath, check_existing=False)
        return sum(list(picture.pixels)[3::4])

    look_from(Vector((0.0, 1.0, 0.0)))
    assert drawn() == 0.0
    scene.camera.location.x = 49.0
    assert drawn() > 0.0


@pytest.mark.usefixtures("registered")
def test_nothing_of_the_view_stays_in_a_file(level: bpy.types.Object, tmp_path: Path) -> None:
    look_from(Vector((0.0, 1.0, 0.0)))
    assert place_of_eye() == Vector((0.0, 1.0, 0.0))
    name, path = level.name, str(tmp_path / "tree.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert place_of_eye() is None
    assert GROUP_NAME not in bpy.data.objects
    assert not is_drawn(bpy.data.objects[name])


def test_levels_of_a_file_share_one_eye(level: bpy.types.Object) -> None:
    second = place(build(FOUR), "Second")
    add_lod_modifier(second, LodSettings(centre=(0.0, 0.0, 0.0), start=NEVER, end=NEVER, vanish=10.0))
    assert len(eye_groups()) == 1
    look_from(Vector((0.0, 20.0, 0.0)))
    assert (is_drawn(level), is_drawn(second)) == (True, False)


def test_a_level_by_hand_needs_no_eye(level: bpy.types.Object) -> None:
    set_modifier_input(level.modifiers[0], "Manual", True)
    look_from(Vector((0.0, 51.0, 0.0)))
    assert is_drawn(level)


def test_a_linked_tree_follows_the_camera(level: bpy.types.Object, tmp_path: Path) -> None:
    path, name = str(tmp_path / "tree.blend"), level.name
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    camera = add_camera((FAR, 0.0, 0.0))
    with bpy.data.libraries.load(path, link=True) as (_, linked):
        linked.objects = [name]
    bpy.context.scene.collection.objects.link(linked.objects[0])
    look_from(Vector((0.0, 1.0, 0.0)))
    assert not is_drawn(linked.objects[0])
    camera.location.x = 49.0
    assert is_drawn(linked.objects[0])
    assert place_of_eye() is None


@pytest.mark.parametrize(
    ("perspective", "place"), [("PERSP", (1.0, 2.0, 13.0)), ("ORTHO", (1.0, 2.0, 13.0)), ("CAMERA", None)]
)
def test_the_place_of_a_view(perspective: str, place: tuple[float, float, float] | None) -> None:
    """The view looks down from 10 above the point that it turns about."""
    view = SimpleNamespace(
        view_perspective=perspective,
        view_location=Vector((1.0, 2.0, 3.0)),
        view_rotation=Quaternion(),
        view_distance=10.0,
        view_matrix=Matrix.Translation((-1.0, -2.0, -13.0)),
    )
    found = place_of(view)
    assert (None if found is None else tuple(found)) == place
