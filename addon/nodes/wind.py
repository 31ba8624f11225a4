"""The node group *Leafcloud Wind*. Leaves flutter, and everything sways with the branch that carries it.

The group follows *Leafcloud LOD* in the modifier stack and moves its output. All lengths are in the tree's own
coordinates. Like most real-time vegetation it displaces points by a few sines of their position: T. Sousa, "Vegetation
Procedural Animation and Shading in Crysis", GPU Gems 3, ch. 16 (2007); R. Habel, A. Kusternig, M. Wimmer, "Physically
Guided Animation of Trees", Eurographics 2009.

F is the foot of the trunk, u the direction up, H the tree's height, Q its spread. d is the direction that the wind
blows to (|d| = 1), S its strength, G the gusting fraction of it, P the period, t the time in seconds, o the object's
location in the world, V the vector `PLACE_TURNS`:

    σ = S / (|S| + 4)                                            effective strength, in (−1, 1)
    τ = t/P + V·o                                                turns
    g = 1 − G + G·(0.6 sin 2πτ + 0.4 sin 2π·0.618τ)              gusts, |g| ≤ 1
    y = c − F,  η = max(u·y, 0)/H,  r = y − (u·y)·u,  ρ = |r|/Q  relative height of a point c and distance from the axis
    θ = 2π·2.3τ − k·y/Q,  k = 2·(d + u × d)                      waves along and across the wind
    w(c) = σ·A·H·g·η²·d + σ·B·Q·ρ² sin θ·(d + u)/2               sway: the trunk leans, branches swing about it

A is the input Sway, B the input Branches. Each point of the trunk and branches moves by w. A leaf or a billboard moves
as one piece: by w and its derivative w′ at its pivot c. So it bends with the branch and keeps its shape:

    W_c(x) = w(c) + w′(c)·(x − c)
           = σ·A·H·g·(η² + 2η u·(x − c)/H)·d
             + σ·B·Q·((ρ² + 2 r·(x − c)/Q²) sin θ − ρ² cos θ k·(x − c)/Q)·(d + u)/2

So a leaf's pivot moves exactly as the branch there. Each leaf also rotates about its pivot. The angle is 0 on
billboards. f is the attribute `leaf_flutter`, from stiff to free, and φ the attribute `leaf_phase`:

    n = (sin 2π(5τ + φ)·d + sin 2π(6.9τ + 3φ)·u × d) / √2,  |n| ≤ 1
    p = c(a) + R(n, |σ|·α·f·(1 − a)·|n|)·(p(a) − c(a))           R(n, angle): rotation about n; α is the input Flutter
    p' = p + (1 − a)·W_c(p) + a·W_C(p)                           C: the pivot of the billboard (`leaf_billboard_pivot`)

*Leaves and billboards coincide at the hand-over.* W is affine, so every point of a billboard moves consistently with
its corners, whatever its outline and size. At a = 1 a leaf moves by W_C. So does the next level's billboard with the
pivot C at its own a = 0. The same affine map moves both from where they are without wind. Only rounding remains, about
32 ulp of the greatest coordinate. The next level takes over at a = 0.998. There leaves are off by 0.002 of at most

    |σ|·α·|p − c| + |W_C(p) − W_c(p)|,   the latter at most M·(|p − c|² + |p − C|²)/2 by Taylor, M the greatest |w″|

|w″| ≤ |σ|·(2A/H + B/Q·(2 + 4|k| + |k|²)) with |k| ≤ 2√2. In a storm (σ = 1) leaves are off by 0.0005 of the spread,
for a billboard that extends half the spread from its pivot. M·|p − C|²/2 also bounds the distance between a
billboard's rim and the branch beside it. This distance causes no pop.

*Bounds.* |w| ≤ |σ|·(A·H·η² + B·Q·ρ²). The foot does not move. The top leans by at most A times the height in any wind.

At strength 0 the output is the input, bit for bit and at no cost. The group works without Python. The direction is the
live Z axis of Field, or the input Direction, in the world. Trees at different locations sway out of step, because V·o
differs. Levels of one tree share a location, so they sway in step.

Known limits: normals do not turn. All instances of one object (a forest's variants, a collection instance) sway in
step, by the location of the instanced object. Trunks and cross impostors have no pivots and bend only at their
vertices: long edges stay straight. There are no collisions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import bpy

from ..plan.wind import BREEZE, Stature, Wind
from ..versions import InputValue, drive_modifier_input, set_modifier_input
from .builder import Section
from .laws import (
    LENGTH,
    NEVER,
    SHARE,
    TINY,
    CameraNodes,
    add_modifier,
    camera_distance,
    declare,
    declare_by_hand,
    declare_distance,
    declare_transition,
    group_of_layout,
    transition_share,
)

GROUP_NAME = "Leafcloud Wind"
SWAY_NAME = "Leafcloud Sway"
_LAYOUT_KEY = "leafcloud_wind_layout"
_SWAY_KEY = "leafcloud_sway_layout"
_LAYOUT = 4
"""Version stored in both groups. Increase it when inputs or laws change: files baked earlier then keep their groups."""

HALF_FORCE = 4.0
"""The strength at which σ is ½."""
PLACE_TURNS = (0.1732, 0.1414, 0.2236)
"""V, turns per world unit. No two are in a simple ratio, so rows of trees do not sway in step."""
GUSTS = ((1.0, 0.6), (0.618, 0.4))
"""Turns per period and weight of each sine of the gusts."""
BRANCH_TURNS = 2.3
"""Turns of the branches per period."""
FLUTTER_TURNS = (5.0, 6.9)
"""Turns of the leaves per period, about d and about u × d."""
PHASES = (1.0, 3.0)
"""Factors of the phase in the two rotations. They are whole numbers, so that φ = 1 equals φ = 0."""
WAVES = 2.0
"""Component of k along d."""


@dataclass(frozen=True)
class Swing:
    """A tree's response to the wind. The node group has the same defaults.

    sway: A, the maximum lean of the top, as a fraction of the height; in [0, 1].
    branches: B, the maximum additional swing of branch tips, as a fraction of the spread; in [0, 1].
    flutter: α, the maximum rotation of leaves in radians; in [0, π/2].

    Raises `ValueError` for a value out of range.
    """

    sway: float = 0.1
    branches: float = 0.1
    flutter: float = math.radians(20.0)

    def __post_init__(self) -> None:
        for name, greatest in (("sway", 1.0), ("branches", 1.0), ("flutter", math.pi / 2.0)):
            value = getattr(self, name)
            if not 0.0 <= value <= greatest:
                raise ValueError(f"{name} is {value}, it must be in [0, {greatest:.6g}]")


@dataclass(frozen=True)
class WindSettings:
    """Inputs of the node group.

    stature, wind, swing: the tree's measurements, the wind, and the tree's response.
    start, end, centre: the transition, as in `LodSettings`.
    move_pivots: move the attribute `leaf_pivot`, too, for a later node group that reads it.
    """

    stature: Stature
    wind: Wind = BREEZE
    swing: Swing = field(default_factory=Swing)
    start: float = NEVER
    end: float = NEVER
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    move_pivots: bool = False


def wind_group() -> bpy.types.NodeTree:
    """Return the node group of the current file. Create it if it is missing."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _add_interface, _add_nodes)


def add_wind_modifier(obj: bpy.types.Object, settings: WindSettings) -> bpy.types.NodesModifier:
    """Add the group to `obj` as its last modifier. It works without the add-on and without Python.

    If the wind's force field is in the file, its Z axis sets the direction. A driver without Python sets the strength.
    """
    stature, wind, swing = settings.stature, settings.wind, settings.swing
    values: dict[str, InputValue] = {
        "Direction": wind.direction,
        "Strength": wind.strength,
        "Gusts": wind.gusts,
        "Period": stature.period,
        "Sway": swing.sway,
        "Branches": swing.branches,
        "Flutter": swing.flutter,
        "Foot": stature.foot,
        "Up": stature.up,
        "Height": stature.height,
        "Spread": stature.spread,
        "Start": settings.start,
        "End": settings.end,
        "Centre": settings.centre,
        "Move Pivots": settings.move_pivots,
    }
    modifier = add_modifier(obj, GROUP_NAME, wind_group(), values)
    blowing = None if wind.field is None else bpy.data.objects.get(wind.field)
    if blowing is not None and blowing.field is not None:
        set_modifier_input(modifier, "Field", blowing)
        drive_modifier_input(modifier, "Strength", blowing, "field.strength")
    return modifier


def _add_interface(tree: bpy.types.NodeTree) -> None:
    """Declare the group's inputs. Files and scripts rely on the names of the inputs, not on the panels."""
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    swing = Swing()

    panel = tree.interface.new_panel("Wind")
    declare(tree, "Field", "Object", "Force field that sets the direction: the wind blows along its Z axis", panel)
    along = {"subtype": "XYZ", "default_value": BREEZE.direction}
    declare(tree, "Direction", "Vector", "Direction of the wind in the world, used without a field", panel, **along)
    strength = "Strength of the wind, in the units of a force field; at 0 nothing moves"
    declare(tree, "Strength", "Float", strength, panel, default_value=BREEZE.strength)
    gusts = "Fraction of the wind that comes and goes; the rest is constant"
    declare(tree, "Gusts", "Float", gusts, panel, default_value=BREEZE.gusts, **SHARE)
    declare(tree, "Period", "Float", "Seconds per sway of the trunk", panel, default_value=2.0, min_value=0.01)

    panel = tree.interface.new_panel("Tree")
    leaning = "Maximum lean of the top, as a fraction of the height"
    declare(tree, "Sway", "Float", leaning, panel, default_value=swing.sway, **SHARE)
    swinging = "Maximum swing of the branch tips in addition to the lean, as a fraction of the spread"
    declare(tree, "Branches", "Float", swinging, panel, default_value=swing.branches, **SHARE)
    turning = {"subtype": "ANGLE", "default_value": swing.flutter, "min_value": 0.0, "max_value": math.pi / 2.0}
    declare(tree, "Flutter", "Float", "Maximum rotation of the leaves", panel, **turning)
    declare(tree, "Foot", "Vector", "Foot of the trunk. The wind does not move it", panel, subtype="XYZ")
    upward = {"subtype": "XYZ", "default_value": (0.0, 0.0, 1.0)}
    declare(tree, "Up", "Vector", "Direction up, along the trunk", panel, **upward)
    declare(tree, "Height", "Float", "Height of the tree above its foot", panel, default_value=10.0, **LENGTH)
    spread = "Greatest distance of a leaf from the axis of the trunk"
    declare(tree, "Spread", "Float", spread, panel, default_value=4.0, **LENGTH)
    declare(tree, "Move Pivots", "Bool", "Move the attribute leaf_pivot, too, for later modifiers that read it", panel)

    panel = tree.interface.new_panel("Transition to Billboards")
    declare_transition(tree, panel)
    declare_distance(tree, panel)
    declare(tree, "Manual", "Bool", "Ignore the camera and use the value below, as in Leafcloud LOD", panel)
    declare_by_hand(tree, panel)


_SWAY_INPUTS = {
    "Point": "Vector",
    "Pivot": "Vector",
    "Foot": "Vector",
    "Up": "Vector",
    "Height": "Float",
    "Spread": "Float",
    "Along": "Vector",
    "Waves": "Vector",
    "Shaking": "Vector",
    "Lean": "Float",
    "Swing": "Float",
    "Branch Angle": "Float",
}
"""Inputs of the group *Leafcloud Sway* and their types: the point, the pivot, then `_Air.sway` in its order."""


@dataclass(frozen=True)
class _Air:
    """Values that are the same for all points: d, u × d, |σ|, τ.

    sway: the inputs of *Leafcloud Sway* after point and pivot: F, u, H, Q, d, k, (d + u)/2, σ·A·H·g, σ·B·Q, 2π·2.3τ.
    """

    along: bpy.types.NodeSocket
    across: bpy.types.NodeSocket
    force: bpy.types.NodeSocket
    turns: bpy.types.NodeSocket
    sway: tuple[bpy.types.NodeSocket, ...]


def _add_nodes(tree: bpy.types.NodeTree) -> None:
    section = Section(tree, "Distance d to the camera", (-4200.0, 0.0))
    distance = camera_distance(section, CameraNodes(section))
    share = transition_share(Section(tree, "Transition a", (-3000.0, 0.0)), distance)
    air = _air(Section(tree, "Wind and tree", (-3000.0, -1200.0)))

    section = Section(tree, "Flutter", (0.0, 0.0))
    point = section.result("GeometryNodeInputPosition")
    pivot = section.vector_attribute("leaf_pivot", missing=point)
    fluttering = _fluttered(section, air, share, point, pivot)

    section = Section(tree, "Sway", (2800.0, 0.0))
    own = _swayed(section, air, fluttering, pivot, label="With the own branch W_c")
    carrier = section.vector_attribute("leaf_billboard_pivot", missing=pivot)
    other = _swayed(section, air, fluttering, carrier, label="With the billboard W_C")
    moving = section.compare(share, "GREATER_THAN", 0.0, label="a > 0")
    between = section.mix(share, own, other, label="W at a")
    offset = section.switch("VECTOR", moving, own, between, label="W")
    blown = section.vector("ADD", fluttering, offset, label="p'")

    section = Section(tree, "Apply if the wind blows", (4400.0, 0.0))
    geometry = section.group_input("Geometry")
    moved = section.result("GeometryNodeSetPosition", geometry, None, blown, label="Move")
    moved = _pivots_moved(section, moved, air, pivot)
    blowing = section.compare(section.group_input("Strength"), "NOT_EQUAL", 0.0, label="S ≠ 0")
    section.node("NodeGroupOutput", section.switch("GEOMETRY", blowing, geometry, moved, label="Move where S ≠ 0"))


def _air(section: Section) -> _Air:
    up = section.vector("NORMALIZE", section.group_input("Up"), label="u")
    along, place = _direction(section)
    across = section.vector("CROSS_PRODUCT", up, along, label="u × d")
    both = section.vector("ADD", along, across, label="d + u × d")
    waves = section.vector("SCALE", both, WAVES, label="k")
    shaking = section.vector("SCALE", section.vector("ADD", along, up), 0.5, label="(d + u)/2")

    strength = section.group_input("Strength")
    size = section.math("ADD", section.math("ABSOLUTE", strength), HALF_FORCE, label="|S| + 4")
    force = section.math("DIVIDE", strength, size, label="σ")
    seconds = section.node("GeometryNodeInputSceneTime", label="t").outputs["Seconds"]
    period = section.math("MAXIMUM", section.group_input("Period"), TINY, label="P")
    own = section.vector("DOT_PRODUCT", place, PLACE_TURNS, label="V·o")
    turns = section.math("ADD", section.math("DIVIDE", seconds, period), own, label="τ")

    waxing: bpy.types.NodeSocket | float = 0.0
    for speed, weight in GUSTS:
        waxing = section.math("MULTIPLY_ADD", _sine(section, turns, speed), weight, waxing)
    gusts = section.group_input("Gusts")
    steady = section.math("SUBTRACT", 1.0, gusts, label="1 − G")
    gusting = section.math("MULTIPLY_ADD", gusts, waxing, steady, label="g")
    leaning = section.math("MULTIPLY", section.group_input("Sway"), section.group_input("Height"), label="A·H")
    leaning = section.math("MULTIPLY", leaning, gusting, label="A·H·g")
    swinging = section.math("MULTIPLY", section.group_input("Branches"), section.group_input("Spread"), label="B·Q")
    sway = (
        section.group_input("Foot"),
        up,
        section.group_input("Height"),
        section.group_input("Spread"),
        along,
        waves,
        shaking,
        section.math("MULTIPLY", force, leaning, label="σ·A·H·g"),
        section.math("MULTIPLY", force, swinging, label="σ·B·Q"),
        section.math("MULTIPLY", turns, 2.0 * math.pi * BRANCH_TURNS, label="2π·2.3τ"),
    )
    return _Air(along, across, section.math("ABSOLUTE", force, label="|σ|"), turns, sway)


def _direction(section: Section) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """Return d in the tree's coordinates, and o, the object's location in the world."""
    this = section.result("GeometryNodeSelfObject")
    here = section.node("GeometryNodeObjectInfo", this, label="This object", transform_space="ORIGINAL")
    back = section.result("FunctionNodeInvertMatrix", here.outputs["Transform"])
    by_hand = section.result("FunctionNodeTransformDirection", section.group_input("Direction"), back, label="By hand")
    info = section.node(
        "GeometryNodeObjectInfo", section.group_input("Field"), label="Field in local space", transform_space="RELATIVE"
    )
    by_field = section.result(
        "FunctionNodeTransformDirection", (0.0, 0.0, 1.0), info.outputs["Transform"], label="Z axis of the field"
    )
    # Object Info gives the scale 0 only if no object is set.
    size = section.vector("LENGTH", info.outputs["Scale"])
    there = section.compare(size, "GREATER_THAN", 0.0, label="Is there a field?")
    along = section.switch("VECTOR", there, by_hand, by_field, label="Wind direction")
    return section.vector("NORMALIZE", along, label="d"), here.outputs["Location"]


def _fluttered(
    section: Section,
    air: _Air,
    share: bpy.types.NodeSocket,
    point: bpy.types.NodeSocket,
    pivot: bpy.types.NodeSocket,
) -> bpy.types.NodeSocket:
    """Return p: the point, rotated about its leaf's pivot."""
    target = section.vector_attribute("leaf_pivot_target", missing=pivot)
    centre = section.mix(share, pivot, target, label="Pivot at a")
    phase = section.attribute("FLOAT", "leaf_phase")
    axes = (air.along, air.across)
    rolls = [
        section.vector("SCALE", axis, _sine(section, air.turns, speed, phase, count), label="Rotation about the axis")
        for axis, speed, count in zip(axes, FLUTTER_TURNS, PHASES, strict=True)
    ]
    axis = section.vector("SCALE", section.vector("ADD", *rolls), math.sqrt(0.5), label="n")
    free = section.math("MULTIPLY", section.attribute("FLOAT", "leaf_flutter"), section.group_input("Flutter"))
    greatest = section.math("MULTIPLY", free, air.force, label="|σ|·α·f")
    rest = section.math("SUBTRACT", 1.0, share, label="1 − a")
    angle = section.math("MULTIPLY", section.math("MULTIPLY", greatest, rest), section.vector("LENGTH", axis))
    return section.result(
        "ShaderNodeVectorRotate", point, centre, axis, angle, label="Turn about the pivot", rotation_type="AXIS_ANGLE"
    )


def _swayed(
    section: Section, air: _Air, point: bpy.types.NodeSocket, pivot: bpy.types.NodeSocket, label: str
) -> bpy.types.NodeSocket:
    """Return W_c(x), the offset of `point` x that moves with the branch at `pivot` c."""
    group = group_of_layout(SWAY_NAME, _SWAY_KEY, _LAYOUT, _fill_sway)
    return section.result("GeometryNodeGroup", point, pivot, *air.sway, label=label, node_tree=group)


def _fill_sway(tree: bpy.types.NodeTree) -> None:
    """Declare the inputs and add the nodes of W_c(x)."""
    tree.is_modifier = False
    tree.interface.new_socket("Offset", in_out="OUTPUT", socket_type="NodeSocketVector")
    for name, kind in _SWAY_INPUTS.items():
        declare(tree, name, kind, "")

    section = Section(tree, "Height, distance and wave at the pivot c", (0.0, 0.0))
    up = section.group_input("Up")
    height = section.math("MAXIMUM", section.group_input("Height"), TINY, label="H")
    spread = section.math("MAXIMUM", section.group_input("Spread"), TINY, label="Q")
    pivot, waves = section.group_input("Pivot"), section.group_input("Waves")
    arm = section.vector("SUBTRACT", pivot, section.group_input("Foot"), label="y")
    rise = section.vector("DOT_PRODUCT", up, arm, label="u·y")
    eta = section.math("DIVIDE", section.math("MAXIMUM", rise, 0.0), height, label="η")
    out = section.vector("SUBTRACT", arm, section.vector("SCALE", up, rise), label="r")
    out = section.vector("DIVIDE", out, section.result("ShaderNodeCombineXYZ", spread, spread, spread), label="r/Q")
    square = section.vector("DOT_PRODUCT", out, out, label="ρ²")
    phase = section.math("DIVIDE", section.vector("DOT_PRODUCT", waves, arm), spread, label="k·y/Q")
    angle = section.math("SUBTRACT", section.group_input("Branch Angle"), phase, label="θ")

    section = Section(tree, "Offset of the point x", (1800.0, 0.0))
    beyond = section.vector("SUBTRACT", section.group_input("Point"), pivot, label="x − c")
    higher = section.math("DIVIDE", section.vector("DOT_PRODUCT", up, beyond), height, label="u·(x − c)/H")
    bend = section.math("MULTIPLY", eta, section.math("MULTIPLY_ADD", higher, 2.0, eta), label="η² + 2η u·(x − c)/H")
    farther = section.math("DIVIDE", section.vector("DOT_PRODUCT", out, beyond), spread, label="r·(x − c)/Q²")
    reach = section.math("MULTIPLY_ADD", farther, 2.0, square, label="ρ² + 2 r·(x − c)/Q²")
    later = section.math("DIVIDE", section.vector("DOT_PRODUCT", waves, beyond), spread, label="k·(x − c)/Q")
    rising = section.math("MULTIPLY", reach, section.math("SINE", angle))
    turning = section.math("MULTIPLY", section.math("MULTIPLY", square, later), section.math("COSINE", angle))
    twig = section.math("SUBTRACT", rising, turning, label="Branch")
    lean = section.math("MULTIPLY", section.group_input("Lean"), bend)
    swing = section.math("MULTIPLY", section.group_input("Swing"), twig)
    leaning = section.vector("SCALE", section.group_input("Along"), lean, label="Lean")
    swinging = section.vector("SCALE", section.group_input("Shaking"), swing, label="Swing")
    section.node("NodeGroupOutput", section.vector("ADD", leaning, swinging, label="W"))


def _pivots_moved(
    section: Section, geometry: bpy.types.NodeSocket, air: _Air, pivot: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """Return the geometry, with its pivots moved by the wind if Move Pivots is set."""
    there = section.vector("ADD", pivot, _swayed(section, air, pivot, pivot, label="W of the pivot"), label="Pivot")
    kept = {"data_type": "FLOAT_VECTOR", "domain": "POINT"}
    stored = section.result(
        "GeometryNodeStoreNamedAttribute", geometry, None, "leaf_pivot", there, label="Pivots", **kept
    )
    return section.switch("GEOMETRY", section.group_input("Move Pivots"), geometry, stored, label="If Move Pivots")


def _sine(
    section: Section,
    turns: bpy.types.NodeSocket,
    speed: float,
    phase: bpy.types.NodeSocket | None = None,
    count: float = 0.0,
) -> bpy.types.NodeSocket:
    """Return sin 2π(speed·τ + count·φ)."""
    own = 0.0 if phase is None else section.math("MULTIPLY", phase, count)
    return section.math(
        "SINE", section.math("MULTIPLY", section.math("MULTIPLY_ADD", turns, speed, own), 2.0 * math.pi)
    )
