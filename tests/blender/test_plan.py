"""Scenes and their planned effects. Each test builds and reads a scene, then checks the plan and its reasons."""

from __future__ import annotations

import math

import bpy
import pytest
from mathutils import Matrix
from plan_scenes import (
    CARDS,
    ONLY_THIS_VIEW,
    add_camera,
    add_crown,
    add_light,
    add_wind,
    bounds,
    copies,
    facts_of,
    fly,
    on,
    plan_of,
    principled,
)

from addon.plan.effects import sees_pages
from addon.settings.bake import BakeSettings

ANYWHERE = {"transitions", "far_levels", "normals"}
"""Effects of a plain crown for a viewer anywhere. Each level decides about back sides itself."""

# At 1080 pixels over 50° a crown is 540 pixels large at 4.29 R, and 180 at 12.9 R.


def test_a_still_camera_near_the_tree_needs_no_effects() -> None:
    crown = add_crown()
    add_camera(3.2, crown)
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == set()
    assert plan["back_sides"].on is False
    assert (
        plan["transitions"].reason
        == "the camera stays 3.2 crown radii away, and level 1 takes over between 4.29 and 297"
    )
    assert plan["far_levels"].reason == (
        "the camera stays 3.2 crown radii away, and level 2 takes over between 12.9 and 371: only level 1 is made"
    )
    assert plan["normals"].reason.endswith("no billboard is seen")


def test_atlas_pages_are_packed_tightly_if_a_camera_may_see_them() -> None:
    crown = add_crown()
    assert sees_pages(BakeSettings(), facts_of(crown))
    camera = add_camera(3.2, crown)
    assert not sees_pages(ONLY_THIS_VIEW, facts_of(crown, ONLY_THIS_VIEW))
    anywhere = BakeSettings(viewer="anywhere")
    assert sees_pages(anywhere, facts_of(crown, anywhere))
    camera.location.y *= 5.0
    assert sees_pages(ONLY_THIS_VIEW, facts_of(crown, ONLY_THIS_VIEW))


def test_a_still_camera_far_away_needs_no_transitions() -> None:
    crown = add_crown()
    add_camera(12.0, crown)
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == {"normals"}
    assert plan["back_sides"].on is None
    assert plan["transitions"].reason == "the camera stays 12 crown radii away, and no tree is seen changing levels"


def test_a_camera_that_passes_all_switch_distances_needs_transitions() -> None:
    crown = add_crown()
    camera = add_camera(3.0, crown)
    middle, radius = bounds(crown)
    fly(camera, (middle.x, middle.y - 3.0 * radius, middle.z), (middle.x, middle.y - 300.0 * radius, middle.z))
    plan = plan_of(crown)
    assert on(plan) == {"transitions", "far_levels", "normals"}
    assert (
        plan["transitions"].reason
        == "the camera stays 3 to 300 crown radii away, and level 1 takes over between 4.29 and 297"
    )


def test_a_camera_that_moves_within_one_level_needs_no_transitions() -> None:
    crown = add_crown()
    camera = add_camera(1.0, crown)
    fly(camera, (0.0, -1.2, 0.0), (0.0, -1.8, 0.0), (0.5, -1.5, 0.0))
    assert on(plan_of(crown)) == set()


def test_a_moving_lamp_turns_on_normals() -> None:
    crown = add_crown()
    add_camera(12.0, crown)
    fly(add_light("POINT"), (-3.0, -2.0, 1.0), (3.0, -2.0, 1.0))
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == {"normals"}
    assert plan["normals"].reason.startswith("the lamp 'Point' moves or changes, so")
    unlit = plan_of(crown, BakeSettings(unlit=True, viewer="camera"))
    assert on(unlit) == set()
    assert unlit["baked_light"].reason == "the target is unlit, but the lamp 'Point' moves or changes"


def test_a_still_sun_turns_on_normals() -> None:
    crown = add_crown()
    add_camera(12.0, crown)
    add_light("SUN")
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == {"normals"}
    assert plan["normals"].reason.startswith("Blender lights the tree as it renders")


def test_an_unlit_target_gets_the_baked_light_of_a_still_sun() -> None:
    crown = add_crown(principled("laurel", Subsurface_Weight=0.5))
    add_camera(3.0, crown)
    add_light("SUN")
    plan = plan_of(crown, BakeSettings(engine="three", unlit=True))
    assert on(plan) == {"transitions", "far_levels", "back_sides", "baked_light"}
    assert plan["baked_light"].reason == "the target is unlit, and the scene's lights do not change: 'Sun'"


def test_an_unlit_target_gets_no_baked_light_from_a_dark_scene() -> None:
    plan = plan_of(add_crown(), BakeSettings(engine="three", unlit=True))
    assert on(plan) == {"transitions", "far_levels"}
    assert "the scene has no light" in plan["baked_light"].reason


def test_leaves_of_different_roughness_need_a_texture_if_billboards_are_seen() -> None:
    crown = add_crown(principled("laurel", Roughness=0.2))
    crown.data.materials.append(principled("moss", Roughness=1.0))
    for polygon in crown.data.polygons[:10]:
        polygon.material_index = 1
    assert on(plan_of(crown)) == ANYWHERE | {"roughness_metallic"}
    add_camera(3.0, crown)
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == set()
    assert plan["roughness_metallic"].reason.endswith("no billboard is seen")


def test_opaque_leaves_of_one_material_need_no_texture_except_normals() -> None:
    plan = plan_of(add_crown(principled("leaf", Roughness=0.3)))
    assert on(plan) == ANYWHERE
    assert plan["roughness_metallic"].reason.startswith("roughness and metallic do not vary")
    assert plan["translucency"].reason == "no leaf material is translucent"


def test_a_force_field_that_reaches_the_tree_turns_on_wind() -> None:
    crown = add_crown()
    add_wind(2.5, (0.0, math.pi / 2.0, 0.0))
    far = add_wind(7.0, (0.0, 0.0, 0.0))
    far.location = (100.0, 0.0, 0.0)
    far.field.use_max_distance, far.field.distance_max = True, 50.0
    add_wind(0.0, (0.0, 0.0, 0.0))
    wind = facts_of(crown).wind
    assert wind is not None
    assert wind.strength == 2.5
    assert wind.direction == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)
    plan = plan_of(crown)
    assert on(plan) == {*ANYWHERE, "wind"}
    assert plan["wind"].reason == f"the force field {wind.field!r} blows on the tree"


def test_wind_is_off_without_a_force_field() -> None:
    plan = plan_of(add_crown())
    assert (plan["wind"].on, plan["wind"].reason) == (False, "no force field blows on the tree")


def test_a_hundred_trees_show_every_level_without_transitions() -> None:
    crown = add_crown()
    add_camera(3.0, crown)
    copies(crown, 100, 4.0)
    facts = facts_of(crown, ONLY_THIS_VIEW)
    assert facts.camera is not None
    assert len(facts.camera.spans) == 100
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == {"pruning", "far_levels", "normals"}
    assert plan["transitions"].reason.endswith("no tree is seen changing levels")
    assert plan["pruning"].reason.startswith("the camera sees the 100 trees from 3 to ")


def test_a_camera_that_crosses_one_switch_distance_needs_no_far_levels() -> None:
    crown = add_crown()
    camera = add_camera(3.0, crown)
    middle, radius = bounds(crown)
    fly(camera, *((middle.x, middle.y - radii * radius, middle.z) for radii in (8.0, 4.0)))
    plan = plan_of(crown)
    assert on(plan) == {"transitions", "normals"}
    assert plan["far_levels"].on is False


def test_without_a_camera_the_viewer_may_be_anywhere() -> None:
    plan = plan_of(add_crown())
    assert on(plan) == ANYWHERE
    assert plan["pruning"].reason == "`chain=billboards` keeps all leaves until level 1 takes over"


@pytest.mark.parametrize("chain", ["pruning", "both"])
@pytest.mark.parametrize("engine", ["generic", "three"])
def test_chains_that_prune_turn_on_pruning_for_a_viewer_anywhere(chain: str, engine: str) -> None:
    plan = plan_of(add_crown(), BakeSettings(chain=chain, engine=engine, prune_pixels=24.0))
    assert plan["pruning"].on is True
    assert plan["pruning"].reason.endswith(f"so it may see {CARDS} leaves from far away")


@pytest.mark.parametrize("engine", ["generic", "godot", "three"])
def test_the_chain_of_billboards_turns_off_pruning(engine: str) -> None:
    assert plan_of(add_crown(), BakeSettings(chain="billboards", engine=engine))["pruning"].on is False


@pytest.mark.parametrize("settings", [BakeSettings(engine="godot"), BakeSettings(viewer="anywhere")])
def test_the_camera_is_ignored_for_an_engine_and_for_a_viewer_anywhere(settings: BakeSettings) -> None:
    crown = add_crown()
    add_camera(3.0, crown)
    assert on(plan_of(crown, settings)) == ANYWHERE


def keyed(owner: bpy.types.ID, path: str, *values: object) -> None:
    """Keyframe a property with these values, ten frames apart."""
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 10 * len(values) - 9
    for number, value in enumerate(values):
        setattr(owner, path, value)
        owner.keyframe_insert(path, frame=1 + 10 * number)
    bpy.context.scene.frame_set(1)


def test_a_still_camera_is_ignored() -> None:
    crown = add_crown()
    camera = add_camera(3.0, crown)
    plan = plan_of(crown)
    assert on(plan) == ANYWHERE
    assert plan["far_levels"].reason.startswith("the camera stands still, and the viewer may be anywhere, so ")
    keyed(camera, "location", camera.location.copy(), camera.location.copy())
    assert on(plan_of(crown)) == ANYWHERE, "two equal keys keep the camera still"


@pytest.mark.parametrize("motion", ["turns", "zooms", "orbits", "trees move", "switches"])
def test_an_animated_camera_is_used(motion: str) -> None:
    """The camera stays near the tree, in one place or on a circle around the tree. So it sees only the leaves."""
    crown = add_crown()
    camera = add_camera(3.0, crown)
    assert facts_of(crown).camera is None
    middle, radius = bounds(crown)
    if motion == "turns":
        keyed(camera, "rotation_euler", (0.0, 0.0, 0.0), (0.0, 0.0, 0.5))
    elif motion == "zooms":
        keyed(camera.data, "lens", 20.0, 35.0)
    elif motion == "orbits":
        turntable = bpy.data.objects.new("turntable", None)
        bpy.context.scene.collection.objects.link(turntable)
        turntable.location, camera.parent, camera.location = middle, turntable, (0.0, -3.0 * radius, 0.0)
        keyed(turntable, "rotation_euler", (0.0, 0.0, 0.0), (0.0, 0.0, 3.0))
    elif motion == "trees move":
        fly(crown, (0.0, 0.0, 0.0), (0.0, 0.3 * radius, 0.0))
    else:
        other = add_camera(3.0, crown)
        for frame, each in ((1, camera), (10, other)):
            bpy.context.scene.timeline_markers.new(each.name, frame=frame).camera = each
    facts = facts_of(crown)
    assert facts.camera is not None
    assert facts.camera.farthest == pytest.approx((3.3 if motion == "trees move" else 3.0) * radius, rel=1e-3)
    assert not on(plan_of(crown)) & {"far_levels", "normals"}


def test_a_camera_with_a_moving_parent_is_followed() -> None:
    crown = add_crown()
    camera = add_camera(3.0, crown)
    rail = bpy.data.objects.new("rail", None)
    bpy.context.scene.collection.objects.link(rail)
    camera.parent = rail
    fly(rail, (0.0, 0.0, 0.0), (0.0, -40.0, 0.0))
    assert "transitions" in on(plan_of(crown))


def test_a_camera_constrained_to_a_moving_object_is_followed() -> None:
    crown = add_crown()
    camera = add_camera(3.0, crown)
    rail = bpy.data.objects.new("rail", None)
    bpy.context.scene.collection.objects.link(rail)
    camera.constraints.new("COPY_LOCATION").target = rail
    fly(rail, (0.0, -3.0, 0.0), (0.0, -40.0, 0.0))
    facts = facts_of(crown)
    assert facts.camera is not None
    assert facts.camera.farthest == pytest.approx(40.0, rel=0.02)


def test_timeline_markers_switch_between_cameras() -> None:
    crown = add_crown()
    near, far = add_camera(3.0, crown), add_camera(30.0, crown)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.camera = 1, 20, near
    for frame, camera in ((1, near), (10, far)):
        scene.timeline_markers.new(camera.name, frame=frame).camera = camera
    radius = bounds(crown)[1]
    facts = facts_of(crown)
    assert facts.camera is not None
    assert (facts.camera.nearest, facts.camera.farthest) == pytest.approx((3.0 * radius, 30.0 * radius), rel=1e-4)
    assert (scene.camera, scene.frame_current) == (near, 1)


def test_reading_a_scene_keeps_its_frame() -> None:
    crown = add_crown()
    fly(add_camera(3.0, crown), (0.0, -3.0, 0.0), (0.0, -300.0, 0.0))
    bpy.context.scene.frame_set(7, subframe=0.25)
    before = bpy.context.scene.camera.matrix_world.copy()
    facts_of(crown)
    assert (bpy.context.scene.frame_current, bpy.context.scene.frame_subframe) == (7, 0.25)
    assert bpy.context.scene.camera.matrix_world == before


def test_a_copy_twice_as_large_has_half_the_distance_in_crown_radii() -> None:
    crown = add_crown()
    add_camera(10.0, crown)
    other = bpy.data.objects.new("large", crown.data)
    other.matrix_world = Matrix.Scale(2.0, 4)
    bpy.context.scene.collection.objects.link(other)
    facts = facts_of(crown, ONLY_THIS_VIEW)
    assert facts.camera is not None
    (own, _), (large, _) = facts.camera.spans
    assert large == pytest.approx(own / 2.0, rel=0.02)


def test_contrast_is_on_only_for_leaves_of_several_colors() -> None:
    crown = add_crown()
    settings = BakeSettings(chain="both", prune_pixels=24.0)
    plan = plan_of(crown, settings)
    assert plan["contrast"].on is False
    assert plan["contrast"].reason == "all leaves have the same color, so there is no contrast to keep"
    pale = principled("pale leaf")
    pale.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.5, 0.6, 0.2, 1.0)
    crown.data.materials.append(pale)
    for polygon in crown.data.polygons:
        polygon.material_index = polygon.index % 2
    assert plan_of(crown, settings)["contrast"].on is True
