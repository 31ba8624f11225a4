"""How leaves differ from the rendering of their material: by island, by object, by where they are.

All leaves are looked at in one place of the UV map, where the rendering is opaque and has about its mean colour; what
they show there over what the rendering shows is their tint. For what multiplies (brightness, a tint) that is exact, for
a turn of the hue it is right about the mean colour. Cycles bakes it to the corners.

Known limits: alpha that differs is not followed; islands have random numbers of the same distribution as in Blender,
not the same ones, for they follow the order of vertices; Generated and Object coordinates are those of all leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from .flatten import RANDOM, Flattened, add_layers, cycles_errors, flat_material, scratch_scene
from .node_links import shown_nodes

GREATEST = 8.0
"""Tints are cut there: where the rendering is nearly black, a ratio says nothing."""


@dataclass(frozen=True)
class Islands:
    """positions (v, 3) in the world, triangles (t, 3), and the random number (t,) of each triangle's object."""

    positions: NDArray[np.float32]
    triangles: NDArray[np.int32]
    randoms: NDArray[np.float32]


def tints(material: bpy.types.Material, flat: Flattened, leaves: Islands) -> NDArray[np.float32]:
    """(t, 3, 3) factors of the rendering's linear colours, by corner."""
    place, expected = _typical(flat.pixels)
    mesh = _mesh(leaves, shown_nodes(material.node_tree), place)
    try:
        shines = flat_material(material, flat.light, opaque=True)
        with cycles_errors(material), shines as shown, scratch_scene() as scene:
            mesh.materials.append(shown)
            seen = _baked(scene, mesh)
    finally:
        bpy.data.meshes.remove(mesh)
    ratio = np.divide(seen, expected, out=np.ones_like(seen), where=expected > 1e-3)
    return np.clip(ratio, 0.0, GREATEST).reshape(-1, 3, 3)


def _typical(pixels: NDArray[np.float32]) -> tuple[tuple[float, float], NDArray[np.float32]]:
    """Where in the UV map the rendering is most opaque and nearest to its mean colour; and its own colour there."""
    height, width = pixels.shape[:2]
    mean = pixels[..., :3].sum((0, 1)) / max(float(pixels[..., 3].sum()), 1e-9)
    off = np.abs(pixels[..., :3] - mean).sum(axis=2) + 4.0 * (1.0 - pixels[..., 3])
    row, column = np.unravel_index(int(np.argmin(off)), off.shape)
    place = ((float(column) + 0.5) / width, 1.0 - (float(row) + 0.5) / height)
    return place, pixels[row, column, :3] / max(float(pixels[row, column, 3]), 1e-3)


def _mesh(leaves: Islands, nodes: list[bpy.types.Node], place: tuple[float, float]) -> bpy.types.Mesh:
    count = len(leaves.triangles)
    mesh = bpy.data.meshes.new("leafcloud tints")
    mesh.vertices.add(len(leaves.positions))
    mesh.vertices.foreach_set("co", leaves.positions.ravel())
    mesh.loops.add(3 * count)
    mesh.loops.foreach_set("vertex_index", leaves.triangles.ravel())
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    add_layers(mesh, nodes, np.tile(np.array(place, np.float32), (3 * count, 1)))
    mesh.attributes.new(RANDOM, "FLOAT", "FACE").data.foreach_set("value", leaves.randoms)
    mesh.color_attributes.active_color = mesh.color_attributes.new("leafcloud tints", "FLOAT_COLOR", "CORNER")
    mesh.update(calc_edges=True)
    return mesh


def _baked(scene: bpy.types.Scene, mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """(corners, 3) what the mesh shines with."""
    obj = bpy.data.objects.new("leafcloud tints", mesh)
    scene.collection.objects.link(obj)
    scene.cycles.samples = 1
    [layer] = scene.view_layers
    layer.update()
    chosen = {"object": obj, "active_object": obj, "selected_objects": [obj], "selected_editable_objects": [obj]}
    obj.select_set(True, view_layer=layer)
    layer.objects.active = obj
    with bpy.context.temp_override(scene=scene, view_layer=layer, **chosen):
        bpy.ops.object.bake(type="EMIT", target="VERTEX_COLORS")
    colors = np.empty(4 * len(mesh.loops), np.float32)
    mesh.color_attributes["leafcloud tints"].data.foreach_get("color", colors)
    return colors.reshape(-1, 4)[:, :3]
