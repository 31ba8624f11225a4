"""What the node groups have in common: how they are declared, the camera, the share of leaves λ and what follows it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import bpy

from ..versions import InputValue, set_modifier_input
from .sections import Section

NEVER = 1e9
"""A distance that no camera reaches."""
TINY = 1e-30
"""What stands for 0 in a divisor or a logarithm."""
BLOCK = 1024.0
"""Faces that are summed at a time."""

HIDDEN_SHARE = "leaf_hidden_share"
"""The point attribute with the share of a level that is not shown while it fades; 0, as where it is missing: all is."""

LENGTH = {"subtype": "DISTANCE", "min_value": 0.0}
SHARE = {"subtype": "FACTOR", "min_value": 0.0, "max_value": 1.0}


def group_of_layout(
    name: str, key: str, layout: int, *steps: Callable[[bpy.types.NodeTree], None]
) -> bpy.types.NodeTree:
    """The file's own modifier group whose property `key` is `layout`: the one that is there, else a new one that the
    `steps` fill."""
    for tree in bpy.data.node_groups:
        if tree.library is None and tree.get(key) == layout:
            return tree
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree[key] = layout
    tree.is_modifier = True
    for step in steps:
        step(tree)
    return tree


def add_modifier(
    obj: bpy.types.Object, name: str, group: bpy.types.NodeTree, values: Mapping[str, InputValue]
) -> bpy.types.NodesModifier:
    """Gives `obj` the group as a modifier, with these values of its inputs."""
    modifier = obj.modifiers.new(name, "NODES")
    modifier.node_group = group
    for socket, value in values.items():
        set_modifier_input(modifier, socket, value)
    return modifier


def declare(tree: bpy.types.NodeTree, name: str, kind: str, description: str, panel: Any = None, **values: Any) -> None:
    """Adds the input `name`, of the socket type `kind` ("Float"), with the values of its properties."""
    socket = tree.interface.new_socket(
        name, description=description, in_out="INPUT", socket_type=f"NodeSocket{kind}", parent=panel
    )
    for key, value in values.items():
        setattr(socket, key, value)


class Camera:
    """The scene's active camera, as the object that has the modifier sees it."""

    def __init__(self, section: Section) -> None:
        active = section.result("GeometryNodeInputActiveCamera")
        info = section.node("GeometryNodeObjectInfo", active, label="Camera seen from here", transform_space="RELATIVE")
        # Only the Object Info of no object has the scale 0.
        size = section.vector("LENGTH", info.outputs["Scale"])
        self.location = info.outputs["Location"]
        self.exists = section.compare(size, "GREATER_THAN", 0.0, label="Is there a camera?")

    def distance(
        self, section: Section, place: bpy.types.NodeSocket, centre: bpy.types.NodeSocket, label: str
    ) -> bpy.types.NodeSocket:
        """From the camera's `place`, in any coordinates, to `centre` in the same, below `NEVER`.

        0 without a camera, or with one whose place is not a number, so that everything is drawn whole.
        """
        distance = section.vector("DISTANCE", place, centre)
        number = section.compare(distance, "GREATER_EQUAL", 0.0, label="Is it a number?")
        near = section.math("MINIMUM", distance, NEVER * 0.99, label="Never is farther")
        known = section.logic(self.exists, "AND", number)
        return section.switch("FLOAT", known, 0.0, near, label=label)


def camera_distance(section: Section, camera: Camera) -> bpy.types.NodeSocket:
    """d to the input Centre, in the object's coordinates; 0 without a camera: then a level is drawn whole, at rest."""
    return camera.distance(section, camera.location, section.group_input("Centre"), label="Distance d")


def transition_share(section: Section, distance: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """a = clamp((d − start) / (end − start), 0, 1), or what is set by hand.

    Reads the inputs Start, End, Manual and Transition.
    """
    start = section.group_input("Start")
    span = section.math("SUBTRACT", section.group_input("End"), start)
    span = section.math("MAXIMUM", span, TINY, label="A step at least")
    by_camera = section.math("DIVIDE", section.math("SUBTRACT", distance, start), span, label="By camera", clamp=True)
    by_hand = section.result("ShaderNodeClamp", section.group_input("Transition"), label="By hand")
    return section.switch("FLOAT", section.group_input("Manual"), by_camera, by_hand, label="a")


def declare_transition(tree: bpy.types.NodeTree, panel: Any) -> None:
    """The inputs that `transition_share` reads where nothing is set by hand."""
    never = {"default_value": NEVER, **LENGTH}
    declare(tree, "Start", "Float", "Distance up to which leaves stay in place", panel, **never)
    declare(tree, "End", "Float", "Distance from which leaves lie on billboards", panel, **never)


def declare_by_hand(tree: bpy.types.NodeTree, panel: Any) -> None:
    """The input Transition, which counts where the input Manual holds."""
    moved = "0: leaves in place, 1: on their billboards"
    declare(tree, "Transition", "Float", moved, panel, default_value=0.0, **SHARE)


def keep(section: Section, distance: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """λ = min((d₀/d)^(log_h ½), 1), as (d₀ / max(d, d₀))^(log_h ½): exactly 1 up to d₀, and defined at d = 0.

    Reads the inputs Prune Start d₀ and Prune Half h.
    """
    start = section.math("MAXIMUM", section.group_input("Prune Start"), TINY, label="d₀")
    half = section.math("MAXIMUM", section.group_input("Prune Half"), TINY)
    half = section.math("MINIMUM", half, 0.5, label="h")
    exponent = section.math("LOGARITHM", 0.5, half, label="log_h ½")
    nearness = section.math("DIVIDE", start, section.math("MAXIMUM", distance, start), label="d₀ / max(d, d₀)")
    return section.math("POWER", nearness, exponent, label="λ")


def declare_pruning(tree: bpy.types.NodeTree, panel: Any) -> None:
    """The inputs that `keep` reads."""
    declare(
        tree, "Prune Start", "Float", "Distance up to which all leaves are drawn", panel, default_value=NEVER, **LENGTH
    )
    half = {"subtype": "FACTOR", "min_value": 0.0, "max_value": 0.5, "default_value": 0.5}
    declare(tree, "Prune Half", "Float", "Half of the leaves are left at Prune Start divided by this", panel, **half)


def trend(section: Section, share: bpy.types.NodeSocket, name: str) -> bpy.types.NodeSocket:
    """λ^(c₁ + c₂ ln λ) for the `share` λ, with the inputs `name` and `name` of Few (`leafcloud.Chain.growth`)."""
    logarithm = section.math("LOGARITHM", section.math("MAXIMUM", share, TINY), math.e, label="ln λ")
    first, second = section.group_input(name), section.group_input(f"{name} of Few")
    exponent = section.math("MULTIPLY_ADD", second, logarithm, first, label=f"{name}: exponent")
    return section.math("POWER", share, exponent, label=name)


def mean_share(section: Section, share: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """1 − κ with κ = min(1, λ^(k₁ + k₂ ln λ)), by the inputs Contrast."""
    kept = section.math("MINIMUM", trend(section, share, "Contrast"), 1.0, label="κ")
    return section.math("SUBTRACT", 1.0, kept, label="1 − κ")


def declare_trend(tree: bpy.types.NodeTree, name: str, above: str, panel: Any) -> None:
    """The inputs that `trend` reads; `above` says what happens where the exponent is above 0."""
    declare(tree, name, "Float", f"Exponent of the share kept: above 0 {above}", panel)
    declare(tree, f"{name} of Few", "Float", "How that exponent changes with the logarithm of the share kept", panel)


def sum_over_faces(
    section: Section, values: bpy.types.NodeSocket, tree: bpy.types.NodeSocket | None = None
) -> bpy.types.NodeSocket:
    """For each face the sum of `values` over all faces, or over those of its `tree`.

    `tree` counts from 0 and rises with the index of the faces. Summed in blocks, because Accumulate Field adds one by
    one in f32: off by 0.4 % over a million faces. The first of each block carries its sum to the sum of all blocks.
    """
    index = section.result("GeometryNodeInputIndex")
    block = section.math("FLOOR", section.math("DIVIDE", index, BLOCK), label="Block")
    # 1 for the first, because there is no block 0 before it. Rises with every block and every tree.
    number = section.math("ADD", block, 1.0 if tree is None else section.math("ADD", tree, 1.0), label="Number")
    previous = section.math("SUBTRACT", index, 1.0)
    before = section.at_index(number, previous, "Of the face before", data_type="INT", domain="FACE")
    first = section.compare(number, "GREATER_THAN", before, label="First of its block?")
    faces = {"data_type": "FLOAT", "domain": "FACE"}
    of_block = section.node("GeometryNodeAccumulateField", values, number, label="Sum of the block", **faces)
    once = section.switch("FLOAT", first, 0.0, of_block.outputs["Total"], label="Each block once")
    return section.node("GeometryNodeAccumulateField", once, tree, label="Sum of all blocks", **faces).outputs["Total"]
