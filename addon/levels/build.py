"""Creation of the level objects: the leaves, the clouds, and each level's trunk, with modifiers for their distances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial

import bpy
import numpy as np

import leafcloud

from ..mesh.baked_levels import EXTRAS
from ..nodes.laws import NEVER
from ..nodes.lod import LodSettings, add_lod_modifier, lod_group
from ..plan.lod_range import LodRange, shows_trunk, trunk_range
from ..plan.trunk_limits import MOST_CHANGE, trunk_limits
from ..steps import Steps, threads, timed, waited
from .building import Build, BuiltLevel, y_up
from .clouds import cloud_object
from .leaves import later_leaf_object, leaf_object
from .mesh import read_own_randoms
from .octahedral import octahedral_object
from .rollback import removed_on_failure
from .root import add_root, follow_distance, put_below
from .sunlight import dim_in_cycles, share_of_cross
from .trunk import Kept, Trunk, TrunkView, simplified, trunks, unrolled

NO_CLOUDS = (leafcloud.LeafLevel, leafcloud.OctahedralLevel)
"""Levels without billboards."""


def build_levels(build: Build) -> Steps[tuple[bpy.types.Collection, list[BuiltLevel]]]:
    """Create all levels in a new collection that is not yet in any scene. Return the collection and the levels.

    In steps: one for the mesh of each level, one for its modifiers, one for each effect and each image. Meanwhile other
    threads simplify the trunk, measure the light of the cross impostor and encode the images.

    Meshes are in the tree's coordinates, the root above all objects has the tree's matrix. If the camera sees a single
    level and there are neither transitions nor pruning, only that level is shown. On failure everything created is
    removed.
    """
    with removed_on_failure(), closing(build.images), threads(1) as thread:
        light = thread.submit(timed, partial(share_of_cross, build))
        kept = thread.submit(timed, _kept_trunks(build))
        collection = bpy.data.collections.new(build.name)
        root = add_root(collection, build)
        objects = yield from _objects(build)
        if build.follows_camera:
            lod_group()  # Blender takes a fifth of a second for its nodes.
            yield
        share, seconds = yield from waited(light)
        if share is not None:
            build.costs.add_seconds("far_levels", seconds)
            dim_in_cycles(objects[-1].data.materials[0], share)
        found, seconds = yield from waited(kept)
        if len({*found}) > 1:
            build.costs.add_seconds("trunk_levels", seconds)
            build.costs.add_bytes("trunk_levels", sum(each.nbytes for each in {*found[1:]} - {found[0]}))
        made = trunks(f"{build.name}_trunk", found)
        yield
        levels = yield from _levels(root, objects, made, build)
        for effect in build.effects:
            with build.costs.spent_on(effect.name):
                effect.add_to_tree(collection, build)
            yield
        yield from build.images.packed()
    return collection, levels


def _objects(build: Build) -> Steps[list[bpy.types.Object]]:
    """Create the objects of all levels, without modifiers, the leaves first."""
    objects, behind = [leaf_object(build)], build.chain.levels
    yield
    for number, (level, following) in enumerate(zip(behind, [*behind[1:], None], strict=True), start=1):
        objects.append(_object(level, following, number, build))
        yield
    return objects


def _levels(
    root: bpy.types.Object, objects: Sequence[bpy.types.Object], trunks: Sequence[Trunk], build: Build
) -> Steps[list[BuiltLevel]]:
    """Add trunks, which the last levels may lack, modifiers and the effects of the clouds."""
    levels = []
    for number, (level, obj) in enumerate(zip([None, *build.chain.levels], objects, strict=True)):
        built = _add_level(root, obj, number, trunks[number] if number < len(trunks) else None, build)
        if level is not None and not isinstance(level, NO_CLOUDS):
            for effect in build.charged():
                built = effect.add_to_cloud(built, level, build)
        levels.append(built)
        yield
    return levels


def _object(
    level: leafcloud.AnyLevel, following: leafcloud.AnyLevel | None, number: int, build: Build
) -> bpy.types.Object:
    """Create the object of level `number`. `following`: the next level, None after the last."""
    if isinstance(level, leafcloud.LeafLevel):
        return later_leaf_object(level, number, build)
    if isinstance(level, leafcloud.OctahedralLevel):
        return octahedral_object(level, number, build)
    return cloud_object(level, None if isinstance(following, NO_CLOUDS) else following, number, build)


def _kept_trunks(build: Build) -> Callable[[], list[Kept]]:
    """Return work that does not touch Blender: it finds the trunk of every level, the leaves first.

    Impostors get none: their textures show the trunk. A tree without trunk has an empty list.
    """
    tree, pixels = build.tree, build.schedule.trunk_pixels
    if tree.trunk is None:
        return list
    first = Kept(tree.trunk)
    near = [
        level
        for level in build.chain.levels
        if not isinstance(level, leafcloud.OctahedralLevel) and not shows_trunk(level)
    ]
    if not pixels:
        return lambda: [first, *(first for _ in near)]
    whole_tree = len(tree.leaves.triangles) + len(tree.trunk.triangles)
    leaf_levels = len(build.leaf_levels)
    limits = trunk_limits([level.triangles for level in near[leaf_levels:]], whole_tree, build.schedule.triangles)
    # Beside leaves only the picture limits the trunk.
    limits = (*[len(tree.trunk.triangles)] * leaf_levels, *limits)
    none = np.empty(0, np.uint32)
    twigs = [none] * leaf_levels + (build.chain.twigs or [none] * len(build.chain.clouds))
    changes = [MOST_CHANGE] * len(near)
    if build.schedule.triangles is not None and leaf_levels < len(near):
        changes[leaf_levels] = 1.0  # The wished number of triangles of the first cloud comes before the picture.
    views = [TrunkView(*view) for view in zip(near, pixels, limits, twigs, changes, strict=False)]
    geometry = unrolled(tree.trunk)

    def work() -> list[Kept]:
        return [first, *simplified(first, geometry, tree.matrix, views)]

    return work


def _triangles(obj: bpy.types.Object) -> int:
    """Return the number of triangles that the object's polygons divide into."""
    return len(obj.data.loops) - 2 * len(obj.data.polygons)


def _add_level(
    root: bpy.types.Object, obj: bpy.types.Object, number: int, trunk: Trunk | None, build: Build
) -> BuiltLevel:
    """Put `obj` and its child trunk below the root. Set their transforms, custom properties and modifiers."""
    ranges, [collection] = build.schedule.lod_ranges, root.users_collection
    put_below(root, obj)
    obj[EXTRAS]["centre"], obj[EXTRAS]["radius"] = y_up(build.centre), build.radius
    members = {obj: ranges[number]}
    trunk_object = None
    if trunk is not None and trunk.mesh is not None:
        trunk_object = bpy.data.objects.new(f"{obj.name}_trunk", trunk.mesh)
        trunk_object.parent = obj
        members[trunk_object] = trunk_range(ranges, number)
    for member, lod_range in members.items():
        collection.objects.link(member)
        if number < build.first_cloud or member is trunk_object:
            read_own_randoms(member)
        if build.follows_camera:
            add_lod_modifier(member, _lod_settings(lod_range, build, prunes=number == 0 and member is obj))
        else:
            member.hide_viewport = member.hide_render = number not in build.schedule.drawn
        for effect in build.charged():
            effect.add_to_member(member, lod_range, build)
        follow_distance(root, member)
    built = BuiltLevel(number, obj, trunk_object, _triangles(obj))
    if trunk is None:
        return built
    kept = trunk.kept
    return replace(built, trunk_triangles=kept.triangles, trunk_change=kept.change, trunk_corners=kept.corners)


def _lod_settings(lod_range: LodRange, build: Build, *, prunes: bool) -> LodSettings:
    """Return the node group's inputs. `prunes`: prune as planned; else prune nothing while the level is drawn."""

    def own(distance: float) -> float:
        return min(distance / build.tree.scale, NEVER)

    pruning, chain = build.schedule.pruning, build.chain
    prunes = prunes and pruning.start < lod_range.vanish
    return LodSettings(
        start=own(lod_range.start),
        end=own(lod_range.end),
        prune_start=own(pruning.start if prunes else lod_range.vanish),
        prune_half=pruning.half,
        growth=chain.growth if prunes else (0.0, 0.0),
        contrast=chain.contrast if prunes and build.has("contrast") else (0.0, 0.0),
        appear=own(lod_range.appear),
        vanish=own(lod_range.vanish),
        fade_in_end=own(lod_range.fade_in_end),
        fade_out_start=own(lod_range.fade_out_start),
        centre=build.centre,
    )
