"""Nodes shared by the node groups: declaration of inputs, the camera, the kept fraction λ, growth and contrast."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import bpy

from ..versions import InputValue, set_modifier_input
from .builder import Section
from .eye import GROUP_NAME as EYE_NAME
from .eye import LAYOUT as EYE_LAYOUT
from .eye import LAYOUT_KEY as EYE_KEY
from .eye import fill_eye

NEVER = 1e9
"""A distance that no camera reaches."""
TINY = 1e-30
"""Replaces 0 in divisors and logarithms."""
BLOCK = 1024.0
"""Faces per block of a blockwise sum."""

HIDDEN_SHARE = "leaf_hidden_share"
"""Point attribute: hidden fraction of a level that fades out, minus that of one that fades in. 0 or missing: shown."""
PARENT, OWN_BILLBOARD = "leaf_billboard", "own_billboard"
"""Point attributes: numbers of the billboards that leaves come to lie on, and of a level's own billboards."""
GOLDEN = 0.618034
"""Spreads the numbers 1, 2, 3 … evenly over [0, 1)."""

LOD_DISTANCE = "LOD Distance"
"""Input of the groups that follow the camera: the factor on all of their distances."""
ABOUT_LOD_DISTANCE = "Factor on all distances. At 2 finer levels are drawn twice as far away"
NEAREST = 1e-3
"""Least factor."""

STAGGER = "Stagger"
"""Input of the groups that follow the camera: the largest change of switch distances by an object's place."""
STAGGER_TURNS = (0.7549, 0.5698, 0.4387)
"""Turns per world unit of an object's place, as in shaders/leafcloud.glsl."""

LENGTH = {"subtype": "DISTANCE", "min_value": 0.0}
SHARE = {"subtype": "FACTOR", "min_value": 0.0, "max_value": 1.0}


def group_of_layout(
    name: str, key: str, layout: int, *steps: Callable[[bpy.types.NodeTree], None], kind: str = "GeometryNodeTree"
) -> bpy.types.NodeTree:
    """Return the group that has the custom property `key` = `layout`: a modifier group, unless its `kind` is another.
    Linked groups do not count.

    If the file has none, create it under `name` and let the `steps` fill it, in order.
    """
    for tree in bpy.data.node_groups:
        if tree.library is None and tree.get(key) == layout:
            return tree
    tree = bpy.data.node_groups.new(name, kind)
    tree[key] = layout
    if kind == "GeometryNodeTree":
        tree.is_modifier = True
    for step in steps:
        step(tree)
    return tree


def is_own_group(group: bpy.types.NodeTree | None) -> bool:
    """Return whether `group_of_layout` made the group, also in an earlier version."""
    return group is not None and any(key.startswith("leafcloud_") and key.endswith("_layout") for key in group.keys())  # noqa: SIM118 no mapping


def add_modifier(
    obj: bpy.types.Object, name: str, group: bpy.types.NodeTree, values: Mapping[str, InputValue]
) -> bpy.types.NodesModifier:
    """Add the group to `obj` as a modifier with the given input values."""
    modifier = obj.modifiers.new(name, "NODES")
    modifier.node_group = group
    for socket, value in values.items():
        set_modifier_input(modifier, socket, value)
    return modifier


def declare(tree: bpy.types.NodeTree, name: str, kind: str, description: str, panel: Any = None, **values: Any) -> None:
    """Add the input `name` of the socket type `kind`, such as "Float". `values`: properties of the socket."""
    socket = tree.interface.new_socket(
        name, description=description, in_out="INPUT", socket_type=f"NodeSocket{kind}", parent=panel
    )
    for key, value in values.items():
        setattr(socket, key, value)


class CameraNodes:
    """The object from which levels are seen, in the coordinates of the object with the modifier.

    It is the scene's active camera; unless `only_camera`, 3D views may have an eye of their own (`nodes.eye`).
    """

    def __init__(self, section: Section, *, only_camera: bool = False) -> None:
        if only_camera:
            seen_from = section.result("GeometryNodeInputActiveCamera")
        else:
            eye = group_of_layout(EYE_NAME, EYE_KEY, EYE_LAYOUT, fill_eye)
            seen_from = section.result("GeometryNodeGroup", label=EYE_NAME, node_tree=eye)
        info = section.node(
            "GeometryNodeObjectInfo", seen_from, label="Camera in local space", transform_space="RELATIVE"
        )
        # Object Info gives the scale 0 only if no object is set.
        size = section.vector("LENGTH", info.outputs["Scale"])
        self.location = info.outputs["Location"]
        self.exists = section.compare(size, "GREATER_THAN", 0.0, label="Is there a camera?")

    def distance(
        self, section: Section, place: bpy.types.NodeSocket, centre: bpy.types.NodeSocket, label: str
    ) -> bpy.types.NodeSocket:
        """Return the distance from the camera at `place` to `centre`, both in the same coordinates. Below `NEVER`.

        0 without a camera or if the distance is not a number: everything is drawn, unpruned.
        """
        distance = section.vector("DISTANCE", place, centre)
        number = section.compare(distance, "GREATER_EQUAL", 0.0, label="Is it a number?")
        near = section.math("MINIMUM", distance, NEVER * 0.99, label="Below NEVER")
        known = section.logic(self.exists, "AND", number)
        return section.switch("FLOAT", known, 0.0, near, label=label)


def camera_distance(section: Section, camera: CameraNodes) -> bpy.types.NodeSocket:
    """Return d to the input Centre, in the object's coordinates, divided by the input LOD Distance and by `_staggered`.

    0 without a camera: the level is at rest, unpruned.
    """
    distance = camera.distance(section, camera.location, section.group_input("Centre"), label="Distance")
    factor = section.math("MULTIPLY", given_factor(section), _staggered(section), label="Factor")
    return section.math("MINIMUM", section.math("DIVIDE", distance, factor), NEVER * 0.99, label="Distance d")


def given_factor(section: Section) -> bpy.types.NodeSocket:
    """Return the input LOD Distance. 0 counts as 1: a driver gives 0 where its source is gone, as after a deletion."""
    given = section.group_input(LOD_DISTANCE)
    positive = section.compare(given, "GREATER_THAN", 0.0, label="Is it given?")
    least = section.math("MAXIMUM", given, NEAREST, label="At least")
    return section.switch("FLOAT", positive, 1.0, least, label=LOD_DISTANCE)


def _staggered(section: Section) -> bpy.types.NodeSocket:
    """Return 1 + s·w(t) for the input Stagger s and the object's place: `lc_stagger` of shaders/leafcloud.glsl."""
    own = section.result("GeometryNodeSelfObject")
    place = section.node("GeometryNodeObjectInfo", own, label="Own place", transform_space="ORIGINAL")
    turns = section.vector("DOT_PRODUCT", place.outputs["Location"], STAGGER_TURNS, label="t")
    within = section.math("FRACT", section.math("SUBTRACT", turns, 0.25), label="Within the wave")
    height = section.math("ABSOLUTE", section.math("SUBTRACT", within, 0.5))
    wave = section.math("MULTIPLY_ADD", height, 4.0, -1.0, label="w")
    return section.math("MULTIPLY_ADD", section.group_input(STAGGER), wave, 1.0, label="1 + s·w")


def declare_distance(tree: bpy.types.NodeTree, panel: Any) -> None:
    """Declare the inputs of `camera_distance`."""
    declare(tree, "Centre", "Vector", "Point that the distance to the camera is measured from", panel, subtype="XYZ")
    declare_factor(tree, panel)
    declare_stagger(tree, 0.0, panel)


def declare_factor(tree: bpy.types.NodeTree, panel: Any = None) -> None:
    """Declare the input LOD Distance."""
    declare(tree, LOD_DISTANCE, "Float", ABOUT_LOD_DISTANCE, panel, default_value=1.0, min_value=0.0)


def declare_stagger(tree: bpy.types.NodeTree, usual: float, panel: Any = None) -> None:
    """Declare the input Stagger. `usual`: its default."""
    about = "Largest change of the distances by the object's place, so that neighbors do not switch together"
    declare(tree, STAGGER, "Float", about, panel, default_value=usual, subtype="FACTOR", min_value=0.0, max_value=0.5)


def transition_share(section: Section, distance: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return a = clamp((d − start) / (end − start), 0, 1), or the input Transition if Manual is set.

    Reads the inputs Start, End, Manual and Transition.
    """
    start = section.group_input("Start")
    span = section.math("SUBTRACT", section.group_input("End"), start)
    span = section.math("MAXIMUM", span, TINY, label="Avoid division by 0")
    by_camera = section.math("DIVIDE", section.math("SUBTRACT", distance, start), span, label="By camera", clamp=True)
    by_hand = section.result("ShaderNodeClamp", section.group_input("Transition"), label="By hand")
    return section.switch("FLOAT", section.group_input("Manual"), by_camera, by_hand, label="a")


def declare_transition(tree: bpy.types.NodeTree, panel: Any) -> None:
    """Declare the inputs Start and End of `transition_share`."""
    never = {"default_value": NEVER, **LENGTH}
    declare(tree, "Start", "Float", "Distance up to which leaves stay in place", panel, **never)
    declare(tree, "End", "Float", "Distance from which leaves lie on billboards", panel, **never)


def declare_by_hand(tree: bpy.types.NodeTree, panel: Any) -> None:
    """Declare the input Transition, used while the input Manual is set."""
    moved = "0: leaves in place, 1: leaves on their billboards"
    declare(tree, "Transition", "Float", moved, panel, default_value=0.0, **SHARE)


def keep(section: Section, distance: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return λ = min((d₀/d)^(log_h ½), 1).

    Computed as (d₀ / max(d, d₀))^(log_h ½), which is exactly 1 up to d₀ and defined at d = 0.

    Reads the inputs Prune Start d₀ and Prune Half h.
    """
    start = section.math("MAXIMUM", section.group_input("Prune Start"), TINY, label="d₀")
    half = section.math("MAXIMUM", section.group_input("Prune Half"), TINY)
    half = section.math("MINIMUM", half, 0.5, label="h")
    exponent = section.math("LOGARITHM", 0.5, half, label="log_h ½")
    nearness = section.math("DIVIDE", start, section.math("MAXIMUM", distance, start), label="d₀ / max(d, d₀)")
    return section.math("POWER", nearness, exponent, label="λ")


def declare_pruning(tree: bpy.types.NodeTree, panel: Any) -> None:
    """Declare the inputs of `keep`."""
    declare(
        tree, "Prune Start", "Float", "Distance up to which all leaves are drawn", panel, default_value=NEVER, **LENGTH
    )
    half = {"subtype": "FACTOR", "min_value": 0.0, "max_value": 0.5, "default_value": 0.5}
    declare(tree, "Prune Half", "Float", "Half of the leaves are kept at Prune Start divided by this", panel, **half)


def trend(section: Section, share: bpy.types.NodeSocket, name: str) -> bpy.types.NodeSocket:
    """Return λ^(c₁ + c₂ ln λ) for λ = `share`. c₁ and c₂ are the inputs `name` and `name` Quadratic.

    See `leafcloud.Chain.growth` and `contrast`.
    """
    logarithm = section.math("LOGARITHM", section.math("MAXIMUM", share, TINY), math.e, label="ln λ")
    first, second = section.group_input(name), section.group_input(f"{name} Quadratic")
    exponent = section.math("MULTIPLY_ADD", second, logarithm, first, label=f"{name}: exponent")
    return section.math("POWER", share, exponent, label=name)


def mean_share(section: Section, share: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return 1 − κ with κ = min(1, λ^(k₁ + k₂ ln λ)). k₁ and k₂ are the inputs Contrast and Contrast Quadratic."""
    kept = section.math("MINIMUM", trend(section, share, "Contrast"), 1.0, label="κ")
    return section.math("SUBTRACT", 1.0, kept, label="1 − κ")


def declare_trend(tree: bpy.types.NodeTree, name: str, above: str, panel: Any) -> None:
    """Declare the inputs of `trend`. `above`: the effect of an exponent above 0, for the tooltip."""
    declare(tree, name, "Float", f"Exponent of the fraction of leaves kept. Above 0 {above}", panel)
    few = f"Change of the {name} exponent with the logarithm of the fraction kept. It matters most when few are kept"
    declare(tree, f"{name} Quadratic", "Float", few, panel)


def sum_over_faces(
    section: Section, values: bpy.types.NodeSocket, tree: bpy.types.NodeSocket | None = None
) -> bpy.types.NodeSocket:
    """Return for each face the sum of `values` over all faces, or over the faces of its `tree`.

    `tree`: tree number of each face, from 0, rising with the face index. It sums in blocks, because Accumulate Field
    adds one by one in f32: off by 0.4 % over a million faces. The first face of each block adds the block's sum.
    """
    index = section.result("GeometryNodeInputIndex")
    block = section.math("FLOOR", section.math("DIVIDE", index, BLOCK), label="Block")
    # The numbers start at 1, because the face before the first one reads as 0. They rise with every block and tree.
    number = section.math("ADD", block, 1.0 if tree is None else section.math("ADD", tree, 1.0), label="Number")
    previous = section.math("SUBTRACT", index, 1.0)
    before = section.at_index(number, previous, "Of the face before", data_type="INT", domain="FACE")
    first = section.compare(number, "GREATER_THAN", before, label="First of its block?")
    faces = {"data_type": "FLOAT", "domain": "FACE"}
    of_block = section.node("GeometryNodeAccumulateField", values, number, label="Sum of the block", **faces)
    once = section.switch("FLOAT", first, 0.0, of_block.outputs["Total"], label="Each block once")
    return section.node("GeometryNodeAccumulateField", once, tree, label="Sum of all blocks", **faces).outputs["Total"]
