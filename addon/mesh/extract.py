"""Extraction of a tree from the scene: leaves and trunk as arrays, in the coordinates of the first leaf object.

All meshes come from the evaluated scene, so modifiers are applied and instances are realized. Array operations keep
this fast: a million triangles take a second or two.

Winding and normals: in the tree's coordinates every triangle winds counter-clockwise as seen from its front. The front
is the side that Blender shows as front, where the normals point. This also holds for parts that are mirrored relative
to the frame object (the first leaf object). `Tree.matrix` is the frame object's own world matrix, so its vertices keep
every bit. If that matrix mirrors, code that transforms triangles to the world must swap two corners of each.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..geometry import Geometry, Tree
from ..material.surface import Surface, read_surface
from ..material.textures import ACTIVE, Texture
from ..plan.leaves import (
    LeafChoice,
    LeavesError,
    MaterialPart,
    Shape,
    choose_by_names,
    choose_by_shape,
    is_any_tree,
    named,
    names_of,
)
from ..plan.other_levels import Extent, coarser, coarser_by_form
from .baked_levels import record_of
from .meshes import Copies, gather
from .motion import lost_motion
from .pieces import Piece, divided, ground_of, shape_of
from .realise import Triangles, joined, realise, relative, used_only
from .strays import without_strays

__all__ = ["SceneError", "Tree", "extract", "part_names"]

_Material: TypeAlias = bpy.types.Material | None


def extract(
    depsgraph: bpy.types.Depsgraph,
    objects: Iterable[bpy.types.Object] | None,
    *,
    leaf_names: Sequence[str] | None = None,
    name: str | None = None,
) -> Tree:
    """Read the tree from the evaluated scene.

    `objects`: the objects of the tree; their instances belong to it. `None` takes everything visible in renders.
    `leaf_names`: object or material names of the leaves. `None` detects the leaves. See `plan.leaves`.
    Raises `SceneError` if there are no faces, if an object is a level of a baked tree, if the leaves cannot be
    detected, if coordinates are not finite, or if an object's matrix is singular.
    """
    selected = None if objects is None else list(objects)
    if selected == []:
        raise SceneError("nothing is selected; select the objects of the tree")
    gathered, dropped = gather(depsgraph, selected)
    if not gathered:
        raise SceneError(_nothing(dropped))
    baked = next((copies.level for copies in gathered if copies.level is not None), None)
    if baked is not None:
        raise SceneError(_is_baked(baked))
    sources = tuple(dict.fromkeys(copies.owner for copies in gathered))
    gathered, others = _finest(gathered, leaf_names or ())
    surfaces = {material: read_surface(material) for copies in gathered for material in copies.materials}
    try:
        slots, choice = _chosen(gathered, leaf_names, surfaces)
    except LeavesError as error:
        raise SceneError(str(error)) from error
    leaves = [slots[i] for i in choice.indices]
    trunk = [slot for i, slot in enumerate(slots) if i not in set(choice.indices)]
    frame = leaves[0].copies
    reader = _Reader(frame.owner_matrix, surfaces, warnings=[])
    loose = dict.fromkeys(sentence for copies in gathered if (sentence := copies.loose()))
    crown, strays = without_strays(reader.geometry(leaves))
    doubt = [f"{choice.doubt}: see preview.png, and name the leaves in `leaves` if it is wrong"] if choice.doubt else []
    return Tree(
        name=name or _name(depsgraph, selected, frame),
        matrix=frame.owner_matrix,
        leaves=crown,
        trunk=reader.geometry(trunk) if trunk else None,
        choice=choice.reason,
        dropped=[*dropped, *loose],
        warnings=list(dict.fromkeys([*doubt, *others, *strays, *lost_motion(sources), *reader.warnings])),
        sources=sources,
    )


def _finest(gathered: Sequence[Copies], names: Sequence[str]) -> tuple[list[Copies], list[str]]:
    """Return the meshes without coarser levels of another tool, and a sentence on these. `names`: of leaves."""
    left_out = set(coarser([(copies.object_name, copies.owner_name, *copies.names) for copies in gathered]))
    if not left_out:
        single = [i for i, copies in enumerate(gathered) if len(copies.matrices) == 1]
        left_out = {single[i] for i in coarser_by_form([_extent(gathered[i]) for i in single])}
    if any(named(name, {gathered[i].object_name for i in left_out}) for name in names):
        return list(gathered), []
    coarse = sorted({repr(gathered[i].object_name) for i in left_out})
    kept = [copies for i, copies in enumerate(gathered) if i not in left_out]
    said = f"{', '.join(coarse[:8])}{' …' if len(coarse) > 8 else ''}: left out, coarser levels of another tool"
    return kept, [said] if left_out else []


def _extent(copies: Copies) -> Extent:
    matrix = copies.matrices[0]
    places = copies.positions.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    a, b, c = places[copies.triangles].transpose(1, 0, 2)
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    names = frozenset("" if material is None else material.name for material in copies.materials)
    return Extent(np.array([places.min(axis=0), places.max(axis=0)]), area, len(copies.triangles), names)


def _chosen(
    gathered: Sequence[Copies], names: Sequence[str] | None, surfaces: dict[_Material, Surface]
) -> tuple[list[_Slot], LeafChoice]:
    """Return all parts, and which of them are leaves."""
    slots = _slots(gathered)
    by_names = choose_by_names([_part(slot) for slot in slots], names)
    if by_names is not None:
        return slots, by_names
    placed = [(copies.positions, matrix[2]) for copies in gathered for matrix in copies.matrices[:_SOME]]
    heights = [positions @ up[:3] + up[3] for positions, up in placed]
    ground = ground_of([float(each.min()) for each in heights], [float(each.max()) for each in heights])
    slots = [slot for copies in gathered for slot in _parted(copies, ground)]
    return slots, choose_by_shape([_part(slot) for slot in slots], [_shape(slot, surfaces) for slot in slots])


_SOME = 1000
"""Copies of a mesh that tell how high the tree is."""


def _parted(copies: Copies, ground: float) -> list[_Slot]:
    """Return the parts of a mesh by its components, as slots of a mesh that has as many."""
    parts, pieces = divided(copies.positions, copies.triangles, copies.slots, copies.matrices[0], ground)
    made = replace(copies, parts=parts, materials=tuple(copies.materials[piece.slot] for piece in pieces))
    count = len(copies.matrices)
    return [_Slot(made, i, int(piece.sizes.sum()) * count, piece) for i, piece in enumerate(pieces)]


def _shape(slot: _Slot, surfaces: dict[_Material, Surface]) -> Shape:
    copies = slot.copies
    assert slot.piece is not None, "a mesh that was divided"
    own = copies.triangles[copies.slots == slot.index]
    return shape_of(copies.positions, own, copies.matrices, slot.piece, surfaces[slot.material])


def part_names(depsgraph: bpy.types.Depsgraph, objects: Sequence[bpy.types.Object]) -> set[str]:
    """Return the names that can select parts of the objects as leaves; empty if no object has faces."""
    gathered, _ = gather(depsgraph, objects)
    return set().union(*(names_of(_part(slot)) for slot in _slots(gathered)))


@dataclass(frozen=True)
class _Slot:
    """One material slot of some copies of a mesh."""

    copies: Copies
    index: int
    count: int
    """Number of triangles, summed over all copies."""
    piece: Piece | None = None
    """The part by components, in a mesh that was divided."""

    @property
    def material(self) -> _Material:
        return self.copies.materials[self.index]


@dataclass(frozen=True)
class _Reader:
    """Builder of geometry from parts, in the coordinates of the matrix `frame`."""

    frame: NDArray[np.float64]
    surfaces: dict[_Material, Surface]
    warnings: list[str]
    """Filled while reading."""

    def geometry(self, slots: Sequence[_Slot]) -> Geometry:
        materials = list(dict.fromkeys(slot.material for slot in slots))
        numbers = {material: i for i, material in enumerate(materials)}
        chosen: dict[int, tuple[Copies, list[int]]] = {}
        for slot in slots:
            chosen.setdefault(id(slot.copies), (slot.copies, []))[1].append(slot.index)
        mesh = joined([self._realised(copies, indices, numbers) for copies, indices in chosen.values()])
        return Geometry(
            mesh.positions,
            mesh.triangles,
            mesh.uvs,
            mesh.normals,
            mesh.colors,
            mesh.material_ids,
            materials,
            mesh.randoms,
            mesh.protected,
        )

    def _realised(self, copies: Copies, indices: list[int], numbers: dict[_Material, int]) -> Triangles:
        """Return the triangles of the slots `indices`, once for each copy."""
        wanted = np.isin(np.arange(len(copies.materials)), indices)
        numbers_of_slots = np.array([numbers.get(material, -1) for material in copies.materials], np.int32)
        source = Triangles(
            copies.positions,
            copies.triangles,
            copies.normals,
            self._uvs(copies, indices),
            self._colors(copies, indices),
            numbers_of_slots[copies.slots],
            np.zeros(len(copies.triangles), np.float32),
            copies.protected(),
        )
        chosen = used_only(source, wanted[copies.slots])
        placed = realise(chosen, relative(self.frame, copies.matrices), copies.randoms)
        if not np.isfinite(placed.positions).all():
            raise SceneError(
                f"object {copies.object_name!r} is too far from the leaves for single precision; move it closer"
            )
        return placed

    def _uvs(self, copies: Copies, indices: list[int]) -> NDArray[np.float32] | None:
        uvs = copies.uvs(ACTIVE)
        for i in indices:
            texture = self.surfaces[copies.materials[i]].texture
            if texture is None:
                continue
            named = copies.uvs(texture.uv_map) if texture.uv_map else uvs
            if uvs is None or named is None:
                self._warn(copies, f"has no UV map for {texture.words}")
                continue
            of_slot = copies.slots == i
            if named is not uvs:
                uvs = np.where(of_slot[:, None, None], named, uvs)
            self._check_wrapping(copies, texture, uvs[of_slot])
        if uvs is not None and not (finite := np.isfinite(uvs)).all():
            self._warn(copies, "has texture coordinates that are not finite: they are set to 0")
            uvs = np.where(finite, uvs, np.float32(0.0))
        return uvs

    def _check_wrapping(self, copies: Copies, texture: Texture, uvs: NDArray[np.float32]) -> None:
        # UVs of leaf cards often exceed [0, 1] by a rounding error.
        outside = bool((uvs < -1e-3).any() or (uvs > 1.001).any())
        if outside and texture.extension != "REPEAT":
            mode = texture.extension.lower()
            self._warn(copies, f"uses {texture.words} ({mode}) outside [0, 1], where the bake repeats it")

    def _colors(self, copies: Copies, indices: list[int]) -> NDArray[np.float32] | None:
        """Return (t, 3, 4) the color attributes' RGB where they multiply color, their alpha where they multiply alpha.

        A missing attribute counts as 0, as in Blender.
        """
        result: NDArray[np.float32] | None = None
        for i in indices:
            surface = self.surfaces[copies.materials[i]]
            for attribute, channels in ((surface.color_attribute, slice(0, 3)), (surface.alpha_attribute, slice(3, 4))):
                if attribute is None:
                    continue
                values = copies.colors(attribute)
                if values is None:
                    self._warn(
                        copies,
                        f"has no color attribute {attribute!r} for material {surface.name!r}: it counts as black with "
                        f"alpha 0, as in Blender; add that attribute",
                    )
                if result is None:
                    result = np.ones((len(copies.triangles), 3, 4), np.float32)
                of_slot = copies.slots == i
                result[of_slot, :, channels] = 0.0 if values is None else values[of_slot, :, channels]
        return result

    def _warn(self, copies: Copies, words: str) -> None:
        self.warnings.append(f"object {copies.object_name!r} {words}")


def _slots(gathered: Sequence[Copies]) -> list[_Slot]:
    """Return the material slots with triangles."""
    return [
        _Slot(copies, i, int(count) * len(copies.matrices))
        for copies in gathered
        for i, count in enumerate(np.bincount(copies.slots, minlength=len(copies.materials)))
        if count > 0
    ]


def _part(slot: _Slot) -> MaterialPart:
    copies, material = slot.copies, slot.material
    return MaterialPart(
        object_name=copies.object_name,
        material_name="" if material is None else material.name,
        triangles=slot.count,
        instancer_name=copies.owner_name if copies.owner_name != copies.object_name else "",
    )


def _name(depsgraph: bpy.types.Depsgraph, selected: Sequence[bpy.types.Object] | None, frame: Copies) -> str:
    if selected is None and bpy.data.filepath:
        return bpy.path.display_name_from_filepath(bpy.data.filepath)
    active = depsgraph.view_layer.objects.active
    if selected is not None and active is not None and active.original in [obj.original for obj in selected]:
        return _telling_name(active.original)
    return frame.owner_name


def _telling_name(obj: bpy.types.Object) -> str:
    """Return the name of an object; of its parent, collection or file, if it is just "leaves" or the like."""
    above, parent = [obj.name], obj.parent
    while parent is not None:
        above.append(parent.name)
        parent = parent.parent
    above += [each.name for each in obj.users_collection]
    above.append(bpy.path.display_name_from_filepath(bpy.data.filepath))
    return next((name for name in above if name and not is_any_tree(name)), obj.name)


def _is_baked(level: bpy.types.Object) -> str:
    made = record_of(level)
    sources = "its source objects" if made is None else ", ".join(map(repr, made.sources[:8]))
    remedy = f"bake {sources} (select them, or show them in renders and hide the levels there)"
    return f"object {level.name!r} is a level of a baked tree: {remedy}"


def _nothing(dropped: Sequence[str]) -> str:
    found = "; ".join(dropped[:8]) or "no visible objects"
    return f"nothing to bake, there are no faces: {found}; select or open a tree with leaves"
