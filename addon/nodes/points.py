"""The node group *Leafcloud Points*. It makes the points of a forest, with their attributes for *Leafcloud Forest*.

The points are, the first that applies:

    scattered on the faces, N per square unit, if Density N > 0:  N·m where the slope is at most Slope, else 0
    the instances of earlier modifiers, with their rotation and scale, in place of the instances
    the vertices of meshes, the points of curves (as evaluated) and of point clouds

m is the attribute or vertex group named Mask, 1 without one. u₁, u₂, u₃ are random numbers in [0, 1) of each point, by
its attribute `id`, else by its index. Attributes of the points:

    rotation: the one before, then turned about its own Z axis by 2π·Turn·u₁
    scale: the one before times Smallest + (Largest − Smallest)·u₂
    leafcloud_kind: ⌊Kinds·u₃⌋, the kind of tree on the point

Meshes and curves stay visible if Ground is on. Known limit: scattered points have no rotation of their own, so trees
stand along the object's Z axis on any slope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy

from .builder import Section
from .laws import SHARE, add_modifier, declare, group_of_layout

GROUP_NAME = "Leafcloud Points"
KIND = "leafcloud_kind"
"""Point attribute: the kind of tree on a point, from 0."""

_LAYOUT_KEY = "leafcloud_points_layout"
_LAYOUT = 1
"""Version stored in the group. Increase it when inputs or laws change: files made earlier then keep their group."""


STEEPEST = math.pi / 2.0
"""Blender's numbers of 32 bits may be above it by rounding."""


@dataclass(frozen=True)
class PointSettings:
    """Inputs of the node group.

    kinds: the number of kinds of trees, at least 1. ground: whether meshes and curves stay visible.
    density: points per square unit of the faces; 0: the points are given. ≥ 0.
    mask: name of a vertex group or attribute in [0, 1] that the density is multiplied by; empty: none.
    slope: the steepest slope with points, an angle in radians in [0, π/2].
    turn: random turn about the Z axis, as a fraction of a full turn; in [0, 1].
    smallest, largest: range of the random scale; positive.
    seed: of all random numbers.

    Raises `ValueError` for a value that is out of range or not finite.
    """

    kinds: int = 1
    ground: bool = True
    density: float = 0.0
    mask: str = ""
    slope: float = STEEPEST
    turn: float = 1.0
    smallest: float = 1.0
    largest: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        limits = {
            "kinds": (self.kinds >= 1, "at least 1"),
            "density": (self.density >= 0.0, "at least 0"),
            "slope": (0.0 <= self.slope <= STEEPEST + 1e-6, "in [0, π/2]"),
            "turn": (0.0 <= self.turn <= 1.0, "in [0, 1]"),
            "smallest": (self.smallest > 0.0, "greater than 0"),
            "largest": (self.largest > 0.0, "greater than 0"),
        }
        for name, (holds, limit) in limits.items():
            value = getattr(self, name)
            if not (math.isfinite(value) and holds):
                raise ValueError(f"{name} is {value}, it must be {limit}")


def points_group() -> bpy.types.NodeTree:
    """Return the node group of the current file. Create it if it is missing."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _add_interface, _add_nodes)


def add_points_modifier(obj: bpy.types.Object, settings: PointSettings) -> bpy.types.NodesModifier:
    """Add the modifier that makes the points of a forest. It works without the add-on and without Python."""
    values = {
        "Ground": settings.ground,
        "Density": settings.density,
        "Mask": settings.mask,
        "Slope": settings.slope,
        "Turn": settings.turn,
        "Smallest": settings.smallest,
        "Largest": settings.largest,
        "Kinds": settings.kinds,
        "Seed": settings.seed,
    }
    return add_modifier(obj, GROUP_NAME, points_group(), values)


def _add_interface(tree: bpy.types.NodeTree) -> None:
    """Declare the group's inputs. Files and scripts rely on the names of the inputs, not on the panels."""
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    usual = PointSettings()
    declare(tree, "Ground", "Bool", "Keep the object's own meshes and curves visible", default_value=usual.ground)
    density = "Trees per square unit of the faces. 0: a tree on each point or instance"
    declare(tree, "Density", "Float", density, default_value=usual.density, min_value=0.0)
    declare(tree, "Mask", "String", "Vertex group or attribute that the density is multiplied by. Empty: none")
    steep = {"subtype": "ANGLE", "default_value": usual.slope, "min_value": 0.0, "max_value": STEEPEST}
    declare(tree, "Slope", "Float", "Steepest slope on which trees are scattered", **steep)
    declare(tree, "Turn", "Float", "Random turn of each tree, as a fraction of a full turn", default_value=1.0, **SHARE)
    for name, which in (("Smallest", "smallest"), ("Largest", "largest")):
        declare(tree, name, "Float", f"Scale of the {which} trees", default_value=1.0, min_value=0.001)
    declare(tree, "Kinds", "Int", "Number of kinds of trees, which are mixed at random", default_value=1, min_value=1)
    declare(tree, "Seed", "Int", "Start of the random numbers. Another one gives another forest")


def _add_nodes(tree: bpy.types.NodeTree) -> None:
    section = Section(tree, "Parts of the input", (-2600.0, 0.0))
    turned = section.result("GeometryNodeInputInstanceRotation", label="Rotation of the instance")
    scaled = section.result("GeometryNodeInputInstanceScale", label="Scale of the instance")
    whole = section.group_input("Geometry")
    for name, kind, value in (("rotation", "QUATERNION", turned), ("scale", "FLOAT_VECTOR", scaled)):
        stored = {"data_type": kind, "domain": "INSTANCE", "label": name}
        whole = section.result("GeometryNodeStoreNamedAttribute", whole, None, name, value, **stored)
    parts = section.node("GeometryNodeSeparateComponents", whole, label="Parts").outputs
    mesh, curve, cloud, instances = (parts[name] for name in ("Mesh", "Curve", "Point Cloud", "Instances"))

    section = Section(tree, "Points", (-1200.0, 0.0))
    given = tree.nodes.new("GeometryNodeJoinGeometry")
    given.label, given.parent = "Given points", None
    vertices = section.result("GeometryNodeMeshToPoints", mesh, label="Vertices")
    knots = section.result("GeometryNodeCurveToPoints", curve, label="Points of curves", mode="EVALUATED")
    for each in (cloud, knots, vertices):
        tree.links.new(each, given.inputs[0])
    there = section.node("GeometryNodeAttributeDomainSize", instances, label="Instances", component="INSTANCES")
    has_instances = section.compare_integers(there.outputs["Instance Count"], "GREATER_THAN", 0, label="Any?")
    from_instances = section.result("GeometryNodeInstancesToPoints", instances, label="Points of instances")
    points = section.switch("GEOMETRY", has_instances, given.outputs[0], from_instances, label="Instances first")
    scattered = _scattered(section, mesh)
    by_density = section.compare(section.group_input("Density"), "GREATER_THAN", 0.0, label="Density > 0")
    points = section.switch("GEOMETRY", by_density, points, scattered, label="Scattered first")

    section = Section(tree, "Attributes of the points", (600.0, 0.0))
    points = _with_attributes(section, points)
    ground = tree.nodes.new("GeometryNodeJoinGeometry")
    ground.label = "Ground"
    for each in (curve, mesh):
        tree.links.new(each, ground.inputs[0])
    shown = section.switch("GEOMETRY", section.group_input("Ground"), None, ground.outputs[0], label="If visible")
    joined = tree.nodes.new("GeometryNodeJoinGeometry")
    for each in (shown, points):
        tree.links.new(each, joined.inputs[0])
    for node, place in ((given, (-700.0, 300.0)), (ground, (900.0, 500.0)), (joined, (2600.0, 0.0))):
        node.location = place
        node.parent = section.frame if node is not given else None
    section.node("NodeGroupOutput", joined.outputs[0])


def _scattered(section: Section, mesh: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return points on the faces of the mesh."""
    node = section.node("GeometryNodeInputNamedAttribute", section.group_input("Mask"), label="Mask", data_type="FLOAT")
    mask = section.switch("FLOAT", node.outputs["Exists"], 1.0, node.outputs["Attribute"], label="Mask or 1")
    normal = section.result("GeometryNodeInputNormal", label="Normal")
    upward = section.vector("DOT_PRODUCT", normal, (0.0, 0.0, 1.0), label="Cosine of the slope")
    least = section.math("COSINE", section.group_input("Slope"), label="Least cosine")
    least = section.math("SUBTRACT", least, 1e-4, label="With rounding")
    flat = section.compare(upward, "GREATER_EQUAL", least, label="Not too steep")
    density = section.math("MULTIPLY", section.group_input("Density"), mask, label="N·m")
    density = section.switch("FLOAT", flat, 0.0, density, label="0 where too steep")
    scatter = section.node("GeometryNodeDistributePointsOnFaces", mesh, label="Scatter", distribute_method="RANDOM")
    for source, name in ((density, "Density"), (section.group_input("Seed"), "Seed")):
        scatter.id_data.links.new(source, scatter.inputs[name])
    return scatter.outputs["Points"]


def _with_attributes(section: Section, points: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    def random(number: int) -> bpy.types.NodeSocket:
        seed = section.math("MULTIPLY_ADD", section.group_input("Seed"), 4.0, float(number), label=f"Seed {number}")
        return section.result("FunctionNodeRandomValue", 0.0, 1.0, None, seed, label=f"u{number}", data_type="FLOAT")

    angle = section.math("MULTIPLY", section.group_input("Turn"), 2.0 * math.pi, label="2π·Turn")
    angle = section.math("MULTIPLY", angle, random(1), label="Angle")
    turn = section.result("FunctionNodeAxisAngleToRotation", (0.0, 0.0, 1.0), angle, label="About Z")
    before = section.attribute("QUATERNION", "rotation")
    own = {"rotation_space": "LOCAL", "label": "Turned"}
    rotation = section.result("FunctionNodeRotateRotation", before, turn, **own)
    smallest = section.group_input("Smallest")
    span = section.math("SUBTRACT", section.group_input("Largest"), smallest, label="Range of the scale")
    factor = section.math("MULTIPLY_ADD", span, random(2), smallest, label="Factor")
    scale = section.vector("SCALE", section.vector_attribute("scale", missing=(1.0, 1.0, 1.0)), factor, label="Scale")
    kind = section.math("MULTIPLY", section.group_input("Kinds"), random(3), label="Kinds·u3")
    kind = section.math("FLOOR", kind, label="Kind")
    for name, value_type, value in (
        ("rotation", "QUATERNION", rotation),
        ("scale", "FLOAT_VECTOR", scale),
        (KIND, "INT", kind),
    ):
        stored = {"data_type": value_type, "domain": "POINT", "label": name}
        points = section.result("GeometryNodeStoreNamedAttribute", points, None, name, value, **stored)
    return points
