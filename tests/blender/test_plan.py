"""Scenes and the effects that they call for: each is built, read and planned, with the reason told to the artist."""

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
"""What is on of a plain crown where the viewer may be anywhere; back sides are left to each level."""

# At 1080 pixels over 50° a deviation of ε = 0.04 R is seen 8 pixels large from 5.79 R, one of 0.14 R from 20.3 R.


def test_a_still_camera_close_by_calls_for_nothing_but_the_leaves() -> None:
    crown = add_crown()
    add_camera(3.2, crown)
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == set()
    assert plan["back_sides"].on is False
    assert plan["transitions"].reason == "the camera stays 3.2 crown radii away, and level 1 takes over at 5.79"
    assert plan["far_levels"].reason == (
        "the camera stays 3.2 crown radii away, and level 2 takes over at 20.3: only level 1 is made"
    )
    assert plan["normals"].reason.endswith("no billboard is seen")


def test_only_pages_that_a_camera_may_see_are_packed_tightly() -> None:
    crown = add_crown()
    assert sees_pages(BakeSettings(), facts_of(crown))
    camera = add_camera(3.2, crown)
    assert not sees_pages(ONLY_THIS_VIEW, facts_of(crown, ONLY_THIS_VIEW))
    anywhere = BakeSettings(viewer="anywhere")
    assert sees_pages(anywhere, facts_of(crown, anywhere))
    camera.location.y *= 5.0
    assert sees_pages(ONLY_THIS_VIEW, facts_of(crown, ONLY_THIS_VIEW))


def test_a_still_camera_far_away_sees_one_level_and_no_hand_over() -> None:
    crown = add_crown()
    add_camera(12.0, crown)
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == {"normals"}
    assert plan["back_sides"].on is None
    assert plan["transitions"].reason == "the camera stays 12 crown radii away, and level 2 takes over at 20.3"


def test_a_camera_that_flies_through_sees_every_hand_over() -> None:
    crown = add_crown()
    camera = add_camera(3.0, crown)
    middle, radius = bounds(crown)
    fly(camera, (middle.x, middle.y - 3.0 * radius, middle.z), (middle.x, middle.y - 300.0 * radius, middle.z))
    plan = plan_of(crown)
    assert on(plan) == {"transitions", "far_levels", "normals"}
    assert plan["transitions"].reason == "the camera stays 3 to 300 crown radii away, and level 1 takes over at 5.79"


def test_a_camera_that_flies_about_within_one_level_sees_no_hand_over() -> None:
    crown = add_crown()
    camera = add_camera(1.0, crown)
    fly(camera, (0.0, -1.2, 0.0), (0.0, -1.8, 0.0), (0.5, -1.5, 0.0))
    assert on(plan_of(crown)) == set()


def test_at_night_one_lamp_that_moves_calls_for_normals() -> None:
    crown = add_crown()
    add_camera(12.0, crown)
    fly(add_light("POINT"), (-3.0, -2.0, 1.0), (3.0, -2.0, 1.0))
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == {"normals"}
    assert plan["normals"].reason.startswith("the lamp 'Point' moves or changes, so")
    unlit = plan_of(crown, BakeSettings(unlit=True, viewer="camera"))
    assert on(unlit) == set()
    assert unlit["baked_light"].reason == "the target is unlit, but the lamp 'Point' moves or changes"


def test_a_still_sun_lights_the_levels_as_blender_renders() -> None:
    crown = add_crown()
    add_camera(12.0, crown)
    add_light("SUN")
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == {"normals"}
    assert plan["normals"].reason.startswith("Blender lights the tree as it renders")


def test_an_unlit_game_gets_the_light_of_a_still_sun() -> None:
    crown = add_crown(principled("laurel", Subsurface_Weight=0.5))
    add_camera(3.0, crown)
    add_light("SUN")
    plan = plan_of(crown, BakeSettings(engine="three", unlit=True))
    assert on(plan) == {"transitions", "far_levels", "back_sides", "baked_light"}
    assert plan["baked_light"].reason == "the target is unlit, and the scene's lights do not change: 'Sun'"


def test_an_unlit_game_without_a_light_in_the_scene_gets_none() -> None:
    plan = plan_of(add_crown(), BakeSettings(engine="three", unlit=True))
    assert on(plan) == {"transitions", "far_levels"}
    assert "the scene has no light" in plan["baked_light"].reason


def test_leaves_that_differ_in_roughness_call_for_it_where_billboards_are_seen() -> None:
    crown = add_crown(principled("laurel", Roughness=0.2))
    crown.data.materials.append(principled("moss", Roughness=1.0))
    for polygon in crown.data.polygons[:10]:
        polygon.material_index = 1
    assert on(plan_of(crown)) == ANYWHERE | {"roughness_metallic"}
    add_camera(3.0, crown)
    plan = plan_of(crown, ONLY_THIS_VIEW)
    assert on(plan) == set()
    assert plan["roughness_metallic"].reason.endswith("no billboard is seen")


def test_opaque_leaves_that_are_all_alike_call_for_no_texture_beside_normals() -> None:
    plan = plan_of(add_crown(principled("leaf", Roughness=0.3)))
    assert on(plan) == ANYWHERE
    assert plan["roughness_metallic"].reason.startswith("roughness and metallic do not vary")
    assert plan["translucency"].reason == "no leaf material is translucent"


def test_a_wind_that_reaches_the_tree_moves_it() -> None:
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


def test_without_a_wind_there_is_none() -> None:
    plan = plan_of(add_crown())
    assert (plan["wind"].on, plan["wind"].reason) == (False, "no force field blows on the tree")


def test_a_hundred_trees_stand_on_every_level_and_change_none() -> None:
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


def test_one_tree_before_a_camera_that_nears_it_a_little() -> None:
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
def test_chains_that_prune_call_for_pruning_where_the_viewer_may_be_anywhere(chain: str, engine: str) -> None:
    plan = plan_of(add_crown(), BakeSettings(chain=chain, engine=engine, prune_pixels=24.0))
    assert plan["pruning"].on is True
    assert plan["pruning"].reason.endswith(f"so it may see {CARDS} leaves from far away")


@pytest.mark.parametrize("engine", ["generic", "godot", "three"])
def test_the_chain_of_billboards_prunes_nothing_and_calls_for_no_ranks(engine: str) -> None:
    assert plan_of(add_crown(), BakeSettings(chain="billboards", engine=engine))["pruning"].on is False


@pytest.mark.parametrize("settings", [BakeSettings(engine="godot"), BakeSettings(viewer="anywhere")])
def test_for_an_engine_or_if_asked_for_the_camera_does_not_count(settings: BakeSettings) -> None:
    crown = add_crown()
    add_camera(3.0, crown)
    assert on(plan_of(crown, settings)) == ANYWHERE


def keyed(owner: bpy.types.ID, path: str, *values: object) -> None:
    """Gives a property these values, evenly over the frames."""
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 10 * len(values) - 9
    for number, value in enumerate(values):
        setattr(owner, path, value)
        owner.keyframe_insert(path, frame=1 + 10 * number)
    bpy.context.scene.frame_set(1)


def test_a_camera_that_stands_still_says_nothing_about_who_looks() -> None:
    crown = add_crown()
    camera = add_camera(3.0, crown)
    plan = plan_of(crown)
    assert on(plan) == ANYWHERE
    assert plan["far_levels"].reason.startswith("the camera stands still, and the viewer may be anywhere, so ")
    keyed(camera, "location", camera.location.copy(), camera.location.copy())
    assert on(plan_of(crown)) == ANYWHERE, "keys that hold it still"


@pytest.mark.parametrize("what", ["turns", "zooms", "orbits", "sees trees pass", "gives way"])
def test_a_camera_that_is_animated_is_planned_by(what: str) -> None:
    """It stays near the tree all the time, in one place or on a circle about it, where only the leaves are seen."""
    crown = add_crown()
    camera = add_camera(3.0, crown)
    assert facts_of(crown).camera is None
    middle, radius = bounds(crown)
    if what == "turns":
        keyed(camera, "rotation_euler", (0.0, 0.0, 0.0), (0.0, 0.0, 0.5))
    elif what == "zooms":
        keyed(camera.data, "lens", 20.0, 35.0)
    elif what == "orbits":
        turntable = bpy.data.objects.new("turntable", None)
        bpy.context.scene.collection.objects.link(turntable)
        turntable.location, camera.parent, camera.location = middle, turntable, (0.0, -3.0 * radius, 0.0)
        keyed(turntable, "rotation_euler", (0.0, 0.0, 0.0), (0.0, 0.0, 3.0))
    elif what == "sees trees pass":
        fly(crown, (0.0, 0.0, 0.0), (0.0, 0.3 * radius, 0.0))
    else:
        other = add_camera(3.0, crown)
        for frame, each in ((1, camera), (10, other)):
            bpy.context.scene.timeline_markers.new(each.name, frame=frame).camera = each
    facts = facts_of(crown)
    assert facts.camera is not None
    assert facts.camera.farthest == pytest.approx((3.3 if what == "sees trees pass" else 3.0) * radius, rel=1e-3)
    assert not on(plan_of(crown)) & {"far_levels", "normals"}


def test_a_camera_that_hangs_on_what_moves_is_followed() -> None:
    crown = add_crown()
    camera = add_camera(3.0, crown)
    rail = bpy.data.objects.new("rail", None)
    bpy.context.scene.collection.objects.link(rail)
    camera.parent = rail
    fly(rail, (0.0, 0.0, 0.0), (0.0, -40.0, 0.0))
    assert "transitions" in on(plan_of(crown))


def test_a_constraint_that_copies_what_moves_is_followed() -> None:
    crown = add_crown()
    camera = add_camera(3.0, crown)
    rail = bpy.data.objects.new("rail", None)
    bpy.context.scene.collection.objects.link(rail)
    camera.constraints.new("COPY_LOCATION").target = rail
    fly(rail, (0.0, -3.0, 0.0), (0.0, -40.0, 0.0))
    facts = facts_of(crown)
    assert facts.camera is not None
    assert facts.camera.farthest == pytest.approx(40.0, rel=0.02)


def test_markers_cut_between_cameras() -> None:
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


def test_reading_a_scene_leaves_its_frame() -> None:
    crown = add_crown()
    fly(add_camera(3.0, crown), (0.0, -3.0, 0.0), (0.0, -300.0, 0.0))
    bpy.context.scene.frame_set(7, subframe=0.25)
    before = bpy.context.scene.camera.matrix_world.copy()
    facts_of(crown)
    assert (bpy.context.scene.frame_current, bpy.context.scene.frame_subframe) == (7, 0.25)
    assert bpy.context.scene.camera.matrix_world == before


def test_a_copy_twice_as_large_is_seen_from_half_as_far() -> None:
    crown = add_crown()
    add_camera(10.0, crown)
    other = bpy.data.objects.new("large", crown.data)
    other.matrix_world = Matrix.Scale(2.0, 4)
    bpy.context.scene.collection.objects.link(other)
    facts = facts_of(crown, ONLY_THIS_VIEW)
    assert facts.camera is not None
    (own, _), (large, _) = facts.camera.spans
    assert large == pytest.approx(own / 2.0, rel=0.02)


def test_only_leaves_of_several_colours_have_a_contrast_to_keep() -> None:
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
