"""The node group *Leafcloud LOD*. It morphs leaves onto billboards, prunes and hides them as the camera moves.

The laws are Lacewell et al.'s transition and Gomez' pruning after Cook et al. d is the distance from the scene's active
camera to the level's center in the object's own coordinates, divided by the input LOD Distance:

    a = clamp((d − start) / (end − start), 0, 1)                 transition
    λ = min((d₀/d)^(log_h ½), 1)                                 share of leaves kept, d₀ = prune start, h = prune half
    r = clamp((λ − rank) / (λ·min(0.05, 1 − λ)), 0, 1)           ramp: the last leaves kept grow in and out
    s = √(ΣA / Σ(A·r²))                                          keeps the covered area, A the areas at rest
    γ = λ^(c₁ + c₂ ln λ)                                         further growth, measured (`leafcloud.Chain.growth`)
    p' = pivot(a) + (p(a) − pivot(a))·s·γ·r                      for leaves of rank below λ; the others are deleted
    κ = min(1, λ^(k₁ + k₂ ln λ))                                 contrast: kept fraction of a color's offset to the mean
    i = clamp((fade-in end − d) / (fade-in end − appear), 0, 1)  hidden fraction of a level that fades in
    o = clamp((d − fade-out start) / (vanish − fade-out start), 0, 1)   and of one that fades out

Leaves of a negative rank are protected: they are never pruned, do not grow, and do not count in the sums.

A level of billboards takes the place of the leaves that lie on them billboard by billboard: where o exceeds
frac(n·φ), φ = 0.618…, billboard n is drawn, else its leaves. So each ray meets either, those of shadows too. The
numbers n are `leaf_billboard` of the leaves and `own_billboard` of the level. A level without them fades by its
materials (`levels.fading`), which read o − i from the point attribute `leaf_hidden_share`. They read 1 − κ from
`leaf_mean_share`. The group stores both only where they are needed.

Branches are switched instead of multiplied by 0 or 1. At a = 0 and λ = 1 the output is the input, bit for bit and at no
cost. The sums over all faces are evaluated only if leaves are pruned.

Known limits: the distance is measured to the object, so all instances of one object (a collection instance, an instance
on points) look alike. Normals do not morph. Blender 4.2 encodes custom normals relative to the mesh's normals, so they
turn with moving leaves. Its Delete Geometry node drops them, so a pruned mesh shows its own normals.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy

import leafcloud

from ..material.node_links import MEAN_SHARE
from ..versions import InputValue, get_modifier_input, has_modifier_input, set_modifier_input
from .builder import Section
from .laws import (
    BLOCK,
    GOLDEN,
    HIDDEN_SHARE,
    LENGTH,
    LOD_DISTANCE,
    NEAREST,
    NEVER,
    OWN_BILLBOARD,
    PARENT,
    SHARE,
    TINY,
    CameraNodes,
    add_modifier,
    camera_distance,
    declare,
    declare_by_hand,
    declare_distance,
    declare_pruning,
    declare_transition,
    declare_trend,
    group_of_layout,
    keep,
    mean_share,
    transition_share,
    trend,
)

GROUP_NAME = "Leafcloud LOD"
_LAYOUT_KEY = "leafcloud_lod_layout"
_LAYOUT = 8
"""Version stored in the group. Increase it when inputs or laws change: files baked earlier then keep their group."""


@dataclass(frozen=True)
class LodSettings:
    """Inputs of the node group. Distances are in the object's own units (world distance / object scale).

    start, end: the transition a runs from 0 to 1 between them; a step at `start` if `end` is not greater. ≥ 0.
    prune_start: d₀, the distance where pruning begins. > 0.
    prune_half: h in (0, ½]; half of the leaves are kept at d₀/h.
    growth: (c₁, c₂) of γ; finite.
    contrast: (k₁, k₂) of κ; finite.
    appear, vanish: the level is drawn for appear ≤ distance < vanish. ≥ 0.
    fade_in_end: the level fades in from `appear` to here; at once if it is not beyond `appear`. ≥ 0.
    fade_out_start: the level fades out from here to `vanish`; at once if it is not before `vanish`. ≥ 0.
    centre: the point that the distance to the camera is measured from, in the object's coordinates.

    Raises `ValueError` for a value that is out of range or not finite.
    """

    start: float
    end: float
    prune_start: float = NEVER
    prune_half: float = 0.5
    growth: tuple[float, float] = (0.0, 0.0)
    contrast: tuple[float, float] = (0.0, 0.0)
    appear: float = 0.0
    vanish: float = NEVER
    fade_in_end: float = 0.0
    fade_out_start: float = NEVER
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("start", "end", "appear", "vanish", "fade_in_end", "fade_out_start"):
            _require(name, getattr(self, name), lambda value: value >= 0.0, "at least 0")
        _require("prune_start", self.prune_start, lambda value: value > 0.0, "greater than 0")
        _require("prune_half", self.prune_half, lambda value: 0.0 < value <= 0.5, "greater than 0 and at most 0.5")
        for name, values in (("growth", self.growth), ("contrast", self.contrast), ("centre", self.centre)):
            for value in values:
                _require(name, value, math.isfinite, "finite")


def lod_group() -> bpy.types.NodeTree:
    """Return the node group of the current file. Create it if it is missing."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _add_interface, _add_nodes)


def add_lod_modifier(obj: bpy.types.Object, settings: LodSettings) -> bpy.types.NodesModifier:
    """Add the group to `obj` as a modifier. The modifier works without the add-on and without Python."""
    values: dict[str, InputValue] = {
        "Start": settings.start,
        "End": settings.end,
        "Prune Start": settings.prune_start,
        "Prune Half": settings.prune_half,
        "Growth": settings.growth[0],
        "Growth Quadratic": settings.growth[1],
        "Contrast": settings.contrast[0],
        "Contrast Quadratic": settings.contrast[1],
        "Appear": settings.appear,
        "Vanish": settings.vanish,
        "Fade In End": settings.fade_in_end,
        "Fade Out Start": settings.fade_out_start,
        "Centre": settings.centre,
    }
    return add_modifier(obj, GROUP_NAME, lod_group(), values)


def lod_distance(modifier: bpy.types.NodesModifier) -> float:
    """Return the factor on all distances of a level; 1 if it is 0, and for the levels of earlier versions."""
    factor = float(get_modifier_input(modifier, LOD_DISTANCE)) if has_modifier_input(modifier, LOD_DISTANCE) else 1.0
    return max(factor, NEAREST) if factor > 0.0 else 1.0


def set_manual(modifier: bpy.types.NodesModifier, *, transition: float, keep: float) -> None:
    """Make the level ignore the camera: always drawn, at transition a = `transition`, keeping λ = `keep` of the leaves.

    Both are in [0, 1]. Raises `ValueError` for a value out of range.
    """
    _require("transition", transition, lambda value: 0.0 <= value <= 1.0, "in [0, 1]")
    _require("keep", keep, lambda value: 0.0 <= value <= 1.0, "in [0, 1]")
    set_modifier_input(modifier, "Manual", True)
    set_modifier_input(modifier, "Transition", transition)
    set_modifier_input(modifier, "Keep", keep)


def _require(name: str, value: float, holds: Callable[[float], bool], limit: str) -> None:
    if not (math.isfinite(value) and holds(value)):
        raise ValueError(f"{name} is {value}, it must be {limit}")


def _add_interface(tree: bpy.types.NodeTree) -> None:
    """Declare the group's inputs. Files and scripts rely on the names of the inputs, not on the panels."""
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    never = {"default_value": NEVER, **LENGTH}

    panel = tree.interface.new_panel("Transition to Billboards")
    declare_transition(tree, panel)

    panel = tree.interface.new_panel("Pruning")
    declare_pruning(tree, panel)
    declare_trend(tree, "Growth", "the leaves grow less than needed to keep their total area", panel)
    declare_trend(tree, "Contrast", "leaf colors move toward their mean", panel)

    panel = tree.interface.new_panel("Visibility")
    declare(tree, "Appear", "Float", "Distance from which the level is drawn", panel, default_value=0.0, **LENGTH)
    declare(tree, "Vanish", "Float", "Distance from which the level is no longer drawn", panel, **never)
    declare(tree, "Fade In End", "Float", "Distance where the fade-in ends", panel, default_value=0.0, **LENGTH)
    declare(tree, "Fade Out Start", "Float", "Distance where the fade-out starts", panel, **never)
    declare_distance(tree, panel)

    panel = tree.interface.new_panel("By Hand")
    declare(tree, "Manual", "Bool", "Ignore the camera: always draw the level, with the two values below", panel)
    declare_by_hand(tree, panel)
    declare(tree, "Keep", "Float", "Fraction of the leaves drawn", panel, default_value=1.0, **SHARE)


def _add_nodes(tree: bpy.types.NodeTree) -> None:
    section = Section(tree, "Distance d to the camera", (-2800.0, 0.0))
    distance = camera_distance(section, CameraNodes(section))
    drawn = _drawn(Section(tree, "Is the level drawn?", (-1500.0, 800.0)), distance)
    section = Section(tree, "Hidden fractions i and o", (-1500.0, 1700.0))
    fades, coming, going = _hidden(section, distance)
    transition = transition_share(Section(tree, "Transition a", (-1500.0, 0.0)), distance)
    kept_share = _keep(Section(tree, "Fraction of leaves kept λ", (-1500.0, -900.0)), distance)
    pulled = mean_share(Section(tree, "Fraction of the mean in colors 1 − κ", (-1500.0, -1700.0)), kept_share)
    point, pivot = _moved(Section(tree, "Point and pivot at a", (0.0, 0.0)), transition)
    growth = _growth(Section(tree, "Scale s·γ·r of the leaves kept", (0.0, -900.0)), kept_share)

    section = Section(tree, "Apply the active steps", (3200.0, 0.0))
    geometry = section.group_input("Geometry")
    moved = section.result("GeometryNodeSetPosition", geometry, None, point, label="Move")
    moving = section.compare(transition, "GREATER_THAN", 0.0, label="a > 0")
    whole = section.switch("GEOMETRY", moving, geometry, moved, label="Move where a > 0")

    lost = section.compare(section.attribute("FLOAT", "leaf_rank"), "GREATER_EQUAL", kept_share, label="rank ≥ λ")
    kept = section.result("GeometryNodeDeleteGeometry", geometry, lost, label="Prune", domain="POINT", mode="ALL")
    arm = section.vector("SUBTRACT", point, pivot, label="Point from pivot")
    grown = section.vector("MULTIPLY_ADD", arm, growth, pivot, label="Grow about pivot")
    pruned = section.result("GeometryNodeSetPosition", kept, None, grown, label="Move and grow")
    stored = {"data_type": "FLOAT", "domain": "POINT"}
    store = section.result("GeometryNodeStoreNamedAttribute", pruned, None, MEAN_SHARE, pulled, label="1 − κ", **stored)
    pulling = section.compare(pulled, "GREATER_THAN", 0.0, label="κ < 1")
    pruned = section.switch("GEOMETRY", pulling, pruned, store, label="Store 1 − κ where κ < 1")
    pruning = section.compare(kept_share, "LESS_THAN", 1.0, label="λ < 1")
    level = section.switch("GEOMETRY", pruning, whole, pruned, label="Prune where λ < 1")
    lost, share = _faded(Section(tree, "Fading by billboards, or by materials", (0.0, 1700.0)), coming, going)
    shown = section.result("GeometryNodeDeleteGeometry", level, lost, label="Delete", domain="POINT", mode="ALL")
    store = section.result("GeometryNodeStoreNamedAttribute", shown, None, HIDDEN_SHARE, share, label="o − i", **stored)
    level = section.switch("GEOMETRY", fades, level, store, label="Only where the level fades")

    section.node("NodeGroupOutput", section.switch("GEOMETRY", drawn, None, level, label="Nothing where not drawn"))


def _drawn(section: Section, distance: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return a boolean: Manual, or appear ≤ d < vanish."""
    appeared = section.compare(distance, "GREATER_EQUAL", section.group_input("Appear"), label="d ≥ appear")
    present = section.compare(distance, "LESS_THAN", section.group_input("Vanish"), label="d < vanish")
    near = section.logic(appeared, "AND", present)
    return section.logic(near, "OR", section.group_input("Manual"), label="Drawn")


def _hidden(section: Section, distance: bpy.types.NodeSocket) -> tuple[bpy.types.NodeSocket, ...]:
    """Return whether the level fades, i and o. With Manual it does not fade."""

    def share(first: bpy.types.NodeSocket, second: bpy.types.NodeSocket, over: bpy.types.NodeSocket) -> Any:
        span = section.math("MAXIMUM", over, TINY, label="Avoid division by 0")
        return section.math("DIVIDE", section.math("SUBTRACT", first, second), span, clamp=True)

    fade_in_end, fade_out_start = (section.group_input(name) for name in ("Fade In End", "Fade Out Start"))
    coming = share(fade_in_end, distance, section.math("SUBTRACT", fade_in_end, section.group_input("Appear")))
    going = share(distance, fade_out_start, section.math("SUBTRACT", section.group_input("Vanish"), fade_out_start))
    either = section.math("MAXIMUM", coming, going, label="Larger of i and o")
    by_distance = section.compare(either, "GREATER_THAN", 0.0, label="Fades")
    fades = section.switch("BOOLEAN", section.group_input("Manual"), by_distance, False, label="By camera")
    return fades, coming, going


def _faded(
    section: Section, coming: bpy.types.NodeSocket, going: bpy.types.NodeSocket
) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """Return whether a point's billboard is not drawn, and o − i for materials, 0 of levels that fade by billboards."""

    def turn(number: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        return section.math("FRACT", section.math("MULTIPLY", number, GOLDEN), label="frac(n·φ)")

    (parent, lies), (own, is_billboard) = (section.integer_attribute(name) for name in (PARENT, OWN_BILLBOARD))
    left = section.logic(lies, "AND", section.compare(turn(parent), "LESS_THAN", going, label="Gone"))
    come = section.math("SUBTRACT", 1.0, coming, label="1 − i")
    ahead = section.logic(is_billboard, "AND", section.compare(turn(own), "GREATER_EQUAL", come, label="Not come"))
    by_going = section.switch("FLOAT", lies, going, 0.0, label="o by materials")
    by_coming = section.switch("FLOAT", is_billboard, coming, 0.0, label="i by materials")
    return section.logic(left, "OR", ahead), section.math("SUBTRACT", by_going, by_coming, label="o − i")


def _keep(section: Section, distance: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return λ, by distance or by hand."""
    by_hand = section.result("ShaderNodeClamp", section.group_input("Keep"), label="By hand")
    return section.switch("FLOAT", section.group_input("Manual"), keep(section, distance), by_hand, label="λ")


def _moved(section: Section, transition: bpy.types.NodeSocket) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """Return p(a) and pivot(a)."""
    position = section.result("GeometryNodeInputPosition")
    pivot = section.attribute("FLOAT_VECTOR", "leaf_pivot")
    point_target = section.vector_attribute("leaf_target", missing=position)
    pivot_target = section.vector_attribute("leaf_pivot_target", missing=pivot)
    point = section.mix(transition, position, point_target, label="Point at a")
    return point, section.mix(transition, pivot, pivot_target, label="Pivot at a")


def _growth(section: Section, keep: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return s·γ·r, with the ramp r per leaf and s = √(ΣA / Σ(A·r²)) over the faces of the input geometry, at rest.

    1 for protected leaves. The sums leave them out.
    """
    rank = section.attribute("FLOAT", "leaf_rank")
    protected = section.compare(rank, "LESS_THAN", 0.0, label="Protected?")
    rest = section.math("SUBTRACT", 1.0, keep, label="1 − λ")
    width = section.math("MULTIPLY", section.math("MINIMUM", rest, leafcloud.RAMP, label="ρ"), keep, label="ρ·λ")
    before_end = section.math("SUBTRACT", keep, rank, label="λ − rank")
    ramp = section.math("DIVIDE", before_end, width, label="Ramp r", clamp=True)

    face_area = section.result("GeometryNodeInputMeshFaceArea")
    area = section.switch("FLOAT", protected, face_area, 0.0, label="A, 0 for protected leaves")
    drawn_area = section.math("MULTIPLY", area, section.math("MULTIPLY", ramp, ramp, label="r²"), label="A·r²")
    areas = section.result("ShaderNodeCombineXYZ", area, drawn_area, label="A, A·r²")
    total = _sum_over_faces(section, areas)
    sums = section.node("ShaderNodeSeparateXYZ", total, label="ΣA, ΣA·r²").outputs
    scale = section.math("SQRT", section.math("DIVIDE", sums["X"], sums["Y"]), label="Scale s")
    grown = section.math("MULTIPLY", scale, trend(section, keep, "Growth"), label="s·γ")
    free = section.math("MULTIPLY", grown, ramp, label="s·γ·r")
    return section.switch("FLOAT", protected, free, 1.0, label="1 for protected leaves")


def _sum_over_faces(section: Section, values: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return the sum of the vectors `values` over all faces of the input geometry.

    It sums in blocks, because Blender 4.2 adds one by one in f32. That would be off by 0.4 % over a million faces and
    by 8 % over eight million.
    """
    index = section.result("GeometryNodeInputIndex")
    block = section.math("FLOOR", section.math("DIVIDE", index, BLOCK), label="Block")
    first = section.compare(section.math("MODULO", index, BLOCK), "LESS_THAN", 0.5, label="First of its block?")
    faces = {"data_type": "FLOAT_VECTOR", "domain": "FACE"}
    blocks = section.node("GeometryNodeAccumulateField", values, block, label="Sum of the block", **faces)
    operands = (section.group_input("Geometry"), first, blocks.outputs["Total"])
    return section.node("GeometryNodeAttributeStatistic", *operands, label="Sum of all blocks", **faces).outputs["Sum"]
