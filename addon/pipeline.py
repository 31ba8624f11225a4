"""One bake from start to end, the same for the operator and the command line:

    Tree ──prepare──▶ Prepared ──start──▶ Job ──wait──▶ Chain ──finish──▶ Baked ──write──▶ files

Each step is a function of what the step before gave. Only `finish` and `write` change Blender's data, and they put it
back when they fail.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from .baked import Baked, Prepared
from .build.contrast import mean_color
from .build.levels import Costs, Plan, build_levels
from .export import gltf, ktx2
from .export.blend import save_blend
from .export.engine_pages import engine_pages
from .export.plain_colors import plain_colors
from .export.preview import preview_image
from .export.report import report
from .export.staging import Staging
from .export.unlit import mean_light
from .job import Progress, wait
from .lighting import light_of
from .placement import Placement
from .plan.effects import Facts, first_on, is_on, plan_channels, plan_effects, settle_back_sides
from .plan.reach import WOOD_PIXELS, Reach, View, reaches, rising, wood_errors
from .plan.thinning import Thinning, cut_off_distance, share_left, start_for
from .scene.describe import describe_materials
from .scene.extract import Geometry, Tree, texture_uvs, world_positions
from .scene.light import Light
from .scene.shading import gloss_of
from .scene.translucency import translucent_of
from .settings import BakeSettings, fit_options


def prepare(tree: Tree, settings: BakeSettings, layer: bpy.types.ViewLayer | None = None) -> Prepared:
    """Brings the tree into the world, decides on the effects, and bakes the light in the scene of `layer` if one asks.

    Without a layer, which is enough for the plan, no light is baked.
    Raises `leafcloud.LeafcloudError` for geometry that cannot be baked, `SceneError` for a texture that is missing, or
    light that cannot be baked.
    """
    tree = _without_shear(tree)
    placement = Placement(tree.matrix)
    gloss, translucent = gloss_of(tree.leaves.materials), translucent_of(tree.leaves.materials)
    branches = 0 if tree.wood is None else len(tree.wood.triangles)
    facts = Facts(engine=settings.engine, wood=branches, glossy=gloss.varies, translucent=translucent.material)
    channels = plan_channels(settings, facts)
    share = translucent.share if "translucency" in channels else 0.0
    lit = is_on(plan_effects(settings, facts), "baked_light") and layer is not None
    # Only the cross shows the wood.
    light = light_of(tree, layer, with_wood=settings.cross and tree.wood is not None) if lit else None
    sides = (None, None) if light is None else (light.leaves, light.wood)
    foliage, leaf_warnings = _foliage(tree.leaves, placement, channels, share, sides[0])
    wood, wood_warnings = (None, []) if tree.wood is None else _foliage(tree.wood, placement, channels, share, sides[1])
    effects = plan_effects(settings, replace(facts, leaves=foliage.leaf_count))
    blended = [
        f"material {material.name!r} is blended: the glTF files cut it out at an alpha of 0.5"
        for material in tree.leaves.materials
        if material is not None and gltf.is_blended(material)
    ]
    names = tuple(material.name for material in tree.leaves.materials if material is not None)
    pages = ktx2.warning(settings, settings.levels + settings.cross)
    read = [*leaf_warnings, *wood_warnings, *gloss.warnings, *translucent.warnings]
    read += [] if light is None else light.warnings
    warnings = tuple(dict.fromkeys([*tree.warnings, *read, *blended, *([pages] if pages else [])]))
    return Prepared(tree, settings, placement, foliage, wood, gloss, translucent, effects, warnings, names, light)


def start(prepared: Prepared) -> leafcloud.Job[leafcloud.Chain]:
    """Starts the core on a thread of its own."""
    settings = prepared.settings
    return leafcloud.start_chain(
        prepared.foliage,
        wood=prepared.wood,
        keep=_keep_at_switch(prepared),
        leaf_pixels=settings.prune_pixels,
        prune_half=settings.prune_half,
        seconds=settings.seconds,
        image_error=settings.image_error,
        preset=settings.preset,
        **chain_options(prepared),
    )


def start_curve(prepared: Prepared, *, quick: bool) -> leafcloud.Job[leafcloud.Curve]:
    """Starts to measure what accuracy costs in time, around the settings. Leaves are not pruned for it."""
    return leafcloud.start_cost_curve(prepared.foliage, wood=prepared.wood, quick=quick, **chain_options(prepared))


def chain_options(prepared: Prepared) -> dict[str, Any]:
    """What the wheel is asked for a chain and for a cost curve alike."""
    settings = prepared.settings
    return {
        "levels": 0 if settings.chain == "pruning" else settings.levels,
        "cross": settings.cross,
        "texture_size": settings.texture_size,
        "texture_height": settings.texture_height,
        "samples": settings.samples,
        "close_cracks": settings.close_cracks,
        "back_sides": is_on(prepared.effects, "back_sides"),
        "normals": settings.bend_normals if is_on(prepared.effects, "normals") else None,
        "gloss": bool(is_on(prepared.effects, "gloss")),
        "translucency": bool(is_on(prepared.effects, "translucency")),
        "occlusion": bool(is_on(prepared.effects, "occlusion")),
        "visibility": bool(is_on(prepared.effects, "self_shadowing")),
        "leaf_map": bool(is_on(prepared.effects, "leaf_map")),
        **fit_options(settings),
    }


def finish(prepared: Prepared, chain: leafcloud.Chain, name: str, view: View) -> Baked:
    """Builds the levels in Blender, under `name`, to be seen with `view`."""
    levels = chain.levels
    radius = prepared.foliage.radius
    deviations = [level.max_deviation_leaves * radius for level in levels]
    pixels = prepared.settings.pixels

    def seen(length: float, pixels: float) -> float:
        return leafcloud.switch_distance(length, pixels, view.resolution, view.field_of_view)

    # A level takes over where its deviation is seen smaller than the setting's pixels, and its texels than one.
    distances = [
        max(seen(deviation, pixels), seen(level.texel_size, 1.0))
        for level, deviation in zip(levels, deviations, strict=True)
    ]
    start = seen(prepared.leaf_size, prepared.settings.prune_pixels)
    if prepared.settings.chain == "pruning":
        distances = [max(*distances, cut_off_distance(start, prepared.settings.prune_half))]
    switch_distances = rising([0.0, *distances])
    light = prepared.light
    following = ("transitions", "pruning", "trunk_levels")
    transitions, pruning, trunk_levels = (bool(is_on(prepared.effects, effect)) for effect in following)
    morphs = [transitions and level.cloud is not None for level in levels]
    reached = reaches(switch_distances, [*morphs, False])
    thinning = _thinning(prepared, start, reached[0])
    contrast = bool(is_on(prepared.effects, "contrast"))
    plan = Plan(
        name=name,
        placement=prepared.placement,
        centre=tuple(prepared.placement.to_tree(prepared.foliage.centre).tolist()),
        roughness=prepared.gloss.roughness,
        metallic=prepared.gloss.metallic,
        share=prepared.translucent.share,
        occlusion=bool(is_on(prepared.effects, "occlusion")),
        gloss_for=first_on(prepared.effects, ("gloss", "occlusion", "self_shadowing")),
        transitions=transitions,
        pruning=pruning,
        wood_errors=wood_errors(deviations, reached, seen(1.0, WOOD_PIXELS)) if trunk_levels else (),
        switch_distances=switch_distances,
        reaches=reached,
        thinning=thinning,
        growth=chain.growth,
        contrast=chain.contrast if contrast else None,
        mean_color=mean_color(prepared.foliage) if contrast else (0.0, 0.0, 0.0),
        light=None if light is None else light.leaves,
        light_strength=1.0 if light is None else light.strength,
    )
    costs = Costs({} if light is None else {"baked_light": light.seconds})
    collection, built = build_levels(prepared.tree, prepared.foliage, chain, plan, costs)
    two_sided = [number for number, level in enumerate(levels, start=1) if level.two_sided]
    effects = settle_back_sides(prepared.effects, two_sided)
    return Baked(prepared, chain, collection, tuple(built), switch_distances, view, thinning, effects, costs)


def _keep_at_switch(prepared: Prepared) -> float | None:
    """λ where level 1 takes over; None in the chain of billboards, where nothing is pruned before.

    It depends on no camera: both distances are in proportion to the same.
    """
    settings = prepared.settings
    if settings.chain == "billboards":
        return None
    if settings.chain == "pruning":
        return 1.0
    start = prepared.leaf_size / settings.prune_pixels
    switch = settings.epsilon * prepared.foliage.radius / settings.pixels
    return share_left(start, switch, settings.prune_half)


def _thinning(prepared: Prepared, start: float, reach: Reach) -> Thinning:
    """From where the leaves are pruned; where level 1 was made of some, so that just these are left when it takes over.

    `start` is where a leaf gets small, `reach` that of the leaves.
    """
    half = prepared.settings.prune_half
    keep = _keep_at_switch(prepared)
    if prepared.settings.chain == "both" and keep is not None and keep < 1.0:
        return Thinning(start_for(keep, reach.vanish, half), half)
    return Thinning(start if prepared.settings.chain == "pruning" else math.inf, half)


def bake_prepared(prepared: Prepared, scene: bpy.types.Scene, name: str, progress: Progress) -> Baked:
    """What follows on `prepare`, and needs nothing of the tree's own scene but the camera."""
    chain = wait(start(prepared), progress)
    progress("build", 0.0)
    baked = finish(prepared, chain, name, view_of(scene))
    scene.collection.children.link(baked.collection)
    return baked


def write(baked: Baked, directory: Path, progress: Progress, *, blend: bool) -> dict[str, Any]:
    """Writes all files of the bake into `directory`, whole or not at all, and gives the report.

    `blend` saves the open file, as it is, as NAME.blend beside the others. The levels have to be in a scene.
    Raises `OSError` for a folder that cannot be written to, `ExportError` when Blender could not write a file.
    """
    name = baked.collection.name
    with Staging(directory) as staging:
        seconds = []
        engine = baked.prepared.settings.engine
        clouds = _levels_by_material(baked)
        taken = {name: level for name, level in clouds.items() if ktx2.is_taken(level)}
        textures = ktx2.Ktx2Textures(taken if engine in ktx2.ENGINES else {})
        with (
            gltf.engine_attributes(baked.levels, engine),
            gltf.masked_leaves(baked.levels),
            mean_light(baked.levels),
            plain_colors(baked.levels),
            engine_pages(clouds),
        ):
            for level in baked.levels:
                progress(f"write {level.object.name}.glb", 0.0)
                begin = time.perf_counter()
                file = staging.path(f"{level.object.name}.glb")
                gltf.export_level(level, file)
                textures.add_to(file)
                seconds.append(time.perf_counter() - begin)
            progress(f"write {name}.glb", 0.0)
            file = staging.path(f"{name}.glb")
            gltf.export_collection(baked.collection, file)
            textures.add_to(file)
        if blend:
            progress(f"write {name}.blend", 0.0)
            save_blend(staging.path(f"{name}.blend"))
        progress("write preview.png", 0.0)
        picture = preview_image(
            baked.prepared.foliage, baked.prepared.wood, baked.chain.levels, baked.switch_distances, baked.view
        )
        leafcloud.write_png(str(staging.path("preview.png")), picture)
        content = report(baked, seconds, sorted([*staging.files, "report.json"]))
        staging.write_json("report.json", content)
        staging.commit()
    return content


def _levels_by_material(baked: Baked) -> dict[str, leafcloud.Level]:
    """The clouds and the cross by the names of their only materials."""
    built = [level.object.data.materials[0].name for level in baked.levels[1:]]
    return dict(zip(built, baked.chain.levels, strict=True))


def file_name(name: str) -> str:
    """`name` with what file systems refuse or read as something else made into underscores; never empty."""
    return re.sub(r'[\x00-\x1f<>:"/\\|?*]|^[. ]|[. ]$', "_", name) or "tree"


def layer_of(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """The view layer that is looked at, or the first of a scene that is not."""
    context = bpy.context
    return context.view_layer if context.scene == scene else scene.view_layers[0]


def view_of(scene: bpy.types.Scene) -> View:
    """What the scene's camera sees with; the usual 1080 pixels and 50° where there is no camera with a perspective."""
    if scene.camera is None or scene.camera.type != "CAMERA" or scene.camera.data.type != "PERSP":
        return View()
    frame = np.array(scene.camera.data.view_frame(scene=scene))
    height, depth = np.ptp(frame[:, 1]), -frame[0, 2]
    resolution = scene.render.resolution_y * scene.render.resolution_percentage / 100.0
    return View(resolution, 2.0 * math.atan2(height / 2.0, depth))


def _foliage(
    geometry: Geometry, placement: Placement, channels: Sequence[str], share: float, light: Light | None
) -> tuple[leafcloud.Foliage, list[str]]:
    """The geometry in the world as the core takes it, and what had to be left aside of its materials."""
    described = describe_materials(geometry, channels, placement.matrix, share)
    front, back = _colors(described.colors, light)
    foliage = leafcloud.Foliage(
        world_positions(geometry, placement.matrix),
        placement.wind(geometry.triangles),
        uvs=placement.wind(texture_uvs(geometry)),
        normals=placement.wind(placement.normals_to_world(geometry.normals)),
        colors=placement.wind(front),
        back_colors=placement.wind(back),
        material_ids=geometry.material_ids,
        materials=[leafcloud.Material(**keywords) for keywords in described.materials],
        protected=geometry.protected,
    )
    return foliage, described.messages


def _colors(
    colors: NDArray[np.float32] | None, light: Light | None
) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """(t, 3, 4) factors on the front and (t, 3, 3) on the back: the colours, under the light of each side if any."""
    if light is None:
        return colors, None
    front = np.ones((*light.front.shape[:2], 4), np.float32) if colors is None else colors.copy()
    back = front[..., :3] * light.back
    front[..., :3] *= light.front
    return front, back


def _without_shear(tree: Tree) -> Tree:
    """The tree, along the world's axes where its matrix has a shear: no object can have one, nor a node of glTF."""
    placement = Placement(tree.matrix)
    if not placement.sheared:
        return tree
    return replace(
        tree,
        matrix=_translation(placement),
        leaves=_along_axes(tree.leaves, placement),
        wood=None if tree.wood is None else _along_axes(tree.wood, placement),
        warnings=[
            *tree.warnings,
            "the leaves' object is sheared by its parents: LOD 0 lies along the world's axes instead",
        ],
    )


def _along_axes(geometry: Geometry, placement: Placement) -> Geometry:
    """The geometry in coordinates along the world's axes, from the same origin: near it single precision is finest."""
    return replace(
        geometry,
        positions=world_positions(geometry, placement.matrix - _translation(placement) + np.eye(4)).astype(np.float32),
        triangles=placement.wind(geometry.triangles),
        uvs=placement.wind(geometry.uvs),
        normals=placement.wind(placement.normals_to_world(geometry.normals)),
        colors=placement.wind(geometry.colors),
    )


def _translation(placement: Placement) -> NDArray[np.float64]:
    """(4, 4) of a placement's matrix what moves its origin."""
    matrix = np.eye(4)
    matrix[:3, 3] = placement.matrix[:3, 3]
    return matrix
