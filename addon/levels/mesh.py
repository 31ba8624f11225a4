"""Creation of meshes from arrays: leaves, split so that every vertex belongs to one billboard, clouds and trunks.

A `Split` or `PolygonFaces` maps each vertex of the new mesh to a corner of the source. Values per corner follow by
indexing, so positions, texture coordinates and normals stay bit-identical.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..geometry import Geometry
from ..material.flatten import RANDOM, asks_for_random, copy_for_joined
from ..versions import set_corner_normals

UV_NAME = "UVMap"
COLOR_NAME = "Color"


@dataclass(frozen=True)
class MeshFaces:
    """Faces of three or more corners. `v` vertices, `c` corners, `f` faces.

    positions (v, 3). corners (c,): the vertex of each corner, face by face. sizes (f,): the corner count of each face.
    material_ids (f,). uvs (c, 2), normals (c, 3) unit vectors, colors (c, 4) linear: each may be None. Without normals
    faces are flat. randoms (f,): random numbers of the faces' source objects, or None.
    """

    positions: NDArray[np.float32]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32]
    material_ids: NDArray[np.int32]
    uvs: NDArray[np.float32] | None = None
    normals: NDArray[np.float32] | None = None
    colors: NDArray[np.float32] | None = None
    randoms: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class LayerNames:
    """Names of a mesh's UV maps and color attributes. The first of each is active."""

    uv_maps: tuple[str, ...] = (UV_NAME,)
    colors: tuple[str, ...] = (COLOR_NAME,)


@dataclass(frozen=True)
class Split:
    """Triangles with vertices split by a key.

    corners (t, 3): the new vertices of each triangle. first (v,): index of the first source corner of each new vertex,
    counted through all triangles.
    """

    corners: NDArray[np.int32]
    first: NDArray[np.int64]


@dataclass(frozen=True)
class PolygonFaces:
    """Polygons of billboards as faces that share no vertices. `v` vertices, `f` faces.

    corners (v,): the vertex's corner, counted through all polygons of the level. triangles (v,): a triangle of the
    polygon's fan (0, 1, 2), (0, 2, 3) … with that corner, counted through all polygons; places (v,): its place there.
    sizes (f,): the corner count of each face. polygons (f,): the polygon of each face.
    """

    corners: NDArray[np.int64]
    triangles: NDArray[np.int64]
    places: NDArray[np.int64]
    sizes: NDArray[np.int32]
    polygons: NDArray[np.int64]

    @property
    def vertex_polygons(self) -> NDArray[np.int64]:
        """(v,) the polygon of each vertex."""
        return np.repeat(self.polygons, self.sizes)


def split_vertices(triangles: NDArray[np.int32], keys: NDArray[np.integer[Any]]) -> Split:
    """Split vertices that are shared by triangles with different `keys` (t,).

    Triangles on the same three vertices get separate vertices, too. Blender's mesh validation, which its glTF exporter
    runs, would remove all but one of them. Unused vertices are dropped.
    """
    copies = _copies(triangles)
    parts = np.asarray(keys, np.int64) * (int(copies.max(initial=0)) + 1) + copies
    count = int(parts.max(initial=0)) + 1
    labels = triangles.astype(np.int64) * count + parts[:, None]
    _, first, inverse = np.unique(labels.ravel(), return_index=True, return_inverse=True)
    return Split(inverse.reshape(-1, 3).astype(np.int32), first)


def polygon_faces(
    sizes: NDArray[np.integer[Any]], keys: NDArray[np.integer[Any]], order: NDArray[np.integer[Any]], *, mirrored: bool
) -> PolygonFaces:
    """Return polygons with `sizes` (p,) corners as faces, in the given order.

    `keys` (t,): one for each triangle of the polygons' fans. A polygon is one face if all its triangles have the same
    key, otherwise a face per triangle. `mirrored`: wind faces the other way (`leafcloud.Foliage.mirrored`); the first
    corner stays first.
    """
    first_corners, first_triangles = _starts(sizes), _starts(np.asarray(sizes) - 2)
    rows: list[tuple[int, int, int]] = []
    face_sizes, polygons = [], []
    for polygon in order.tolist():
        size, corner, triangle = int(sizes[polygon]), int(first_corners[polygon]), int(first_triangles[polygon])
        fan = [[(corner, t, 0), (corner + i, t, 1), (corner + i + 1, t, 2)] for i, t in _fan(size, triangle)]
        whole = (keys[triangle : triangle + size - 2] == keys[triangle]).all()
        faces = [[*fan[0][:2], *(last for _, _, last in fan)]] if whole else fan
        for face in faces:
            rows += [face[0], *reversed(face[1:])] if mirrored else face
            face_sizes.append(len(face))
            polygons.append(polygon)
    corners, triangles, places = np.array(rows, np.int64).reshape(-1, 3).T
    return PolygonFaces(corners, triangles, places, np.array(face_sizes, np.int32), np.array(polygons, np.int64))


def _fan(size: int, triangle: int) -> list[tuple[int, int]]:
    """Return second corner and number of each triangle of a polygon's fan; `triangle`: the number of the first."""
    return [(i, triangle + i - 1) for i in range(1, size - 1)]


def _starts(counts: NDArray[np.integer[Any]]) -> NDArray[np.int64]:
    return np.cumsum(counts, dtype=np.int64) - counts


def triangle_surface(geometry: Geometry, order: NDArray[np.integer[Any]], split: Split) -> MeshFaces:
    """Return the triangles `order` of `geometry` as a surface. `split`: the split of `geometry.triangles[order]`."""
    vertices = geometry.triangles[order].ravel()[split.first]

    def per_corner(values: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
        return None if values is None else values[order].reshape(-1, values.shape[-1])

    return MeshFaces(
        positions=geometry.positions[vertices],
        corners=split.corners.ravel(),
        sizes=np.full(len(order), 3, np.int32),
        material_ids=geometry.material_ids[order],
        uvs=per_corner(geometry.uvs),
        normals=per_corner(geometry.normals),
        colors=per_corner(geometry.colors),
        randoms=None if geometry.randoms is None else geometry.randoms[order],
    )


def polygon_surface(corners: NDArray[np.floating[Any]], uvs: NDArray[np.float32], faces: PolygonFaces) -> MeshFaces:
    """Return polygons with `corners` (c, 3) and `uvs` (c, 2) as a surface with one material."""
    return MeshFaces(
        positions=corners.astype(np.float32)[faces.corners],
        corners=np.arange(len(faces.corners), dtype=np.int32),
        sizes=faces.sizes,
        material_ids=np.zeros(len(faces.sizes), np.int32),
        uvs=uvs[faces.corners],
    )


def create_mesh(
    name: str,
    surface: MeshFaces,
    materials: Sequence[bpy.types.Material | None],
    layers: LayerNames = LayerNames(),
) -> bpy.types.Mesh:
    """Create a mesh from `surface`, with its faces in the same order.

    `randoms` are stored only if a material uses the random number of objects.
    """
    mesh = bpy.data.meshes.new(name)
    starts = np.concatenate([[0], np.cumsum(surface.sizes[:-1])]).astype(np.int32)
    mesh.vertices.add(len(surface.positions))
    mesh.vertices.foreach_set("co", surface.positions.ravel())
    mesh.loops.add(len(surface.corners))
    mesh.loops.foreach_set("vertex_index", surface.corners)
    mesh.polygons.add(len(surface.sizes))
    mesh.polygons.foreach_set("loop_start", starts)
    for material in materials:
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", surface.material_ids)
    if surface.uvs is not None:
        for layer in layers.uv_maps:
            add_uv_map(mesh, layer, surface.uvs)
    if surface.colors is not None:
        for layer in layers.colors:
            attribute = mesh.color_attributes.new(layer, "FLOAT_COLOR", "CORNER")
            attribute.data.foreach_set("color", surface.colors.ravel())
    if surface.randoms is not None and any(map(_asks_for_random, materials)):
        mesh.attributes.new(RANDOM, "FLOAT", "FACE").data.foreach_set("value", surface.randoms)
    mesh.update(calc_edges=True)
    if surface.normals is not None:
        set_corner_normals(mesh, surface.normals)
    else:
        mesh.polygons.foreach_set("use_smooth", np.zeros(len(surface.sizes), bool))
    return mesh


def read_own_randoms(obj: bpy.types.Object) -> None:
    """Assign material copies that read each face's random number from the mesh instead of the object.

    The copies are linked to the object. The mesh keeps the artist's materials, for files.
    """
    if RANDOM not in obj.data.attributes:
        return
    for slot in obj.material_slots:
        if _asks_for_random(slot.material):
            material = slot.material
            slot.link, slot.material = "OBJECT", copy_for_joined(material)


def _asks_for_random(material: bpy.types.Material | None) -> bool:
    return material is not None and material.node_tree is not None and asks_for_random(material.node_tree)


def add_uv_map(mesh: bpy.types.Mesh, name: str, uvs: NDArray[np.float32]) -> str:
    """Add a UV map with `uvs` (c, 2). Return its name, which Blender may have changed to make it unique."""
    layer = mesh.uv_layers.new(name=name, do_init=False)
    layer.uv.foreach_set("vector", np.ascontiguousarray(uvs, np.float32).ravel())
    return layer.name


def _copies(triangles: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return (t,) the number of earlier triangles with the same three vertices.

    It compares 64-bit hashes. A collision only splits two triangles needlessly.
    """
    a, b, c = np.sort(triangles, axis=1).astype(np.uint64).T
    label = (a * np.uint64(0x9E3779B97F4A7C15) + b) * np.uint64(0xD6E8FEB86659FD93) + c
    order = np.argsort(label, kind="stable")
    place = np.arange(len(label))
    starts = np.ones(len(label), bool)
    starts[1:] = label[order[1:]] != label[order[:-1]]
    copies = np.empty(len(label), np.int64)
    copies[order] = place - np.maximum.accumulate(np.where(starts, place, 0))
    return copies
