"""Detection of the leaves in a scene.

The first rule that finds leaves decides: names that the user gives; names that contain a word for leaves; many small
components. A part is a material slot of an object, so leaves and trunk may share one mesh.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SMALL_TRIANGLES = 32
"""Maximum number of triangles of a component that counts as a leaf."""

MANY_COMPONENTS = 16
"""Minimum number of small components, over all chosen parts, that count as leaves."""

SAME_KIND = 2.0
"""Parts with up to this many times the finest part's triangles per component are leaves, too; others are twigs."""

_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
# At the start or at the end of a word: "leaflet" and "cloverleaf" match, "overleafing" and "leafless" do not.
_LEAF = re.compile(
    r"(?<![a-z])(?:leaf(?!less)|leaves|foliage|needle|frond)|(?:leaf|leafs|leaves|foliage|needles?|fronds?)(?![a-z])"
)


_ANY = re.compile(
    r"(?:leaf|leaves|foliage|needles?|fronds?|crown|canopy|branches|trunk|mesh|object|geometry|plane|empty)?[\W\d_]*"
)


class LeavesError(ValueError):
    """No rule finds the leaves. The message lists the names in the scene."""


@dataclass(frozen=True)
class MaterialPart:
    """The triangles of one material slot of one object."""

    object_name: str
    material_name: str
    """Empty if the slot has no material."""
    triangles: int
    instancer_name: str = ""
    """The object that places copies of this one; empty if the object is no copy."""


@dataclass(frozen=True)
class LeafChoice:
    """The leaves among a sequence of parts."""

    indices: tuple[int, ...]
    """Indices of the parts, ascending, at least one."""
    reason: str
    """One sentence: which parts are leaves, and why."""


Measure = Callable[[int], NDArray[np.int64]]
"""A function that returns the number of triangles of each connected component of the part with an index."""


def choose_leaves(parts: Sequence[MaterialPart], names: Sequence[str] | None, measure: Measure) -> LeafChoice:
    """Choose the parts that are leaves.

    `names`: names of objects, instancers or materials, as `named` finds them; `None` or empty: detect the leaves.
    `measure` is called only if no name matches, because counting components takes a second for a million triangles.
    Raises `LeavesError` for a name that no part has, and if no rule finds leaves.
    """
    if names:
        return _choose_named(parts, names)
    return _choose_telling(parts) or _choose_small(parts, measure)


def says_leaf(name: str) -> bool:
    """Return whether a name has a word that is, starts or ends with leaf, leaves, foliage, needle or frond."""
    return _LEAF.search(_CAMEL.sub(" ", name).lower()) is not None


def is_any_tree(name: str) -> bool:
    """Return whether a name fits a part of any tree, as "leaves" or "Mesh.001" does, and tells no tree from others."""
    return _ANY.fullmatch(name.lower()) is not None


def named(name: str, names: Iterable[str]) -> set[str]:
    """Return the names that equal `name`, or, if there is none, those that differ from it by case alone."""
    equal = {each for each in names if each.casefold() == name.casefold()}
    return {name} if name in equal else equal


def names_of(part: MaterialPart) -> set[str]:
    """Return the names of the part: its object, its material, and its instancer."""
    return {part.object_name, part.material_name, part.instancer_name} - {""}


def _choose_named(parts: Sequence[MaterialPart], names: Sequence[str]) -> LeafChoice:
    here = set().union(*map(names_of, parts))
    wanted: set[str] = set()
    for name in names:
        found = named(name, here)
        if not found:
            raise LeavesError(f"no object or material is named {name!r}; {_inventory(parts)}")
        wanted |= found
    indices = tuple(i for i, part in enumerate(parts) if wanted & names_of(part))
    return LeafChoice(indices, f"{_listed(parts, indices)}: named by the user ({_quoted(names)}).")


def _choose_telling(parts: Sequence[MaterialPart]) -> LeafChoice | None:
    # Material names override the object's name: "oak_leaves" with the slots "leaf" and "bark" means "leaf" only.
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
    return LeafChoice(indices, f"{_listed(parts, indices)}: the names contain leaf, leaves, foliage, needle or frond.")


def _choose_small(parts: Sequence[MaterialPart], measure: Measure) -> LeafChoice:
    sizes = [measure(i) for i in range(len(parts))]
    medians = [float(np.median(of_part)) if len(of_part) else np.inf for of_part in sizes]
    finest = min(medians, default=np.inf)
    limit = min(SAME_KIND * finest, SMALL_TRIANGLES)
    indices = tuple(i for i, median in enumerate(medians) if median <= limit)
    count = sum(len(sizes[i]) for i in indices)
    if count < MANY_COMPONENTS:
        raise LeavesError(
            "no object or material name contains a word for leaves, and no part is made of many small components; "
            f"name the leaves in `leaves`; {_inventory(parts)}"
        )
    median = float(np.median(np.concatenate([sizes[i] for i in indices])))
    why = f"{count} small components (the median has {median:g} triangles), and there are no leaf names"
    return LeafChoice(indices, f"{_listed(parts, indices)}: {why}.")


def _inventory(parts: Sequence[MaterialPart]) -> str:
    objects = dict.fromkeys(name for part in parts for name in (part.instancer_name, part.object_name) if name)
    materials = dict.fromkeys(part.material_name for part in parts if part.material_name)
    return f"objects: {_quoted(objects) or 'none'}; materials: {_quoted(materials) or 'none'}"


def _listed(parts: Sequence[MaterialPart], indices: Sequence[int]) -> str:
    """Return the chosen parts in words: complete objects by name, others with their materials."""
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
    """Join words, shortened to `most`: a scene may have thousands of names, a message is one line."""
    rest = len(words) - most
    return ", ".join(words[:most]) + (f" and {rest} more" if rest > 0 else "")
