"""The steps of one bake, the same for the operator and the command line:

    Tree ──prepare──▶ Prepared ──start──▶ Job ──wait──▶ Chain ──finish──▶ Baked ──write──▶ files

Each step is a function of the previous step's result. Only `finish` and `write` change Blender's data, and they restore
it when they fail.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import bpy
import numpy as np

import leafcloud

from ..effects.blend_order import blended_leaves
from ..errors import SceneError
from ..geometry import Geometry, Tree, without_shear
from ..levels.build import build_levels
from ..levels.building import Build, Costs, LeafShading
from ..levels.results import keep_view
from ..levels.trunk import unrolled
from ..material.blended import cut_message, is_blended, see_through
from ..material.cutouts import forgotten_alpha
from ..material.shading import reflection_of
from ..material.surface import are_unlit, read_surface
from ..material.translucency import translucent_of
from ..nodes.wind import WindSettings
from ..plan.camera_visibility import pixels_of, seen_as_set
from ..plan.costs import with_costs
from ..plan.decision import Decision, is_on
from ..plan.effects import on_effects, plan_channels, plan_effects, plan_levels, sees_pages
from ..plan.engine_limits import undrawn_warnings
from ..plan.facts import Facts
from ..plan.lod_range import View
from ..plan.pages import ktx2_warning
from ..plan.quality import core_wishes, quality_warnings
from ..plan.refinement import refine_warnings
from ..plan.registry import effect_named
from ..plan.schedule import keep_at_switch, schedule
from ..plan.wind import BREEZE, stature
from ..scene.scene_facts import read_scene_facts
from ..scene.wind import wind_on
from ..settings.bake import BakeSettings
from ..settings.choices import DRAW_OCTAHEDRAL, Form, Last
from ..settings.fit_options import fit_options
from ..steps import Steps
from .lighting import light_of
from .part import described_part
from .values import Baked, Planned, Prepared


def describe(tree: Tree, settings: BakeSettings, layer: bpy.types.ViewLayer | None = None) -> Facts:
    """Collect the facts for the plan. Without a layer they include nothing about the scene around the tree.

    Raise `leafcloud.LeafcloudError` for geometry that cannot be baked.
    """
    leaves = tree.leaves
    shape = leafcloud.Foliage(leaves.positions, leaves.triangles, matrix=tree.matrix)
    blended = [material for material in leaves.materials if material is not None and is_blended(material)]
    facts = Facts(
        engine=settings.engine,
        leaves=shape.leaf_count,
        vertices=len(leaves.positions),
        triangles=shape.triangle_count,
        trunk=0 if tree.trunk is None else len(tree.trunk.triangles),
        radius=shape.radius,
        area=shape.area,
        glossy=reflection_of(leaves.materials).varies,
        translucent=translucent_of(leaves.materials).material,
        unlit=are_unlit(leaves.materials),
        one_color=_is_one_color(leaves),
        blended=tuple(material.name for material in blended),
        see_through=see_through(leaves, blended),
    )
    if layer is None or not tree.sources:
        return facts
    scene = layer.id_data
    around = read_scene_facts(layer, tree, shape.world_centre.tolist(), view_of(scene))
    surrounded = replace(
        facts,
        scene_camera=around.camera,
        lights=around.lights,
        wind=wind_on(tree.sources, scene),
        renderer=scene.render.engine,
    )
    return seen_as_set(settings, surrounded)


def _is_one_color(leaves: Geometry) -> bool:
    """Return whether all leaves have one constant base color."""
    surfaces = [read_surface(material) for material in leaves.materials]
    varied = any(surface.color_texture or surface.color_attribute or surface.gaps for surface in surfaces)
    return not varied and len({surface.color for surface in surfaces}) == 1


def plan(tree: Tree, settings: BakeSettings, layer: bpy.types.ViewLayer | None = None) -> Planned:
    """Plan the effects of a bake and estimate their costs. `prepare` plans the same effects and carries them out."""
    facts = describe(tree, settings, layer)
    return Planned(settings, facts, with_costs(settings, facts, plan_effects(settings, facts)))


def prepare(tree: Tree, settings: BakeSettings, layer: bpy.types.ViewLayer | None = None) -> Prepared:
    """Pass the tree to the core, plan the effects, and bake the light of the scene if the plan needs it.

    Without a layer, the viewer may be anywhere, and no light is baked.
    Raise `leafcloud.LeafcloudError` for geometry that cannot be baked, `SceneError` for a missing texture or light that
    cannot be baked.
    """
    tree = without_shear(tree)
    facts = describe(tree, settings, layer)
    effects = with_costs(settings, facts, plan_effects(settings, facts))
    clouds, cross = plan_levels(settings, facts, effects)
    reflection, translucent = reflection_of(tree.leaves.materials), translucent_of(tree.leaves.materials)
    channels = plan_channels(settings, facts)
    share = translucent.share if "translucency" in channels else 0.0
    lit = is_on(effects, "baked_light") and layer is not None
    # Clouds show no twigs then (`clouds_may_show_twigs`): only the cross impostor shows the trunk in its textures.
    light = light_of(tree, layer, with_trunk=cross and tree.trunk is not None) if lit else None
    sides = (None, None) if light is None else (light.leaves, light.trunk)
    leaves = described_part(tree.leaves, tree.matrix, channels, share, sides[0])
    trunks = None if tree.trunk is None else described_part(tree.trunk, tree.matrix, channels, share, sides[1])
    foliage, trunk = leaves.foliage(), None if trunks is None else trunks.foliage()
    kept = blended_leaves(settings, facts)
    cut_out = set(facts.blended) - set(kept)
    blended = [cut_message(each) for each in tree.leaves.materials if each is not None and each.name in cut_out]
    names = tuple(material.name for material in tree.leaves.materials if material is not None)
    pages = ktx2_warning(settings, clouds + cross)
    read = [*leaves.messages, *(() if trunks is None else trunks.messages), *reflection.warnings, *translucent.warnings]
    read += [] if light is None else light.warnings
    read += forgotten_alpha(tree.leaves.materials) if settings.alpha == "auto" else []
    undrawn = undrawn_warnings(settings.engine, effects)
    warnings = tuple(dict.fromkeys([*tree.warnings, *read, *blended, *([pages] if pages else []), *undrawn]))
    blowing = (facts.wind or BREEZE) if is_on(effects, "wind") else None
    return Prepared(
        tree,
        settings,
        foliage,
        trunk,
        reflection,
        translucent,
        facts,
        effects,
        warnings,
        names,
        light,
        blowing,
        None if trunks is None else replace(trunks, geometry=unrolled(trunks.geometry)),
        leaves.owners,
    )


def start(prepared: Prepared, *, few_views: bool = False) -> leafcloud.Job[leafcloud.Chain]:
    """Start the core's job for a chain of levels. `few_views`: measure in few views, for a draft."""
    settings = prepared.settings
    return leafcloud.start_chain(
        prepared.foliage,
        trunk=prepared.trunk,
        every_level=settings.every_level,
        keep=keep_at_switch(settings, prepared.facts, prepared.effects),
        leaf_pixels=settings.prune_pixels,
        prune_half=settings.prune_half,
        contrast=bool(is_on(prepared.effects, "contrast")),
        seconds=settings.seconds,
        image_error=settings.image_error,
        preset=settings.preset,
        few_views=few_views,
        **core_wishes(settings, level_1_form(prepared), twigs=clouds_may_show_twigs(prepared)),
        last=last_form(prepared),
        **chain_options(settings, prepared.facts, prepared.effects),
    )


def level_1_form(prepared: Prepared) -> Form:
    """Return the form that the core may choose for level 1.

    Simplified leaves have the leaves' materials: they are no choice for blended leaves, which an order of drawing needs
    to be billboards, nor for baked light.
    """
    needs_pages = is_on(prepared.effects, "blend_order") or prepared.light is not None
    return "billboards" if needs_pages and prepared.settings.form == "auto" else prepared.settings.form


def clouds_may_show_twigs(prepared: Prepared) -> bool:
    """Return whether clouds may show thin branches. Baked light is of leaves: trunks are lit by the engine."""
    return bool(is_on(prepared.effects, "trunk_levels")) and prepared.light is None


def last_form(prepared: Prepared) -> Last:
    """Return the form that the core may choose for the last level.

    Not every engine draws octahedral impostors well: for the others they are chosen only if asked for. So they
    are where other settings than quality choose the levels.
    """
    settings = prepared.settings
    _, cross = prepared.levels
    chosen = settings.engine in DRAW_OCTAHEDRAL and settings.chain == "billboards" and settings.wish is None
    chosen = chosen and not prepared.facts.unlit  # Engines light octahedral impostors.
    return settings.last if cross and (settings.last == "octahedral" or chosen) else "cross"


def start_curve(prepared: Prepared, *, quick: bool) -> leafcloud.Job[leafcloud.Curve]:
    """Start the core's job for a cost curve around the settings, without pruned leaves.

    Raise `SceneError` for a chain without clouds.
    """
    if prepared.settings.chain == "pruning":
        raise SceneError("a cost curve measures clouds, and `chain=pruning` has none: choose another chain")
    options = chain_options(prepared.settings, prepared.facts, prepared.effects)
    return leafcloud.start_cost_curve(prepared.foliage, trunk=prepared.trunk, quick=quick, **options)


def chain_options(settings: BakeSettings, facts: Facts, effects: Sequence[Decision]) -> dict[str, Any]:
    """Return the options of `leafcloud` that chains and cost curves have in common."""
    clouds, cross = plan_levels(settings, facts, effects)
    options = {
        "levels": clouds,
        "cross": cross,
        "triangles": settings.triangles,
        "max_corners": settings.max_corners,
        "min_visibility": settings.min_visibility,
        "texture_size": settings.texture_size,
        "texture_height": settings.texture_height,
        "samples": settings.samples,
        "pixels": settings.switch_pixels,
        "close_gaps": settings.close_gaps,
        "refine": settings.refine,
        "tight_pages": sees_pages(settings, facts),
        **fit_options(settings),
    }
    for decision in effects:
        options |= effect_named(decision.name).core_options(decision.on, settings)
    return options


def finish(prepared: Prepared, chain: leafcloud.Chain, name: str, view: View) -> Steps[Baked]:
    """Build the levels in Blender under `name`, in steps. `view` sets their switch distances."""
    light, decisions = prepared.light, prepared.effects
    effects = {decision.name: effect_named(decision.name) for decision in decisions}
    costs = Costs({each: effect.core_seconds(chain, decisions) for each, effect in effects.items()})
    if light is not None:
        costs.seconds["baked_light"] = light.seconds
    reflection = prepared.reflection
    build = Build(
        name=name,
        tree=prepared.tree,
        foliage=prepared.foliage,
        chain=chain,
        schedule=schedule(prepared.settings, prepared.facts, decisions, chain, view),
        effects=on_effects(decisions),
        costs=costs,
        shading=LeafShading(reflection.roughness, reflection.metallic, reflection.specular, prepared.translucent.share),
        light=None if light is None else light.leaves,
        light_strength=1.0 if light is None else light.strength,
        unlit=prepared.facts.unlit,
        wind=wind_settings(prepared),
        owners=prepared.owners,
    )
    yield
    collection, built = yield from build_levels(build)
    keep_view(collection, pixels_of(1.0, 1.0, view))
    settled = tuple(effects[decision.name].settled(decision, chain) for decision in decisions)
    missed = quality_warnings(chain)
    unrefined = refine_warnings(prepared.settings.refine, chain.levels)
    prepared = replace(prepared, warnings=(*prepared.warnings, *missed, *unrefined))
    return Baked(prepared, chain, collection, tuple(built), build.schedule, view, settled, costs)


def wind_settings(prepared: Prepared) -> WindSettings | None:
    """Return the wind and the tree's proportions for its sway; None without the effect wind."""
    if prepared.wind is None:
        return None
    tree = prepared.tree
    trunk = None if tree.trunk is None else tree.trunk.positions
    return WindSettings(stature(tree.leaves.positions, trunk, tree.matrix), prepared.wind)


LONGEST_NAME = 44
"""Maximum bytes of a name. With suffixes such as _LOD1_translucency it must fit into the 63 of Blender's names."""


def file_name(name: str) -> str:
    """Return `name`, shortened, with underscores for characters that file systems refuse or interpret; never empty."""
    short = name.encode(errors="replace")[:LONGEST_NAME].decode(errors="ignore")
    return re.sub(r'[\x00-\x1f<>:"/\\|?*]|^[. ]|[. ]$', "_", short) or "tree"


def layer_of(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """Return the active view layer of the scene, or its first layer if the scene is not active."""
    context = bpy.context
    return context.view_layer if context.scene == scene else scene.view_layers[0]


def view_of(scene: bpy.types.Scene) -> View:
    """Return resolution and field of view of the scene's camera; 1080 pixels and 50° without a perspective camera."""
    if scene.camera is None or scene.camera.type != "CAMERA" or scene.camera.data.type != "PERSP":
        return View()
    frame = np.array(scene.camera.data.view_frame(scene=scene))
    height, depth = np.ptp(frame[:, 1]), -frame[0, 2]
    resolution = scene.render.resolution_y * scene.render.resolution_percentage / 100.0
    return View(resolution, 2.0 * math.atan2(height / 2.0, depth))
