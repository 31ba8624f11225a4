"""Simple scenes for the plan: a crown of cards at the origin, lights and cameras."""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Matrix, Vector
from scenes import add_mesh, material, read, use_nodes

from addon.bake.pipeline import describe, layer_of
from addon.plan.decision import Decision
from addon.plan.effects import plan_effects
from addon.plan.facts import Facts
from addon.settings.bake import BakeSettings

ONLY_THIS_VIEW = BakeSettings(viewer="camera")
"""Settings with which the plan also uses a still camera."""

CARDS = 60
FRAMES = 24


def add_crown(leaf: bpy.types.Material | None = None) -> bpy.types.Object:
    """Add a crown of cards with sides of 0.1. Its bounds are centered at the origin, with a radius of about 1."""
    rng = np.random.default_rng(1)
    places = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    middles = [0.5 * np.array(place) for place in places] + list(rng.uniform(-0.5, 0.5, (CARDS - len(places), 3)))
    vertices: list[tuple[float, float, float]] = []
    for middle in middles:
        side, up = rng.normal(size=(2, 3))
        side /= np.linalg.norm(side)
        up -= side * (side @ up)
        up /= np.linalg.norm(up)
        corners = [middle + 0.05 * (a * side + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        vertices += [(float(x), float(y), float(z)) for x, y, z in corners]
    faces = [tuple(range(4 * card, 4 * card + 4)) for card in range(len(middles))]
    return add_mesh("leaves", vertices, faces, materials=[leaf or material("leaf")])


def add_camera(radii: float, crown: bpy.types.Object) -> bpy.types.Object:
    """Add the scene's camera at a distance of `radii` crown radii from the center of the crown's bounds."""
    centre, radius = bounds(crown)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = centre + Vector((0.0, -radii * radius, 0.0))
    camera.data.sensor_fit = "VERTICAL"
    camera.data.angle = math.radians(50.0)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    return camera


def bounds(crown: bpy.types.Object) -> tuple[Vector, float]:
    """Return the center of the mesh's axis-aligned box and the largest distance of a vertex from the center."""
    points = np.array([crown.matrix_world @ vertex.co for vertex in crown.data.vertices])
    centre = (points.min(0) + points.max(0)) / 2.0
    return Vector(centre), float(np.linalg.norm(points - centre, axis=1).max())


def fly(obj: bpy.types.Object, *stops: tuple[float, float, float]) -> None:
    """Animate an object from stop to stop over the frames."""
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, FRAMES
    for number, stop in enumerate(stops):
        obj.location = stop
        obj.keyframe_insert("location", frame=1 + round(number * (FRAMES - 1) / (len(stops) - 1)))
    bpy.context.scene.frame_set(1)


def add_light(kind: str, energy: float = 3.0) -> bpy.types.Object:
    lamp = bpy.data.objects.new(kind.title(), bpy.data.lights.new(kind.title(), kind))
    lamp.data.energy, lamp.location = energy, (2.0, -2.0, 3.0)
    bpy.context.scene.collection.objects.link(lamp)
    return lamp


def add_wind(strength: float, rotation: tuple[float, float, float]) -> bpy.types.Object:
    """Add a wind field that blows along its own Z axis."""
    bpy.ops.object.effector_add(type="WIND", rotation=rotation)
    wind = bpy.context.object
    wind.field.strength = strength
    return wind


def copies(crown: bpy.types.Object, count: int, step: float) -> None:
    """Add trees with the crown's mesh in a row behind the crown, `step` apart, for `count` trees in all."""
    for number in range(1, count):
        other = bpy.data.objects.new(f"tree {number}", crown.data)
        other.matrix_world = Matrix.Translation((0.0, number * step, 0.0))
        bpy.context.scene.collection.objects.link(other)


def principled(name: str, **values: float) -> bpy.types.Material:
    """Return a material with these inputs of the Principled BSDF. An underscore in a name stands for a space."""
    made = material(name)
    use_nodes(made)
    shader = next(node for node in made.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    for key, value in values.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    return made


def facts_of(crown: bpy.types.Object, settings: BakeSettings | None = None) -> Facts:
    """Return the scene facts for a bake of the crown alone."""
    bpy.context.view_layer.update()
    settings = settings or BakeSettings()
    return describe(read([crown]), settings, layer_of(bpy.context.scene))


def plan_of(crown: bpy.types.Object, settings: BakeSettings | None = None) -> dict[str, Decision]:
    settings = settings or BakeSettings()
    return {effect.name: effect for effect in plan_effects(settings, facts_of(crown, settings))}


def on(plan: dict[str, Decision]) -> set[str]:
    """Return the effects that are on, without filtering, which always is."""
    return {name for name, effect in plan.items() if effect.on} - {"filtering"}
