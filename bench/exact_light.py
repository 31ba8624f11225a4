"""Leaves collapsed onto their billboards, with the exact light of the leaves in the crown.

This is the best result of any texture on these billboards, but for leaves that grow as they collapse: the remaining
error comes from the leaves' positions.
Cycles bakes the light on the leaves, with their shadows, to the corners of subdivided triangles, for each side
separately. The result shows the same triangles at a hundredth of the way from their billboard to the leaf, so that
they hide one another in the same order as on an atlas page.
"""

from __future__ import annotations

import bpy
import numpy as np
from clear_cells import mesh_of, quartered, triangles_of
from flat_views import make_flat
from numpy.typing import NDArray

TRIANGLES = 200_000
"""Minimum number of triangles after subdivision."""
ABOVE = 0.01
"""Fraction of the way from a billboard to the leaf. Keeps the depth order of leaves on one billboard."""
APART = 1e-4
"""Distance of the light receivers from a leaf, as a fraction of the crown's size, so that it does not shade itself."""
SIDES = ("front", "back")

Corners = NDArray[np.float32]
"""Values at the corners of triangles (n, 3, k)."""


class ExactLight:
    """An object `shown` with the exact light of the leaves after each `receive`. The white leaves cast shadows."""

    def __init__(self, leaves: bpy.types.Object) -> None:
        self.leaves = leaves
        (base, uvs), materials = triangles_of(leaves.data)
        normals, flat = corner_normals(leaves.data), flattened(leaves.data)
        while len(base) < TRIANGLES:
            base, uvs, normals, flat = (quartered(corners) for corners in (base, uvs, normals, flat))
            materials = np.repeat(materials, 4)
        apart = APART * float(np.ptp(base.reshape(-1, 3), axis=0).max()) * normals
        turned = np.s_[:, ::-1]
        self.receivers = [
            receiver(leaves, (base + apart, uvs), normals, materials),
            receiver(leaves, ((base - apart)[turned], uvs[turned]), -normals[turned], materials),
        ]
        self.shown = bpy.data.objects.new("shown", mesh_of((flat + ABOVE * (base - flat), uvs), materials, leaves.data))
        self.shown.matrix_world = leaves.matrix_world
        bpy.context.scene.collection.objects.link(self.shown)
        for index, material in enumerate(self.shown.data.materials):
            self.shown.data.materials[index] = glowing(material)
        for side in SIDES:
            self.shown.data.color_attributes.new(side, "FLOAT_COLOR", "CORNER")

    def receive(self) -> None:
        """Bake the light of the scene on both sides, store it in `shown` and show that instead of the leaves."""
        bpy.context.scene.render.use_persistent_data = False  # With it bakes are empty.
        self.leaves.hide_render, self.shown.hide_render = False, True
        for side, obj in zip(SIDES, self.receivers, strict=True):
            light = baked(obj)
            light = light if side == SIDES[0] else light[:, ::-1]
            self.shown.data.color_attributes[side].data.foreach_set("color", np.ascontiguousarray(light).ravel())
        self.leaves.hide_render, self.shown.hide_render = True, False


def flattened(mesh: bpy.types.Mesh) -> Corners:
    """Return the corners (n, 3, 3) of the triangles in the morph target `Billboards`."""
    points, vertices = np.empty(3 * len(mesh.vertices), np.float32), np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.shape_keys.key_blocks["Billboards"].data.foreach_get("co", points)
    mesh.loop_triangles.foreach_get("vertices", vertices)
    return points.reshape(-1, 3)[vertices].reshape(-1, 3, 3)


def corner_normals(mesh: bpy.types.Mesh) -> Corners:
    normals, loops = np.empty(3 * len(mesh.loops), np.float32), np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.corner_normals.foreach_get("vector", normals)
    mesh.loop_triangles.foreach_get("loops", loops)
    return normals.reshape(-1, 3)[loops].reshape(-1, 3, 3)


def receiver(
    leaves: bpy.types.Object, triangles: tuple[Corners, Corners], normals: Corners, materials: NDArray[np.int32]
) -> bpy.types.Object:
    """Add an opaque white object without a shadow, to bake the light on."""
    mesh = mesh_of(triangles, materials, leaves.data)
    lengths = np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)
    mesh.normals_split_custom_set((normals / lengths).reshape(-1, 3))
    for index, material in enumerate(mesh.materials):
        opaque = material.copy()
        for node in opaque.node_tree.nodes:
            if node.type == "MIX_SHADER":
                for link in node.inputs[0].links:
                    opaque.node_tree.links.remove(link)
                node.inputs[0].default_value = 1.0
        mesh.materials[index] = opaque
    mesh.color_attributes.active_color = mesh.color_attributes.new("light", "FLOAT_COLOR", "CORNER")
    obj = bpy.data.objects.new("receiver", mesh)
    obj.matrix_world = leaves.matrix_world
    obj.visible_shadow, obj.hide_render = False, True
    bpy.context.scene.collection.objects.link(obj)
    return obj


def baked(obj: bpy.types.Object) -> Corners:
    """Bake the direct light on `obj`; return it (triangles, 3, 4)."""
    obj.hide_render = False
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT"}, target="VERTEX_COLORS")
    obj.hide_render = True
    light = np.empty(4 * len(obj.data.loops), np.float32)
    obj.data.color_attributes["light"].data.foreach_get("color", light)
    return light.reshape(-1, 3, 4)


def glowing(material: bpy.types.Material) -> bpy.types.Material:
    """Return a copy of the material that emits the attribute of the visible side, with the material's alpha."""
    glow = material.copy()
    make_flat(glow)
    tree = glow.node_tree
    emission = next(node for node in tree.nodes if node.type == "EMISSION")
    side, mix = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeMixRGB")
    tree.links.new(side.outputs["Backfacing"], mix.inputs["Fac"])
    for name, socket in zip(SIDES, ("Color1", "Color2"), strict=True):
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name = name
        tree.links.new(attribute.outputs["Color"], mix.inputs[socket])
    tree.links.new(mix.outputs["Color"], emission.inputs["Color"])
    return glow
