"""Detection of the leaves in a scene.

The first rule that finds leaves decides: names that the user gives; names that contain a word for leaves; shapes. A
part is a material slot of an object, or some components of one, so leaves and trunk may share one mesh and one
material. Shapes are scored: each observation that speaks for leaves or against them adds to a part's score.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SMALL_TRIANGLES = 32
"""Maximum number of triangles of a component that counts as small."""

MANY_COMPONENTS = 16
"""Minimum number of small components, over all parts of one kind, that speak for leaves."""

SAME_KIND, ALIKE = 2.0, 4.0
"""Components with up to this many times the leaves' triangles may be leaves, too; others are twigs. Components of one
kind have the same triangles, and up to this many times the area of one another."""

LEAST_SCORE, SURE_SCORE, DOUBTFUL_SCORE = 2, 3, 1
"""Score from which a part is leaves; from which it surely is; from which another one may be, too."""

GROUND = 0.12
"""Share of a tree's height up to which things lie on the ground."""

_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
# At the start or at the end of a word: "leaflet" and "cloverleaf" match, "overleafing" and "leafless" do not.
_LEAF = re.compile(
    r"(?<![a-z])(?:leaf(?!less)|leaves|foliage|needle|frond|blatt(?!los)|blätter|laub(?!e|b|h|sä)|feuill|hoja|follaje"
    r"|fogli|folha)|(?:leaf|leafs|leaves|foliage|needles?|fronds?|blatt|blätter|feuilles?|hojas?|foglie?|folhas?)(?![a-z])"
    r"|листь|листв(?!е)|листа?(?![а-я])|хво[йя]|[叶葉](?![树樹])|잎"  # noqa: RUF001
)
_WOOD = re.compile(
    r"(?<![a-z])(?:bark|trunk|wood|stem|log|root|soil|dirt|ground|grave[ls]|pot|rock|stone|pebble|erde|[eé]corce|tronc|bois"
    r"|corteza|madera|corteccia|legno)s?(?![a-z])|(?:rinde|stamm|holz)(?![a-z])|кора|ствол|树皮|樹皮|樹幹|树干"
)

_ANY = re.compile(
    r"(?:leaf|leaves|foliage|needles?|fronds?|crown|canopy|branches|trunk|mesh|object|geometry|plane|empty|scene"
    r"|root ?node|armature|(?:scene |master )?collection|sammlung)?[\W\d_]*"
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
    doubt: str = ""
    """What may be wrong; empty for a sure choice."""


@dataclass(frozen=True)
class Shape:
    """What a part looks like.

    sizes: triangles of each connected component. area: of the surface. low, high: corners of its box in the world.
    color: linear RGB of a material without a texture. cut_out: whether a texture cuts its outline.
    are_rods: whether most components are long, thin and round.
    """

    sizes: NDArray[np.int64]
    area: float
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    color: tuple[float, float, float] | None = None
    cut_out: bool = False
    are_rods: bool = False

    @property
    def width(self) -> float:
        return max(self.high[0] - self.low[0], self.high[1] - self.low[1])

    @property
    def triangles(self) -> float:
        """Triangles of a component, as the median."""
        return float(np.median(self.sizes))

    @property
    def is_small(self) -> bool:
        """Whether most components are small."""
        return self.triangles <= SMALL_TRIANGLES


def choose_by_names(parts: Sequence[MaterialPart], names: Sequence[str] | None) -> LeafChoice | None:
    """Choose the parts that are leaves by their names; `None` if no name tells.

    `names`: names of objects, instancers or materials, as `named` finds them; `None` or empty: those with a word for
    leaves. Raises `LeavesError` for a name that no part has.
    """
    return _choose_named(parts, names) if names else _choose_telling(parts)


def choose_by_shape(parts: Sequence[MaterialPart], shapes: Sequence[Shape]) -> LeafChoice:
    """Choose the parts that are leaves by their shapes. Raises `LeavesError` if none looks like leaves."""
    whole = _Whole.of(parts, shapes)
    found = [whole.judged(part, shape) for part, shape in zip(parts, shapes, strict=True)]
    scores = [sum(found_of.values()) for found_of in found]
    indices = tuple(i for i, score in enumerate(scores) if score >= LEAST_SCORE)
    if not indices:
        raise LeavesError(
            "no object or material name contains a word for leaves, and no part looks like leaves; "
            f"name the leaves in `leaves`; {_inventory(parts)}"
        )
    # What speaks for the part with the largest area; the others are like it.
    main = max(indices, key=lambda i: shapes[i].area)
    reasons = [words for words, points in found[main].items() if points > 0]
    doubtful = [i for i, score in enumerate(scores) if i not in indices and score >= DOUBTFUL_SCORE]
    doubt = ""
    if doubtful:
        doubt = f"{_listed(parts, doubtful)} may be leaves, too"
    elif min(scores[i] for i in indices) < SURE_SCORE:
        unsure = [i for i in indices if scores[i] < SURE_SCORE]
        doubt = f"{_listed(parts, unsure)} may be no leaves"
    return LeafChoice(indices, f"{_listed(parts, indices)}: {', '.join(reasons)}; there are no leaf names.", doubt)


@dataclass(frozen=True)
class _Whole:
    """All parts together, as measures for each of them.

    ground: height below which things lie on the ground. main: all parts with components like those of the small part
    with the largest area; None without small parts. They are judged together: each leaf may be an object of its own.
    has_others: whether some object's name does not say wood: a stone pine is no stone.
    """

    low: float
    height: float
    ground: float
    width: float
    area: float
    components: int
    main: Shape | None
    has_others: bool

    @staticmethod
    def of(parts: Sequence[MaterialPart], shapes: Sequence[Shape]) -> _Whole:
        low = min(shape.low[2] for shape in shapes)
        height = max(max(shape.high[2] for shape in shapes) - low, 1e-9)
        ground = low + GROUND * height
        standing = [each for each in shapes if each.high[2] > ground]
        if not standing:  # A carpet.
            ground, standing = -math.inf, list(shapes)
        small = [each for each in standing if each.is_small]
        largest = max(small, key=lambda each: each.area) if small else None
        main = None if largest is None else _joined([each for each in shapes if _are_alike(each, largest)])
        return _Whole(
            low=low,
            height=height,
            ground=ground,
            width=max(*(each.width for each in standing), 0.0 if main is None else main.width, 1e-9),
            area=max(sum(each.area for each in standing), 1e-30),
            components=sum(len(each.sizes) for each in shapes),
            main=main,
            has_others=not all(says_wood(part.object_name) for part in parts),
        )

    def judged(self, part: MaterialPart, shape: Shape) -> dict[str, int]:
        """Return the observations of a part, each with its points."""
        return {words: points for words, points, holds in self._observations(part, shape) if holds}

    def _observations(self, part: MaterialPart, shape: Shape) -> Iterator[tuple[str, int, bool]]:
        seen = self.main if self.main is not None and _are_alike(shape, self.main) else shape
        share, width = seen.area / self.area, seen.width / self.width
        bottom = (seen.low[2] - self.low) / self.height
        is_apart, lies = self.components > 1, seen.high[2] < self.ground
        is_coarse = self.main is not None and seen.triangles > SAME_KIND * self.main.triangles
        many = f"{len(seen.sizes)} small components (the median has {seen.triangles:g} triangles)"
        is_many = seen.is_small and len(seen.sizes) >= MANY_COMPONENTS
        yield many, 2, is_many and not is_coarse and not lies
        yield "coarser than the leaves", -2, seen.is_small and is_coarse
        yield "its texture cuts it out", 2, shape.cut_out
        yield "much of the surface", 1, is_apart and share >= 0.2
        yield "little of the surface", -2, share < 0.02
        yield "as wide as the tree", 1, is_apart and width >= 0.6
        yield "narrow", -2, width < 0.25
        yield "above the ground", 1, bottom >= 0.2
        yield "stands on the ground like a trunk", -2, bottom <= 0.05 and width < 0.5
        yield "lies on the ground", -3, lies
        yield "long, thin and round like branches", -3, shape.are_rods
        yield "green", 1, shape.color is not None and _is_green(shape.color)
        yield "brown", -2, shape.color is not None and _is_brown(shape.color)
        yield "its material says wood or ground", -6, says_wood(part.material_name)
        yield "its name says wood or ground", -6, self.has_others and says_wood(part.object_name)


def _are_alike(shape: Shape, other: Shape) -> bool:
    """Return whether the components of two small parts are of one kind."""
    areas = [each.area / len(each.sizes) for each in (shape, other)]
    are_small = shape.is_small and other.is_small
    return are_small and shape.triangles == other.triangles and max(areas) <= ALIKE * min(areas)


def _joined(shapes: Sequence[Shape]) -> Shape:
    """Return the shape of parts together."""
    low = [min(shape.low[axis] for shape in shapes) for axis in range(3)]
    high = [max(shape.high[axis] for shape in shapes) for axis in range(3)]
    sizes = np.concatenate([shape.sizes for shape in shapes])
    return Shape(sizes, sum(shape.area for shape in shapes), (low[0], low[1], low[2]), (high[0], high[1], high[2]))


def _is_green(color: tuple[float, float, float]) -> bool:
    red, green, blue = color
    return green > 1.15 * red and green > 1.15 * blue


def _is_brown(color: tuple[float, float, float]) -> bool:
    red, green, blue = color
    return red > 1.2 * green and green >= blue and red < 0.6


def says_leaf(name: str) -> bool:
    """Return whether a name has a word that is, starts or ends with leaf, foliage, needle or frond, in one of ten
    languages."""
    return _LEAF.search(_plain(name)) is not None


def says_wood(name: str) -> bool:
    """Return whether a name has a word for wood, soil, stones or pots, in one of seven languages."""
    return _WOOD.search(_plain(name).replace("_", " ")) is not None


def _plain(name: str) -> str:
    """Return a name in lower case, with a space before each word in it that begins with a capital."""
    return _CAMEL.sub(" ", unicodedata.normalize("NFC", name)).lower()


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
    # Material names override the object's name: "oak_leaves" with the slots "leaf" and "bark" means "leaf" only, and
    # with "green" and "bark" it means "green".
    objects_with_leaf_material = {part.object_name for part in parts if says_leaf(part.material_name)}
    objects_with_others = {part.object_name for part in parts if not says_wood(part.material_name)}

    def is_leaf(part: MaterialPart) -> bool:
        if says_leaf(part.material_name) or part.object_name in objects_with_leaf_material:
            return says_leaf(part.material_name)
        if says_wood(part.material_name) and part.object_name in objects_with_others:
            return False
        names = (part.object_name, part.instancer_name)
        return any(says_leaf(name) and not says_wood(name) for name in names)

    indices = tuple(i for i, part in enumerate(parts) if is_leaf(part))
    if not indices:
        return None
    return LeafChoice(indices, f"{_listed(parts, indices)}: the names contain a word for leaves.")


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
