"""The octahedral impostor in Blender: an ellipsoid around the tree, which shows the tree as seen along each ray.

A quad that turns toward the camera would cast wrong shadows, and on a box Cycles darkens many leaves: those with
normals that point away from the box. In files the level is the cross impostor, with the data of the octahedral impostor
for engines that draw it (`plain_files`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import bmesh
import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

import leafcloud

from ..geometry import Tree
from ..mesh.baked_levels import EXTRAS, PLAIN
from ..nodes.builder import Section
from ..nodes.octahedral import OPEN, STEPS, transformed, view_group, views_group
from .building import Build, BuiltLevel
from .clouds import cloud_object
from .material import hide_back_in_cycles

COLOR_NODE, NORMAL_DEPTH_NODE = "Octahedral Color", "Octahedral Normal and Depth"
"""Names of the image nodes that hold the pages in the material of the cross impostor, for files."""
_SUBDIVISIONS, _FLATTEST = 2, 0.93
"""Of the sphere's 80 triangles; none is nearer to its middle than the second number, in radii."""
_ROOM = 1.01
"""Radii over those that hold the tree, for roundings and for the edges of texels."""
_LEAST_HALF = 0.01
"""Half of the least height, in the impostor's unit: a carpet needs a surface that rays can hit from the side."""


def octahedral_object(level: leafcloud.OctahedralLevel, number: int, build: Build) -> bpy.types.Object:
    """Create the object of the last level as an octahedral impostor, with the mesh for files."""
    cross = cloud_object(level.cross, None, number, build)
    plain, extras = cross.data, cross[EXTRAS].to_dict()
    bpy.data.objects.remove(cross)
    name = f"{build.name}_LOD{number}"
    with build.costs.spent_on("far_levels", level.color.nbytes + level.normal_depth.nbytes):
        pages = (
            build.images.add(f"{name}_octahedral", level.color),
            build.images.add(f"{name}_octahedral_normal", level.normal_depth, data=True),
        )
    for image, held in zip(pages, (COLOR_NODE, NORMAL_DEPTH_NODE), strict=True):
        _image_node(plain.materials[0].node_tree, image, held)
    radii = _radii(level, build.tree)
    mesh = _ellipsoid(f"{name}_around", level, radii)
    mesh.materials.append(_material(f"{name}_octahedral", level, radii, pages, build))
    obj = bpy.data.objects.new(name, mesh)
    obj[EXTRAS] = {**extras, "octahedral": _numbers(level)}
    obj[PLAIN] = plain
    return obj


@contextmanager
def plain_files(levels: Sequence[BuiltLevel], switch_distance: float) -> Iterator[None]:
    """Give the last level the cross impostor's mesh while the block runs. `switch_distance`: of the cross impostor.

    The custom property `octahedral` has the switch distance of the octahedral impostor.
    """
    obj = levels[-1].object
    own, plain = obj.data, obj.get(PLAIN)
    if plain is None:
        yield
        return
    extras = obj[EXTRAS].to_dict()
    octahedral = {**extras["octahedral"], "switch_distance": extras["switch_distance"]}
    obj[EXTRAS] = {**extras, "switch_distance": switch_distance, "octahedral": octahedral}
    obj.data = plain
    del obj[PLAIN]
    try:
        yield
    finally:
        obj.data, obj[EXTRAS], obj[PLAIN] = own, extras, plain


def _numbers(level: leafcloud.OctahedralLevel) -> dict[str, Any]:
    """Return the numbers of `shaders/octahedral.glsl`, in glTF's Y-up coordinates.

    to_layout: 12 numbers by row.
    """
    x, y, z, offset = level.to_layout.T
    rows = np.stack([x, z, -y, offset], axis=1)  # Blender's (x, y, z) is glTF's (x, −z, y).
    return {
        "to_layout": rows.ravel().tolist(),
        "extent": list(level.extent),
        "half": list(level.half),
        "grid": level.grid,
        "texels": level.view_texels,
        "alpha_cutoff": level.alpha_cutoff,
    }


def _radii(level: leafcloud.OctahedralLevel, tree: Tree) -> NDArray[np.float64]:
    """Return the radii of the ellipsoid, in the impostor's unit: the smallest of its shape that holds the tree."""
    half = np.maximum([level.extent[0], level.extent[0], level.half[2]], _LEAST_HALF)
    rows = level.to_layout / half[:, None]
    parts = (part.positions for part in (tree.leaves, tree.trunk) if part is not None)
    farthest = max(float(np.linalg.norm(each @ rows[:, :3].T + rows[:, 3], axis=1).max()) for each in parts)
    return min(farthest * _ROOM, math.sqrt(2.0)) / _FLATTEST * half


def _ellipsoid(name: str, level: leafcloud.OctahedralLevel, radii: NDArray[np.float64]) -> bpy.types.Mesh:
    """Create an ellipsoid with these radii around the tree, in the tree's coordinates."""
    turn, offset = level.to_layout[:, :3], level.to_layout[:, 3]
    to_tree = np.linalg.inv(turn)
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = to_tree * radii, to_tree @ -offset
    mesh, work = bpy.data.meshes.new(name), bmesh.new()
    try:
        bmesh.ops.create_icosphere(work, subdivisions=_SUBDIVISIONS, radius=1.0, matrix=Matrix(placed.tolist()))
        if np.linalg.det(turn) < 0.0:
            bmesh.ops.reverse_faces(work, faces=work.faces)
        work.to_mesh(mesh)
    finally:
        work.free()
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), bool))
    return mesh


def _material(
    name: str,
    level: leafcloud.OctahedralLevel,
    radii: NDArray[np.float64],
    pages: tuple[bpy.types.Image, bpy.types.Image],
    build: Build,
) -> bpy.types.Material:
    """Create the material that shows the three views around each ray, blended. It emits what needs no light."""
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # From Blender 5.0 on every material has nodes.
        material.use_nodes = True
    material.use_backface_culling = True
    tree = material.node_tree
    color, alpha, normal = _seen(tree, level, pages, dims=not build.emits)
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    shading = build.shading
    surface.inputs["Roughness"].default_value = shading.roughness
    surface.inputs["Metallic"].default_value = shading.metallic
    surface.inputs["Specular IOR Level"].default_value = shading.specular
    tree.links.new(alpha, surface.inputs["Alpha"])
    tree.links.new(normal, surface.inputs["Normal"])
    if not build.emits:
        tree.links.new(color, surface.inputs["Base Color"])
    else:
        surface.inputs["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
        surface.inputs["Specular IOR Level"].default_value = 0.0
        surface.inputs["Emission Strength"].default_value = build.light_strength
        tree.links.new(color, surface.inputs["Emission Color"])
        material.cycles.emission_sampling = "NONE"
    hide_back_in_cycles(tree, _back_seen_from_outside(tree, level, radii))
    return material


def _back_seen_from_outside(
    tree: bpy.types.NodeTree, level: leafcloud.OctahedralLevel, radii: NDArray[np.float64]
) -> bpy.types.NodeSocket:
    """Return 1 on the back of the ellipsoid, else 0. Also 0 for rays that start inside, such as shadow rays from the
    ground.

    A ray starts inside if it is shorter than the chord of the ellipsoid: −2 q·d / d² from the place q in the direction
    d, both divided by the radii.
    """
    section = Section(tree, "Starts the ray outside?", (-5200.0, 1200.0))
    rows = level.to_layout / radii[:, None]
    place = transformed(section, rows.tolist(), section.node("ShaderNodeTexCoord").outputs["Object"], "q")
    geometry = section.node("ShaderNodeNewGeometry").outputs
    to_object = {"vector_type": "VECTOR", "convert_from": "WORLD", "convert_to": "OBJECT"}
    own = section.result("ShaderNodeVectorTransform", geometry["Incoming"], **to_object)
    way = transformed(section, rows[:, :3].tolist(), own, "d")
    along, square = (section.vector("DOT_PRODUCT", each, way) for each in (place, way))
    chord = section.math("MULTIPLY", section.math("DIVIDE", along, square), -2.0, label="Chord")
    length = section.node("ShaderNodeLightPath").outputs["Ray Length"]
    outside = section.math("GREATER_THAN", length, chord, label="Longer than the chord?")
    return section.math("MULTIPLY", geometry["Backfacing"], outside, label="Hidden")


def _seen(
    tree: bpy.types.NodeTree,
    level: leafcloud.OctahedralLevel,
    pages: tuple[bpy.types.Image, bpy.types.Image],
    *,
    dims: bool,
) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """Add the nodes of the law. Return color, alpha and normal, the last in the world.

    `dims`: dim the color of leaves inside of the crown, which get less light.
    """
    matrix: NDArray[np.float64] = level.to_layout
    section = Section(tree, "Ray in the impostor's axes", (-5200.0, 0.0))
    place = section.node("ShaderNodeTexCoord").outputs["Object"]
    point = transformed(section, matrix.tolist(), place, "Point")
    incoming = section.node("ShaderNodeNewGeometry").outputs["Incoming"]
    to_object = {"vector_type": "VECTOR", "convert_from": "WORLD", "convert_to": "OBJECT"}
    own = section.result("ShaderNodeVectorTransform", incoming, label="In the tree's axes", **to_object)
    eye = section.vector("NORMALIZE", transformed(section, matrix[:, :3].tolist(), own, "Turned"), label="Eye")
    views = section.node("ShaderNodeGroup", label="Three views", node_tree=views_group())
    tree.links.new(eye, views.inputs["Eye"])
    tree.links.new(point, views.inputs["Point"])
    views.inputs["Grid"].default_value = level.grid

    sums: list[bpy.types.NodeSocket] = []
    for number in (1, 2, 3):
        section = Section(tree, f"View {number}", (-3600.0, 1400.0 * (2 - number)))
        parts = _view(section, tree, level, pages, views, number)
        sums = parts if not sums else [section.vector("ADD", *pair) for pair in zip(sums, parts, strict=True)]

    section = Section(tree, "Blended", (-1200.0, 0.0))
    color_sum, normal_sum, shares = sums
    alpha, openness, _ = section.node("ShaderNodeSeparateXYZ", shares).outputs
    alphas = section.result("ShaderNodeCombineXYZ", alpha, alpha, alpha)
    color = section.vector("DIVIDE", color_sum, alphas, label="Color")
    if dims:
        share = section.math("MULTIPLY", section.math("DIVIDE", openness, alpha), OPEN)
        light = section.math("MINIMUM", share, 1.0, label="Light that the leaves let through")
        color = section.vector("SCALE", color, light, label="Dimmed")
    turned = transformed(section, matrix[:, :3].T.tolist(), normal_sum, "In the tree's axes")
    to_world = {"vector_type": "NORMAL", "convert_from": "OBJECT", "convert_to": "WORLD"}
    normal = section.result("ShaderNodeVectorTransform", turned, label="In the world", **to_world)
    return color, alpha, section.vector("NORMALIZE", normal, label="Normal")


def _view(
    section: Section,
    tree: bpy.types.NodeTree,
    level: leafcloud.OctahedralLevel,
    pages: tuple[bpy.types.Image, bpy.types.Image],
    views: bpy.types.Node,
    number: int,
) -> list[bpy.types.NodeSocket]:
    """Return color and normal times opacity and weight, and opacity and openness times weight."""
    height: bpy.types.NodeSocket | float = 0.0
    for step in range(STEPS + 1):
        there = section.node("ShaderNodeGroup", label="Place in the picture", node_tree=view_group())
        there.inputs["Extent"].default_value = (*level.extent, 1.0)
        there.inputs["Grid"].default_value, there.inputs["Texels"].default_value = level.grid, level.view_texels
        links = {"Tile": views.outputs[f"Tile {number}"], "Point": views.outputs["Point"], "Ray": views.outputs["Ray"]}
        if step > 0:
            links["Height"] = height
        for name, source in links.items():
            tree.links.new(source, there.inputs[name])
        uv = there.outputs["UV"]
        if step < STEPS:
            depth = section.node("ShaderNodeTexImage", uv, image=pages[1], extension="EXTEND")
            height = section.math("MULTIPLY_ADD", depth.outputs["Alpha"], 2.0, -1.0, label="Depth")
    color = section.node("ShaderNodeTexImage", uv, image=pages[0], extension="EXTEND")
    normal = section.node("ShaderNodeTexImage", uv, image=pages[1], extension="EXTEND")
    share = section.math("MULTIPLY", color.outputs["Alpha"], views.outputs[f"Weight {number}"], label="Share")
    stored = section.node("ShaderNodeSeparateColor", normal.outputs["Color"]).outputs
    x, y = (section.math("MULTIPLY_ADD", part, 2.0, -1.0) for part in stored[:2])
    rest = section.math("SUBTRACT", 1.0, section.math("MULTIPLY_ADD", x, x, section.math("MULTIPLY", y, y)))
    z = section.math("SQRT", section.math("MAXIMUM", rest, 0.0))
    parts = zip(("Right", "Up", "Toward"), (x, y, z), strict=True)
    right, up, toward = (section.vector("SCALE", there.outputs[axis], part) for axis, part in parts)
    straight = section.vector("ADD", section.vector("ADD", right, up), toward, label="Normal")
    return [
        section.vector("SCALE", color.outputs["Color"], share),
        section.vector("SCALE", straight, share),
        section.result("ShaderNodeCombineXYZ", share, section.math("MULTIPLY", stored[2], share)),
    ]


def _image_node(tree: bpy.types.NodeTree, image: bpy.types.Image, name: str) -> None:
    """Add an unlinked image node, which holds an image for files."""
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image, node.name, node.location = image, name, (-900.0, -900.0)
