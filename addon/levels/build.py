"""Creation of the level objects: LOD 0 from the tree's leaves, the billboard clouds, and each level's trunk."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

import leafcloud

from ..material.shading import USUAL_SPECULAR
from ..mesh.baked_levels import EXTRAS
from ..mesh.extract import Geometry, Tree, world_positions
from ..mesh.placement import Placement, y_up
from ..nodes.laws import NEVER
from ..nodes.lod import LodSettings, add_lod_modifier
from ..nodes.sides import add_side_modifier, apart
from ..nodes.wind import WindSettings, add_wind_modifier
from ..plan.lod_range import LodRange, trunk_range
from ..plan.pruning import Thinning
from ..scene.light import Light
from . import morphs
from .baked_light import add_light, lit_material, unlit_material
from .contrast import contrast_material
from .fading import add_fade, fading_copy
from .leaf_map import add_leaf_map
from .leaf_moves import LeafMoves, leaf_moves
from .material import Page, atlas_image, atlas_material, layer_names, with_opaque_parts
from .mesh import Surface, create_mesh, fan_surface, fans, read_own_randoms, split_vertices, triangle_surface
from .morphs import Pruning, Transition
from .prune_tables import PREFIX_STEPS, area_shares, prefix_table
from .rollback import removed_on_failure
from .trunk import Trunk, simplified, whole
from .wind_attributes import WindAttributes, add_wind_attributes, freedom, phases, plane_pivots, wind_extras


@dataclass
class Costs:
    """Seconds and bytes spent on each effect so far, by effect name."""

    seconds: dict[str, float] = field(default_factory=dict)
    bytes: dict[str, int] = field(default_factory=dict)

    @contextmanager
    def spent_on(self, effect: str, nbytes: int) -> Iterator[None]:
        """Add the block's running time and `nbytes` to the costs of `effect`."""
        begin = time.perf_counter()
        yield
        self.seconds[effect] = self.seconds.get(effect, 0.0) + time.perf_counter() - begin
        self.bytes[effect] = self.bytes.get(effect, 0) + nbytes


@dataclass(frozen=True)
class Plan:
    """Build instructions: the name of the collection, the tree's placement, the effects that are on, the LOD ranges.

    centre, radius: bounding sphere of the foliage, in the tree's coordinates. Distances are measured from the center.
    switch_distances, lod_ranges: one per level, the leaves first, in world units.
    roughness, metallic: the leaves' values, used if the level has no roughness and metallic texture.
    specular: the leaves' Specular IOR Level.
    share: fraction of the light that the leaves transmit, used with a translucency texture.
    light: baked light of the leaves; None without baked light. Materials multiply it by light_strength.
    """

    name: str
    placement: Placement
    centre: tuple[float, float, float]
    radius: float
    transitions: bool
    pruning: bool
    switch_distances: tuple[float, ...]
    lod_ranges: tuple[LodRange, ...]
    drawn: range = range(1)
    """Levels that the camera sees. A single one is always shown if there are neither transitions nor pruning."""
    thinning: Thinning = field(default_factory=Thinning)
    growth: tuple[float, float] = (0.0, 0.0)
    """Further growth of pruned leaves, a factor on the scale that keeps their area (`leafcloud.Chain.growth`)."""
    contrast: tuple[float, float] | None = None
    """Contrast that pruned leaves keep (`leafcloud.Chain.contrast`); None leaves colors unchanged."""
    mean_color: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Mean color of the visible leaves, linear."""
    roughness: float = 1.0
    metallic: float = 0.0
    specular: float = USUAL_SPECULAR
    occlusion: bool = False
    share: float = 0.0
    light: Light | None = None
    light_strength: float = 1.0
    trunk_errors: tuple[float, ...] = ()
    """Maximum deviation of the trunk from the input for level 1, 2 …, in world units; empty: no simplification."""
    gloss_for: str = "gloss"
    """The effect that is charged for the image of occlusion, roughness and metallic."""
    wind: WindSettings | None = None
    """Wind and tree measurements; None without wind. The levels' own `start`, `end` and center come from this plan."""
    owners: tuple[int, ...] = ()
    """For each material number in the leaf map, the index of the leaf material; empty if the numbers are equal."""

    @property
    def follows_camera(self) -> bool:
        return self.transitions or self.pruning or len(self.drawn) > 1


@dataclass(frozen=True)
class BuiltLevel:
    """One level in Blender.

    triangles: triangles of the object, without the trunk.
    trunk_error: measured deviation of the trunk from LOD 0's, in world units.
    apart: offset of front and back billboards along their normals (`side_nodes`), in the object's own units; 0 without
    such pairs.
    trunk_corners: kept corners of LOD 0's trunk, as `Trunk.corners`.
    """

    number: int
    object: bpy.types.Object
    trunk: bpy.types.Object | None
    triangles: int
    trunk_triangles: int = 0
    trunk_error: float = 0.0
    apart: float = 0.0
    trunk_corners: NDArray[np.integer[Any]] | None = field(default=None, repr=False, compare=False)


@dataclass(frozen=True)
class _Shape:
    """The data of a level's mesh: its faces in pruning order, the rank of each face, and the vertex attributes."""

    surface: Surface
    ranks: NDArray[np.float32]
    pruning: Pruning | None = None
    transition: Transition | None = None
    light: Light | None = None
    """(c, 3) for each side, one row per corner of the mesh."""
    wind_attributes: WindAttributes | None = None


def build_levels(
    tree: Tree, foliage: leafcloud.Foliage, chain: leafcloud.Chain, plan: Plan, costs: Costs
) -> tuple[bpy.types.Collection, list[BuiltLevel]]:
    """Create all levels in a new collection that is not yet in any scene. Return the collection and the levels.

    Meshes are in the tree's coordinates, objects have the tree's matrix. If the camera sees a single level and there
    are neither transitions nor pruning, only that level is shown. On failure everything created is removed.
    """
    with removed_on_failure():
        collection = bpy.data.collections.new(plan.name)
        trunks = _trunks(tree, chain, plan, costs)
        levels = [_add_level(collection, _leaf_object(tree, foliage, chain, plan, costs), 0, trunks[0], plan, costs)]
        behind = chain.levels
        own = [tree.leaves.materials[owner] for owner in plan.owners] or tree.leaves.materials
        for number, (level, following) in enumerate(zip(behind, [*behind[1:], None], strict=True), start=1):
            obj = _cloud_object(level, _cloud_or_none(following), number, plan, costs)
            if level.leaf_uv is not None and level.leaf_id is not None:
                with costs.spent_on("leaf_map", _own_bytes(level, level.leaf_uv) + _own_bytes(level, level.leaf_id)):
                    _add_leaf_map(obj, level.leaf_uv, level.leaf_id, own)
            built = _add_level(collection, obj, number, trunks[number], plan, costs)
            if level.two_sided:
                built = replace(built, apart=apart(level.corners, number) / plan.placement.scale)
                add_side_modifier(obj, built.apart)
            levels.append(built)
    return collection, levels


def _trunks(tree: Tree, chain: leafcloud.Chain, plan: Plan, costs: Costs) -> list[Trunk | None]:
    """Return the trunk of every level, the leaves first. None for the cross impostor: its textures show the trunk."""
    clouds = [level for level in chain.levels if level.cloud is not None]
    crosses = [None] * (len(chain.levels) - len(clouds))
    if tree.trunk is None:
        return [None, *(None for _ in clouds), *crosses]
    first = whole(f"{plan.name}_trunk", tree.trunk)
    if not plan.trunk_errors:
        return [first, *(first for _ in clouds), *crosses]
    with costs.spent_on("trunk_levels", 0):
        coarser = simplified(first, tree.trunk, plan.placement, plan.trunk_errors[: len(clouds)])
    costs.bytes["trunk_levels"] = sum({id(trunk): trunk.nbytes for trunk in coarser if trunk is not first}.values())
    return [first, *coarser, *crosses]


def _add_level(
    collection: bpy.types.Collection, obj: bpy.types.Object, number: int, trunk: Trunk | None, plan: Plan, costs: Costs
) -> BuiltLevel:
    """Link `obj` and its child trunk to the collection. Set their transforms, custom properties and modifiers."""
    obj.matrix_world = Matrix(plan.placement.matrix.tolist())
    obj[EXTRAS]["centre"], obj[EXTRAS]["radius"] = y_up(plan.centre), plan.radius
    members = {obj: plan.lod_ranges[number]}
    trunk_object = None
    if trunk is not None and trunk.mesh is not None:
        trunk_object = bpy.data.objects.new(f"{obj.name}_trunk", trunk.mesh)
        trunk_object.parent = obj
        members[trunk_object] = trunk_range(plan.lod_ranges, number)
    for member, lod_range in members.items():
        collection.objects.link(member)
        if number == 0 or member is trunk_object:
            read_own_randoms(member)
        if lod_range.fades and (number == 0 or member is trunk_object):
            with costs.spent_on("transitions", 0):
                _let_fade(member)
        if plan.follows_camera:
            add_lod_modifier(member, _lod_settings(lod_range, plan, thins=number == 0 and member is obj))
        else:
            member.hide_viewport = member.hide_render = number not in plan.drawn
    if plan.wind is not None:
        with costs.spent_on("wind", 0):
            for member, lod_range in members.items():
                way = _lod_settings(lod_range, plan, thins=False)
                wind = replace(plan.wind, start=way.start, end=way.end, centre=plan.centre)
                add_wind_modifier(member, wind)
                if member is obj:
                    obj[EXTRAS]["wind"] = wind_extras(wind)
    triangles = len(obj.data.loops) - 2 * len(obj.data.polygons)
    built = BuiltLevel(number, obj, trunk_object, triangles)
    if trunk is None:
        return built
    return replace(built, trunk_triangles=trunk.triangles, trunk_error=trunk.error, trunk_corners=trunk.corners)


def _let_fade(obj: bpy.types.Object) -> None:
    """Assign fading copies of the materials to the object.

    The mesh keeps the artist's materials, because other objects and files use the mesh.
    """
    for slot in obj.material_slots:
        material = slot.material
        slot.link, slot.material = "OBJECT", fading_copy(material)


def _lod_settings(lod_range: LodRange, plan: Plan, *, thins: bool) -> LodSettings:
    """Return the node group's inputs. `thins`: prune as planned; else prune nothing while the level is drawn."""

    def own(distance: float) -> float:
        return min(distance / plan.placement.scale, NEVER)

    thins = thins and plan.thinning.start < lod_range.vanish
    return LodSettings(
        start=own(lod_range.start),
        end=own(lod_range.end),
        prune_start=own(plan.thinning.start if thins else lod_range.vanish),
        prune_half=plan.thinning.half,
        growth=plan.growth if thins else (0.0, 0.0),
        contrast=plan.contrast if thins and plan.contrast is not None else (0.0, 0.0),
        appear=own(lod_range.appear),
        vanish=own(lod_range.vanish),
        whole=own(lod_range.whole),
        fading=own(lod_range.fading),
        centre=plan.centre,
    )


def _leaf_object(
    tree: Tree, foliage: leafcloud.Foliage, chain: leafcloud.Chain, plan: Plan, costs: Costs
) -> bpy.types.Object:
    shape = _leaf_shape(tree.leaves, foliage, chain, plan)
    materials = tree.leaves.materials
    mesh = create_mesh(f"{plan.name}_LOD0", shape.surface, materials, layer_names(materials))
    if shape.light is not None:
        with costs.spent_on("baked_light", shape.light.nbytes):
            add_light(mesh, shape.light)
            for number, material in enumerate(materials):
                mesh.materials[number] = lit_material(material, plan.light_strength)
    extras: dict[str, Any] = {"level": 0, "switch_distance": 0.0}
    if plan.thinning.start < plan.lod_ranges[0].vanish:
        extras |= {"prune_start": plan.thinning.start, "prune_half": plan.thinning.half, "growth": list(plan.growth)}
        if plan.contrast is not None:
            with costs.spent_on("contrast", 0):
                for number, material in enumerate(materials):
                    mesh.materials[number] = contrast_material(material, plan.mean_color)
            extras |= {"contrast": list(plan.contrast), "mean_color": list(plan.mean_color)}
    return _object(mesh, shape, extras, plan.lod_ranges[0], costs)


def _leaf_shape(geometry: Geometry, foliage: leafcloud.Foliage, chain: leafcloud.Chain, plan: Plan) -> _Shape:
    """Return the leaves sorted by material, then by rank. The triangles of a leaf stay together."""
    leaf_ids = foliage.leaf_ids
    ranks = chain.ranks[leaf_ids]
    order = np.lexsort((leaf_ids, ranks, geometry.material_ids))
    moves = None
    if plan.transitions and chain.levels[0].cloud is not None:
        corners = world_positions(geometry, plan.placement.matrix)[plan.placement.wind(geometry.triangles)]
        moves = leaf_moves(chain, corners)
    billboards = np.zeros(len(order), np.int32) if moves is None else moves.billboards[order]
    split = split_vertices(geometry.triangles[order], billboards - billboards.min(initial=0))
    of_vertex = order[split.first // 3]
    transition = None
    if moves is not None:
        targets = plan.placement.wind(moves.targets).reshape(-1, 3)[3 * of_vertex + split.first % 3]
        transition = _transition(billboards[split.first // 3], targets, moves.pivot_targets[of_vertex], plan)
    return _Shape(
        surface=triangle_surface(geometry, order, split),
        ranks=ranks[order],
        pruning=_pruning(ranks[of_vertex], chain.pivots[of_vertex], plan) if plan.pruning else None,
        transition=transition,
        light=None if plan.light is None else plan.light.at(order),
        wind_attributes=None if plan.wind is None else _leaf_wind_attributes(leaf_ids, moves, chain, plan, of_vertex),
    )


def _leaf_wind_attributes(
    leaf_ids: NDArray[np.integer[Any]],
    moves: LeafMoves | None,
    chain: leafcloud.Chain,
    plan: Plan,
    of_vertex: NDArray[np.integer[Any]],
) -> WindAttributes:
    """Return the wind attributes for vertices of the triangles `of_vertex` (v,).

    Leaves without a billboard keep swaying with their own branch.
    """
    to_tree = plan.placement.to_tree
    pivots = chain.pivots[of_vertex]
    carriers = None
    if moves is not None:
        billboards = moves.billboards[of_vertex][:, None]
        carriers = to_tree(np.where(billboards < 0, pivots, plane_pivots(chain.levels[0])[billboards[:, 0]]))
    return WindAttributes(
        pivot=None if plan.pruning else to_tree(pivots),
        billboard_pivot=carriers,
        phase=phases(leaf_ids[of_vertex]),
        flutter=freedom(to_tree(chain.pivots))[of_vertex],
    )


def _cloud_or_none(level: leafcloud.Level | None) -> leafcloud.Level | None:
    """Return the level if it is a cloud, else None. The cross impostor has no parents, so nothing morphs to it."""
    return level if level is not None and level.cloud is not None else None


def _cloud_object(
    level: leafcloud.Level, following: leafcloud.Level | None, number: int, plan: Plan, costs: Costs
) -> bpy.types.Object:
    name = f"{plan.name}_LOD{number}"
    cutoff = level.alpha_cutoff
    page = _page(name, number, level, plan, costs)
    double = not level.two_sided
    if plan.light is None:
        material = atlas_material(name, page, alpha_cutoff=cutoff, double_sided=double)
    else:
        image, strength = page.base_color, plan.light_strength
        material = unlit_material(name, image, alpha_cutoff=cutoff, double_sided=double, strength=strength)
    if plan.lod_ranges[number].fades:
        with costs.spent_on("transitions", 0):
            add_fade(material.node_tree)
    shape = _cloud_shape(level, following, plan)
    mesh = create_mesh(name, shape.surface, [material])
    extras = {
        "level": number,
        "switch_distance": plan.switch_distances[number],
        "max_deviation": level.max_deviation_leaves,
    }
    return _object(mesh, shape, extras, plan.lod_ranges[number], costs)


def _page(name: str, number: int, level: leafcloud.Level, plan: Plan, costs: Costs) -> Page:
    """Create the images of the level with this number."""
    base_color = level.base_color
    # Level 1 belongs to every bake, so its base color is charged to no effect.
    with costs.spent_on("far_levels", _own_bytes(level, base_color)) if number > 1 else nullcontext():
        image = atlas_image(name, base_color)
    page = Page(image, roughness=plan.roughness, metallic=plan.metallic, specular=plan.specular)
    if (normal := level.normal) is not None:
        with costs.spent_on("normals", _own_bytes(level, normal)):
            page = replace(page, normal=atlas_image(f"{name}_normal", normal, data=True))
    if (gloss := level.gloss) is not None:
        with costs.spent_on(plan.gloss_for, _own_bytes(level, gloss)):
            image = atlas_image(f"{name}_gloss", gloss, data=True)
            page = replace(page, gloss=image, occluded=plan.occlusion)
    if (translucency := level.translucency) is not None:
        with costs.spent_on("translucency", _own_bytes(level, translucency)):
            pixels = with_opaque_parts(translucency, level.base_color)
            image = atlas_image(f"{name}_translucency", pixels)
            page = replace(page, translucency=image, share=plan.share, opaque_parts=bool((pixels[..., 3] == 0).any()))
    if (visibility := level.visibility) is not None:
        with costs.spent_on("self_shadowing", _own_bytes(level, visibility)):
            page = replace(page, visibility=atlas_image(f"{name}_visibility", visibility, data=True))
    return page


def _own_bytes(level: leafcloud.Level, pixels: NDArray[np.uint8]) -> int:
    """Return the level's share of an image's bytes. Other trees may share the atlas page."""
    return round(pixels.nbytes * level.page_share)


def _add_leaf_map(
    obj: bpy.types.Object, uv: NDArray[np.uint8], leaf: NDArray[np.uint8], own: Sequence[bpy.types.Material | None]
) -> None:
    """Add the leaf map's images and nodes to the level's material, for swapping leaf textures later."""
    uv_image = atlas_image(f"{obj.name}_leaf_uv", uv, data=True)
    leaf_image = atlas_image(f"{obj.name}_leaf_id", leaf, data=True)
    add_leaf_map(obj.data.materials[0], uv_image, leaf_image, own)


def _cloud_shape(level: leafcloud.Level, following: leafcloud.Level | None, plan: Plan) -> _Shape:
    """Return the billboards sorted by rank. `following`: the cloud that they morph to; None without one."""
    order = np.argsort(level.ranks, kind="stable")
    count = level.corners.shape[1] - 2
    keys = np.zeros((len(order), count), np.int32)
    if following is not None and plan.transitions:
        keys = _parents(following).reshape(-1, count)[order]
    faces = fans(keys, plan.placement)
    surface = fan_surface(plan.placement.to_tree(level.corners[order]), level.uvs[order], faces)
    ranks = level.ranks[order]
    billboards, corners = faces.first // (3 * count), faces.first % (3 * count)
    wind_attributes = _cloud_wind_attributes(level, following, plan, order[billboards], keys.ravel()[faces.first // 3])
    if following is None:
        return _Shape(surface, ranks[faces.billboards], wind_attributes=wind_attributes)
    of_vertex = count * order[billboards] + corners // 3
    targets = following.targets.reshape(-1, 3 * count, 3)[order].reshape(-1, 3)
    transition = None
    if plan.transitions:
        pivot_targets = following.pivot_targets[of_vertex]
        transition = _transition(keys.ravel()[faces.first // 3], targets[faces.first], pivot_targets, plan)
    return _Shape(
        surface=surface,
        ranks=ranks[faces.billboards],
        pruning=_pruning(ranks[billboards], following.pivots[of_vertex], plan) if plan.pruning else None,
        transition=transition,
        wind_attributes=wind_attributes,
    )


def _cloud_wind_attributes(
    level: leafcloud.Level,
    following: leafcloud.Level | None,
    plan: Plan,
    billboards: NDArray[np.integer[Any]],
    parents: NDArray[np.integer[Any]],
) -> WindAttributes | None:
    """Return the wind attributes for vertices of `billboards` (v,) that morph to the planes `parents` (v,) of the next
    level.

    None without wind and for the cross impostor, which has no pivots: it stands on the ground and bends as the trunk.
    """
    if plan.wind is None or level.cloud is None:
        return None
    to_tree = plan.placement.to_tree
    own = to_tree(plane_pivots(level)[level.plane_ids[billboards]])
    if following is None:
        return WindAttributes(own)
    return WindAttributes(
        pivot=None if plan.pruning else own,
        billboard_pivot=to_tree(plane_pivots(following)[parents]) if plan.transitions else None,
    )


def _parents(level: leafcloud.Level) -> NDArray[np.int32]:
    """Return (t,) the plane of the cloud `level` for each triangle of the level before."""
    assert level.cloud is not None
    return level.cloud.parents.astype(np.int32)


def _pruning(ranks: NDArray[np.float32], pivots: NDArray[np.float64], plan: Plan) -> Pruning:
    """Return the pruning attributes from the `ranks` (v,) and world-space `pivots` (v, 3) of the vertices' leaves."""
    return Pruning(ranks, plan.placement.to_tree(pivots))


def _transition(
    billboards: NDArray[np.int32], targets: NDArray[np.float64], pivot_targets: NDArray[np.float64], plan: Plan
) -> Transition:
    """Return the transition attributes for vertices. `billboards` (v,): numbers in the next level, −1 for none.

    `targets`, `pivot_targets` (v, 3): positions at a = 1 in the world.
    """
    return Transition(billboards, plan.placement.to_tree(targets), plan.placement.to_tree(pivot_targets))


def _object(
    mesh: bpy.types.Mesh, shape: _Shape, extras: dict[str, Any], lod_range: LodRange, costs: Costs
) -> bpy.types.Object:
    obj = bpy.data.objects.new(mesh.name, mesh)
    if shape.pruning is not None:
        with costs.spent_on("pruning", shape.pruning.nbytes):
            morphs.add_pruning(mesh, shape.pruning)
            mesh[EXTRAS] = _pruning_extras(mesh, shape)
    if shape.wind_attributes is not None:
        with costs.spent_on("wind", shape.wind_attributes.nbytes):
            add_wind_attributes(mesh, shape.wind_attributes)
    if shape.transition is not None:
        with costs.spent_on("transitions", shape.transition.nbytes):
            morphs.add_transition(obj, shape.transition)
        extras = {**extras, "transition_start": lod_range.start, "transition_end": lod_range.end}
    obj[EXTRAS] = extras
    return obj


def _pruning_extras(mesh: bpy.types.Mesh, shape: _Shape) -> dict[str, Any]:
    """Return the tables of triangle counts and areas. Materials are given by name instead of by number."""
    names = [material.name if material is not None else "" for material in mesh.materials]
    prefixes = [{**row, "material": names[row["material"]]} for row in prefix_table(shape.surface, shape.ranks)]
    areas = np.empty(len(mesh.polygons), np.float32)
    mesh.polygons.foreach_get("area", areas)
    return {"keep_steps": PREFIX_STEPS, "prefixes": prefixes, "area_shares": area_shares(areas, shape.ranks)}
