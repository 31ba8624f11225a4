"""Which parts of a scene are leaves.

The first rule that applies decides: names that the user gives; names that say so; many small components. A part is an
object's material slot, so that leaves and wood may share one mesh.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

SMALL_TRIANGLES = 32
"""A component of more triangles is not taken for a leaf."""

MANY_COMPONENTS = 16
"""So many small components, over all the parts chosen, are taken for leaves."""

SAME_KIND = 2.0
"""Parts whose components have up to so many times the triangles of the finest part are leaves too; others are twigs."""

_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
# At the start or at the end of a word: "leaflet" and "cloverleaf" say leaf, "overleafing" and "leafless" do not.
_LEAF = re.compile(
    r"(?<![a-z])(?:leaf(?!less)|leaves|foliage|needle|frond)|(?:leaf|leafs|leaves|foliage|needles?|fronds?)(?![a-z])"
)


class LeavesError(ValueError):
    """It cannot be told which parts are leaves; the message lists the names that there are."""


@dataclass(frozen=True)
class Part:
    """The triangles of one material slot of one object."""

    object_name: str
    material_name: str
    """Empty where the slot has no material."""
    triangles: int
    instancer_name: str = ""
    """The object that places copies of this one; empty when the object stands for itself."""


@dataclass(frozen=True)
class Choice:
    """The leaves among a sequence of parts."""

    indices: tuple[int, ...]
    """Into the parts, ascending, at least one."""
    reason: str
    """One sentence: which parts are leaves, and why."""


Measure = Callable[[int], NDArray[np.int64]]
"""The number of triangles of each connected component of the part with this index."""


def choose_leaves(parts: Sequence[Part], names: Sequence[str] | None, measure: Measure) -> Choice:
    """Tells the leaves from the wood.

    `names` are exact object, instancer or material names; `None` or empty lets the scene tell. `measure` is called only
    when no name tells, because counting components takes a second for a million triangles.
    Raises `LeavesError` when a name is not there, and when nothing tells.
    """
    if names:
        return _choose_named(parts, names)
    return _choose_telling(parts) or _choose_small(parts, measure)


def says_leaf(name: str) -> bool:
    """Whether a name says leaf, leaves, foliage, needle or frond, as a word or as the start or the end of one."""
    return _LEAF.search(_CAMEL.sub(" ", name).lower()) is not None


def names_of(part: Part) -> set[str]:
    """What the part may be called by: its object, its material, what places copies of it."""
    return {part.object_name, part.material_name, part.instancer_name} - {""}


def component_sizes(triangles: NDArray[np.integer[Any]], points: NDArray[np.floating[Any]]) -> NDArray[np.int64]:
    """The number of triangles of each connected component, in the order of their first points.

    `triangles` (t, 3) are indices into `points` (v, 3). Points that coincide exactly count as one: files split them
    where normals or texture coordinates differ.
    """
    if len(triangles) == 0:
        return np.zeros(0, np.int64)
    welded = _weld(points)[triangles]
    roots = _roots(np.concatenate([welded[:, :2], welded[:, 1:]]), int(welded.max()) + 1)
    sizes = np.bincount(roots[welded[:, 0]])
    return sizes[sizes > 0]


def _choose_named(parts: Sequence[Part], names: Sequence[str]) -> Choice:
    for name in names:
        if not any(name in names_of(part) for part in parts):
            raise LeavesError(f"no object or material is named {name!r}; {_inventory(parts)}")
    indices = tuple(i for i, part in enumerate(parts) if any(name in names_of(part) for name in names))
    return Choice(indices, f"{_listed(parts, indices)}: named by the user ({_quoted(names)}).")


def _choose_telling(parts: Sequence[Part]) -> Choice | None:
    # Within an object a material is the finer word: of "oak_leaves" with slots "leaf" and "bark" only "leaf" is meant.
    objects_with_leaf_material = {part.object_name for part in parts if says_leaf(part.material_name)}
    indices = tuple(
        i
        for i, part in enumerate(parts)
        if says_leaf(part.material_name)
        or (
            part.object_name not in objects_with_leaf_material
            and (says_leaf(part.object_name) or says_leaf(part.instancer_name))
        )
    )
    if not indices:
        return None
    return Choice(indices, f"{_listed(parts, indices)}: the names say leaf, leaves, foliage, needle or frond.")


def _choose_small(parts: Sequence[Part], measure: Measure) -> Choice:
    sizes = [measure(i) for i in range(len(parts))]
    medians = [float(np.median(of_part)) if len(of_part) else np.inf for of_part in sizes]
    finest = min(medians, default=np.inf)
    limit = min(SAME_KIND * finest, SMALL_TRIANGLES)
    indices = tuple(i for i, median in enumerate(medians) if median <= limit)
    count = sum(len(sizes[i]) for i in indices)
    if count < MANY_COMPONENTS:
        raise LeavesError(
            "no object or material name says leaf, and no part is made of many small components; "
            f"name the leaves in `leaves`; {_inventory(parts)}"
        )
    median = float(np.median(np.concatenate([sizes[i] for i in indices])))
    why = f"{count} small components (the median has {median:g} triangles), and no name says leaf"
    return Choice(indices, f"{_listed(parts, indices)}: {why}.")


def _inventory(parts: Sequence[Part]) -> str:
    objects = dict.fromkeys(name for part in parts for name in (part.instancer_name, part.object_name) if name)
    materials = dict.fromkeys(part.material_name for part in parts if part.material_name)
    return f"objects: {_quoted(objects) or 'none'}; materials: {_quoted(materials) or 'none'}"


def _listed(parts: Sequence[Part], indices: Sequence[int]) -> str:
    """The chosen parts in words: whole objects by their names, others with their materials."""
    chosen = set(indices)
    words: dict[str, None] = {}
    for i in indices:
        part = parts[i]
        whole = all(j in chosen for j, other in enumerate(parts) if other.object_name == part.object_name)
        words[repr(part.object_name) if whole else f"{part.object_name!r} (material {part.material_name!r})"] = None
    return _shortened(list(words))


def _quoted(names: Sequence[str] | dict[str, None]) -> str:
    return _shortened([repr(name) for name in names])


def _shortened(words: Sequence[str], most: int = 12) -> str:
    """A scene may have thousands of names, a message is one line."""
    rest = len(words) - most
    return ", ".join(words[:most]) + (f" and {rest} more" if rest > 0 else "")


def _weld(points: NDArray[np.floating[Any]]) -> NDArray[np.int64]:
    """(v,) the same number for points that coincide exactly."""
    order = np.lexsort(points.T)
    ordered = points[order]
    starts = np.ones(len(points), bool)
    starts[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    numbers = np.empty(len(points), np.int64)
    numbers[order] = np.cumsum(starts) - 1
    return numbers


def _roots(edges: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """(count,) the smallest vertex of each vertex' component. Hooking and pointer jumping: some log(count) passes."""
    roots = np.arange(count)
    while True:
        ends = roots[edges]
        apart = ends[:, 0] != ends[:, 1]
        if not apart.any():
            return roots
        edges, ends = edges[apart], ends[apart]
        np.minimum.at(roots, ends.max(axis=1), ends.min(axis=1))
        while not np.array_equal(roots, parents := roots[roots]):
            roots = parents
