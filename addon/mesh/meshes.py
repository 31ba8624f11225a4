"""Reader of evaluated meshes as arrays, with the matrices of their copies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from .baked_levels import follows_a_bake
from .realise import are_singular, first_not_finite

_Scalar = TypeVar("_Scalar", bound=np.generic)
_NONE = np.empty(0, np.float32)
_ALL_BITS = 0xFFFFFFFF

PROTECT = "Leafcloud Protect"
"""Name of the vertex group or attribute (points, corners or faces) in which an artist paints leaves never to prune."""
_NUMBERS = ("FLOAT", "INT", "INT8", "BOOLEAN")
"""Allowed data types of that attribute."""
MOST_TRIANGLES = 10_000_000
"""Limit on the triangles of a scene with all instances. They take gigabytes."""

_COMPONENTS = {
    **dict.fromkeys(_NUMBERS, ("value", 1)),
    "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
}
"""By data type: the property to read from an attribute's items, and its number of components."""
_PLACES = {"POINT": "triangles", "CORNER": "loops", "FACE": "faces"}
"""By attribute domain: the property of `Copies` with each triangle's indices into that domain."""


@dataclass(frozen=True)
class Copies:
    """One evaluated mesh with its materials, and the matrices of all its copies that one object places."""

    mesh: bpy.types.Mesh
    """Valid until the depsgraph is evaluated again."""
    object_name: str
    owner: bpy.types.Object
    """The original object that places the copies: the object itself, or an instancer."""
    owner_matrix: NDArray[np.float64]
    """(4, 4) world matrix of the owner, not singular."""
    materials: tuple[bpy.types.Material | None, ...]
    """Original materials by slot, at least one."""
    matrices: NDArray[np.float64]
    """(n, 4, 4) world matrices of the copies, none singular; `owner_matrix` for an object that is no instance."""
    randoms: NDArray[np.float32]
    """(n,) the Object Info node's Random of each copy, in [0, 1]."""
    protect_group: int = -1
    """Index of the object's vertex group `PROTECT`; −1 without one."""
    level: bpy.types.Object | None = None
    """The object itself, if it is a baked level; else None."""
    names: tuple[str, ...] = ()
    """Names of the object's and the owner's parents and collections, from the nearest."""
    parts: NDArray[np.int32] | None = None
    """(t,) indices into `materials` in place of the mesh's own, for a mesh that was divided further."""

    @property
    def owner_name(self) -> str:
        return str(self.owner.name)

    @cached_property
    def positions(self) -> NDArray[np.float32]:
        """(v, 3) vertices; raises `SceneError` for coordinates that are not finite."""
        positions = _read(self.mesh.attributes["position"].data, "vector", 3, np.float32)
        bad = first_not_finite(positions)
        if bad is not None:
            index, shown = bad
            raise SceneError(
                f"object {self.object_name!r}: vertex {index} lies at ({shown}), which is not finite; move or delete it"
            )
        return positions

    @cached_property
    def triangles(self) -> NDArray[np.int32]:
        """(t, 3) vertex indices."""
        return _read(self._loop_triangles, "vertices", 3, np.int32)

    @cached_property
    def loops(self) -> NDArray[np.int32]:
        """(t, 3) indices of face corners (loops)."""
        return _read(self._loop_triangles, "loops", 3, np.int32)

    @cached_property
    def faces(self) -> NDArray[np.int32]:
        """(t, 1) face indices."""
        return _read(self._loop_triangles, "polygon_index", 1, np.int32)

    @cached_property
    def slots(self) -> NDArray[np.int32]:
        """(t,) indices into `materials`. An index beyond the last slot counts as the last slot, as in Blender."""
        if self.parts is not None:
            return self.parts
        slots = _read(self._loop_triangles, "material_index", 1, np.int32)[:, 0]
        return np.clip(slots, 0, len(self.materials) - 1)

    @cached_property
    def normals(self) -> NDArray[np.float32]:
        """(t, 3, 3) corner normals, including custom normals."""
        return _read(self.mesh.corner_normals, "vector", 3, np.float32)[self.loops]

    def uvs(self, name: str) -> NDArray[np.float32] | None:
        """Return (t, 3, 2) the UV map or vector attribute `name`, else the render-active UV map; `None` without any."""
        named = self._spread(self.mesh.attributes.get(name), ("FLOAT2", "FLOAT_VECTOR"))
        if named is not None:
            return named[..., :2]
        layer = next((layer for layer in self.mesh.uv_layers if layer.active_render), None)
        return None if layer is None else _read(layer.uv, "vector", 2, np.float32)[self.loops]

    def colors(self, name: str) -> NDArray[np.float32] | None:
        """Return (t, 3, 4) an attribute as linear colors; `None` if it is missing.

        A number becomes gray. An empty name selects the render-active color attribute.
        """
        attributes = self.mesh.attributes
        values = self._spread(attributes.get(name or self.mesh.color_attributes.default_color_name), tuple(_COMPONENTS))
        if values is None:
            return None
        colors = np.ones((*values.shape[:2], 4), np.float32)
        match values.shape[2]:
            case 1:
                colors[..., :3] = values
            case 2:
                colors[..., :2], colors[..., 2] = values, 0.0
            case width:
                colors[..., :width] = values
        return colors

    def _spread(self, attribute: bpy.types.Attribute | None, types: Sequence[str]) -> NDArray[np.float32] | None:
        """Return (t, 3, width) an attribute at the triangles' corners; `None` for other domains or data types."""
        if attribute is None or attribute.domain not in _PLACES or attribute.data_type not in types:
            return None
        values = _read(attribute.data, *_COMPONENTS[attribute.data_type], np.float32)
        found = values[getattr(self, _PLACES[attribute.domain])]
        return np.broadcast_to(found, (len(found), 3, values.shape[1]))

    def protected(self) -> NDArray[np.bool_] | None:
        """Return (t,) whether any corner is painted by more than ½; `None` without a `PROTECT` attribute or group."""
        attribute = self.mesh.attributes.get(PROTECT)
        places = "triangles"
        if attribute is not None and attribute.domain in _PLACES and attribute.data_type in _NUMBERS:
            painted, places = _read(attribute.data, "value", 1, np.float32)[:, 0] > 0.5, _PLACES[attribute.domain]
        elif self.protect_group >= 0:
            painted = np.array([self._is_painted(vertex) for vertex in self.mesh.vertices], bool)
        else:
            return None
        chosen: NDArray[np.bool_] = painted[getattr(self, places)].any(axis=1)
        return chosen

    def _is_painted(self, vertex: bpy.types.MeshVertex) -> bool:
        return any(member.group == self.protect_group and member.weight > 0.5 for member in vertex.groups)

    def loose(self) -> str | None:
        """Return a sentence that counts vertices and edges without a face; `None` if there are none."""
        corner_vertices = _read(self.mesh.attributes[".corner_vert"].data, "value", 1, np.int32)
        corner_edges = _read(self.mesh.attributes[".corner_edge"].data, "value", 1, np.int32)
        vertices = len(self.mesh.vertices) - _distinct(corner_vertices, len(self.mesh.vertices))
        edges = len(self.mesh.edges) - _distinct(corner_edges, len(self.mesh.edges))
        counted = [_counted(vertices, "vertex", "vertices"), _counted(edges, "edge", "edges")]
        words = " and ".join(word for word in counted if word)
        return f"{self.object_name!r}: {words} without a face" if words else None

    @cached_property
    def _loop_triangles(self) -> bpy.types.bpy_prop_collection:
        self.mesh.calc_loop_triangles()
        return self.mesh.loop_triangles


def gather(
    depsgraph: bpy.types.Depsgraph, objects: Iterable[bpy.types.Object] | None
) -> tuple[list[Copies], list[str]]:
    """Collect all meshes with faces that the scene shows for `objects` (`None`: all that render), with instances.

    Curves, texts and the like count with their generated meshes. The order follows the objects' names, not the order
    of evaluation. Also returns a sentence for each thing left out.
    Raises `SceneError` if an object's own matrix is singular or not finite, or above `MOST_TRIANGLES`.
    """
    shown, unseen = _shown(depsgraph, objects)
    standing: list[Copies] = []
    dropped: list[str] = []
    for copies in sorted(shown, key=lambda copies: (copies.owner_name, copies.object_name)):
        if not np.isfinite(copies.owner_matrix).all():
            raise SceneError(
                f"the matrix of object {copies.owner_name!r} is not finite; repair its location, rotation and scale"
            )
        flat = are_singular(np.array([copies.owner_matrix, *copies.matrices]))
        if flat[0]:
            scale = ", ".join(f"{length:g}" for length in np.linalg.norm(copies.owner_matrix[:3, :3], axis=0))
            raise SceneError(
                f"the matrix of object {copies.owner_name!r} is singular (scale {scale}); give it a scale without zeros"
            )
        # Scattering tools hide instances by scaling them to zero.
        count = int(flat.sum())
        if count:
            words = _counted(count, "copy", "copies")
            dropped.append(f"{words} of {copies.object_name!r} by {copies.owner_name!r}, scaled to zero")
        if count < len(copies.matrices):
            kept = ~flat[1:]
            standing.append(replace(copies, matrices=copies.matrices[kept], randoms=copies.randoms[kept]))
    return standing, [*unseen, *dropped]


def _shown(
    depsgraph: bpy.types.Depsgraph, objects: Iterable[bpy.types.Object] | None
) -> tuple[list[Copies], list[str]]:
    """Return all copies of meshes with faces, and a sentence for each object without any."""
    wanted = None if objects is None else {obj.original for obj in objects}
    found: dict[tuple[object, ...], Copies] = {}
    matrices: dict[tuple[object, ...], list[NDArray[np.float64]]] = {}
    randoms: dict[tuple[object, ...], list[float]] = {}
    unseen = {} if wanted is None else {obj.name: "has no faces, or is hidden" for obj in wanted}
    triangles = 0
    for instance in depsgraph.object_instances:
        obj = instance.object
        owner = instance.parent if instance.is_instance else obj
        if not instance.show_self or obj.type != "MESH" or (wanted is not None and owner.original not in wanted):
            continue
        if wanted is None and owner.hide_render:
            unseen[owner.name] = "is hidden in renders"
            continue
        if len(obj.data.polygons) == 0:
            unseen.setdefault(owner.name, "has no faces")
            continue
        triangles += len(obj.data.loops) - 2 * len(obj.data.polygons)
        if triangles > MOST_TRIANGLES:
            # Raise at once, although Blender never frees the rest of the instances: millions more take seconds.
            raise SceneError(
                f"the scene has more than {MOST_TRIANGLES} triangles with all instances, counted to object "
                f"{owner.name!r}: use fewer instances, or bake parts of the scene apart"
            )
        materials = _materials(obj)
        key = (owner.original, obj.original, obj.data.as_pointer(), materials)
        if key not in found:
            own_matrix = np.array(owner.matrix_world, np.float64)
            group = obj.vertex_groups.find(PROTECT)
            places = np.empty((0, 4, 4))
            level = obj.original if follows_a_bake(obj.original) else None
            around = names_around(obj.original, owner.original)
            found[key] = Copies(
                obj.data, obj.name, owner.original, own_matrix, materials, places, _NONE, group, level, around
            )
        matrices.setdefault(key, []).append(np.array(instance.matrix_world, np.float64))
        randoms.setdefault(key, []).append(_random_of(instance))
    shown = [
        replace(copies, matrices=np.array(matrices[key]), randoms=np.array(randoms[key], np.float32))
        for key, copies in found.items()
    ]
    names = {copies.owner_name for copies in shown}
    return shown, [f"{name!r} {reason}" for name, reason in sorted(unseen.items()) if name not in names]


def names_around(*objects: bpy.types.Object) -> tuple[str, ...]:
    """Return the names of the parents and collections of objects, from the nearest."""
    names: list[str] = []
    for each in dict.fromkeys(objects):
        parent = each.parent
        while parent is not None:
            names.append(parent.name)
            parent = parent.parent
        names += [collection.name for collection in each.users_collection]
    return tuple(dict.fromkeys(names))


def _materials(obj: bpy.types.Object) -> tuple[bpy.types.Material | None, ...]:
    """Return the original materials by slot, from the mesh or, for slots linked to the object, from the object."""
    materials = list(obj.data.materials)
    for i, slot in enumerate(obj.material_slots[: len(materials)]):
        if slot.link == "OBJECT":
            materials[i] = slot.material
    return tuple(material and material.original for material in materials) or (None,)


def _read(collection: bpy.types.bpy_prop_collection, name: str, width: int, dtype: type[_Scalar]) -> NDArray[_Scalar]:
    """Return (n, width) a property of all items of a collection."""
    values = np.empty(len(collection) * width, dtype)
    collection.foreach_get(name, values)
    return values.reshape(-1, width)


def _distinct(indices: NDArray[np.integer[Any]], count: int) -> int:
    seen = np.zeros(count, bool)
    seen[indices] = True
    return int(np.count_nonzero(seen))


def _counted(count: int, one: str, many: str) -> str:
    return "" if count == 0 else f"{count} {one if count == 1 else many}"


def _random_of(instance: bpy.types.DepsgraphObjectInstance) -> float:
    """Return the random number in [0, 1] that Cycles' Object Info node gives an object or instance.

    That of an object is a hash of its name.
    """
    number = instance.random_id if instance.is_instance else _hash(_hash_of_text(instance.object.name))
    return (number & _ALL_BITS) / _ALL_BITS


def _hash_of_text(text: str) -> int:
    number = 0
    for byte in text.encode():
        number = (37 * number + byte) & _ALL_BITS
    return number


def _hash(number: int) -> int:
    """Return Bob Jenkins' lookup3 hash of `number` and 0 (public domain, 2006)."""
    a = b = c = (0xDEADBEEF + (2 << 2) + 13) & _ALL_BITS
    a = (a + number) & _ALL_BITS

    def turned(value: int, bits: int) -> int:
        return ((value << bits) | (value >> (32 - bits))) & _ALL_BITS

    c = ((c ^ b) - turned(b, 14)) & _ALL_BITS
    a = ((a ^ c) - turned(c, 11)) & _ALL_BITS
    b = ((b ^ a) - turned(a, 25)) & _ALL_BITS
    c = ((c ^ b) - turned(b, 16)) & _ALL_BITS
    a = ((a ^ c) - turned(c, 4)) & _ALL_BITS
    b = ((b ^ a) - turned(a, 14)) & _ALL_BITS
    return ((c ^ b) - turned(b, 24)) & _ALL_BITS
