"""Helpers that build, extract and bake small scenes."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import bmesh
import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from addon.bake.pipeline import layer_of, prepare
from addon.bake.tree_set import bake_tree_set
from addon.bake.values import Baked
from addon.geometry import Geometry, Tree, world_positions
from addon.mesh.extract import extract
from addon.settings.bake import BakeSettings

SQUARE = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
TRIANGLE = SQUARE[:3]


def add_mesh(
    name: str,
    vertices: list[tuple[float, float, float]],
    faces: list[tuple[int, ...]],
    *,
    edges: list[tuple[int, int]] | None = None,
    materials: list[bpy.types.Material] | None = None,
    matrix: Matrix | None = None,
    link: bool = True,
) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, edges or [], faces)
    for material in materials or []:
        mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    obj.matrix_world = matrix or Matrix()
    if link:
        bpy.context.collection.objects.link(obj)
    return obj


def add_field(kind: str, name: str = "Breeze", **settings: float) -> bpy.types.Object:
    """Add an empty with a force field."""
    obj = bpy.data.objects.new(name, None)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.forcefield_toggle()
    obj.field.type = kind
    for key, value in settings.items():
        setattr(obj.field, key, value)
    return obj


def material(name: str) -> bpy.types.Material:
    return bpy.data.materials.new(name)


def use_nodes(material: bpy.types.Material) -> None:
    with warnings.catch_warnings():  # Blender 5 always uses nodes and deprecates the setting
        warnings.simplefilter("ignore", DeprecationWarning)
        material.use_nodes = True


def read(objects: list[bpy.types.Object] | None = None, leaf_names: list[str] | None = None) -> Tree:
    return extract(bpy.context.evaluated_depsgraph_get(), objects, leaf_names=leaf_names)


def corners(geometry: Geometry) -> list[list[tuple[float, ...]]]:
    """Return the coordinates of each triangle's corners."""
    return [[tuple(corner) for corner in triangle] for triangle in geometry.positions[geometry.triangles].tolist()]


def winding_normals(geometry: Geometry, matrix: np.ndarray) -> np.ndarray:
    """Return the triangles' normals (t, 3) in world space, from the right-hand rule."""
    a, b, c = world_positions(geometry, matrix)[geometry.triangles].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    return cross / np.linalg.norm(cross, axis=1, keepdims=True)


def import_part(shrub: Path, leaves: int = 100) -> None:
    """Import the shrub with only its first leaves: tests that bake often, or measure curves, take less time."""
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    mesh = bpy.data.objects["leaves"].data
    part = bmesh.new()
    part.from_mesh(mesh)
    bmesh.ops.delete(part, geom=part.verts[4 * leaves :], context="VERTS")
    part.to_mesh(mesh)
    part.free()
    assert len(mesh.polygons) == 2 * leaves


def bake(tree: Tree, settings: BakeSettings) -> Baked:
    """Bake the tree into the open scene without writing a file. Make every level: trees of tests are cheap to draw."""
    scene = bpy.context.scene
    prepared = {"tree": prepare(tree, replace(settings, every_level=True), layer_of(scene))}
    return bake_tree_set(prepared, scene, "tree", lambda stage, fraction: None).trees[0]


def collected(name: str, *objects: bpy.types.Object) -> None:
    """Move the objects into a new collection."""
    collection = bpy.data.collections.new(name)
    bpy.context.scene.collection.children.link(collection)
    for obj in objects:
        for other in obj.users_collection:
            other.objects.unlink(obj)
        collection.objects.link(obj)


def tube(sides: int, rings: int, height: float = 8.0) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return a tube of radius 1 around the z axis, open at both ends."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    z = np.repeat(np.arange(rings + 1) / rings * height, sides)
    positions = np.stack([np.tile(np.cos(angle), rings + 1), np.tile(np.sin(angle), rings + 1), z], axis=1)
    i, ring = np.tile(np.arange(sides), rings), np.repeat(np.arange(rings), sides) * sides
    a, b = ring + i, ring + (i + 1) % sides
    return positions, np.stack([a, b, b + sides, a, b + sides, a + sides], axis=1).reshape(-1, 3).astype(np.int32)
