"""Small plants of many kinds, made by script. The script knows which triangles are leaves.

A plant is made of parts, each leaves or not. A way of packing puts them into objects and materials, with names and
colors that tell or do not. `KINDS` has all plants by name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import bpy
import numpy as np
from numpy.typing import NDArray

from addon.errors import SceneError
from addon.geometry import Geometry, world_positions
from addon.mesh.extract import extract

Mesh = tuple[NDArray[np.float64], Sequence[tuple[int, ...]]]
"""Vertices (v, 3) and faces."""

HEIGHT, CROWN = 4.0, np.array([0.0, 0.0, 4.2])
GREEN, BROWN, GREY, WHITE = (0.1, 0.3, 0.05), (0.2, 0.1, 0.05), (0.3, 0.3, 0.3), (0.8, 0.8, 0.8)


_Placed = tuple[NDArray[np.float64], float]
"""The middle of a triangle and its area."""


@dataclass(frozen=True)
class Part:
    """A part of a plant. color: of its flat material. is_leaf: None for what belongs to no plant."""

    name: str
    mesh: Mesh
    color: tuple[float, float, float]
    is_leaf: bool | None


@dataclass(frozen=True)
class Found:
    """What the search for leaves found.

    leaves: area of the true leaves that it found, over the area of all true leaves. others: area that it took for
    leaves by mistake, over the same. is_told: whether a warning tells of a doubt, or the plant was refused.
    """

    leaves: float
    others: float
    is_told: bool

    @property
    def outcome(self) -> str:
        if self.is_told:
            return "asked"
        return "right" if self.leaves >= 0.98 and self.others <= 0.02 else "wrong"


def _random() -> np.random.Generator:
    return np.random.default_rng(7)


def _joined(meshes: list[Mesh]) -> Mesh:
    vertices, faces, first = [], [], 0
    for points, own in meshes:
        vertices.append(points)
        faces += [tuple(first + i for i in face) for face in own]
        first += len(points)
    return np.concatenate(vertices), faces


def _tube(height: float, radius: float, rings: int, sides: int, at: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    turns = np.arange(sides) * math.tau / sides
    circle = np.stack([np.cos(turns), np.sin(turns), np.zeros(sides)], axis=1)
    levels = [circle * radius * (1.0 - 0.5 * i / rings) + [0, 0, height * i / rings] for i in range(rings + 1)]
    faces = [
        (i * sides + j, i * sides + (j + 1) % sides, (i + 1) * sides + (j + 1) % sides, (i + 1) * sides + j)
        for i in range(rings)
        for j in range(sides)
    ]
    return np.concatenate(levels) + np.array(at), faces


def _places(count: int, radius: float = 1.8) -> NDArray[np.float64]:
    """Return places in a ball around the crown's middle."""
    random = _random()
    away = random.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    places: NDArray[np.float64] = CROWN + away * radius * np.cbrt(random.uniform(0.2, 1.0, (count, 1)))
    return places


def _leaf(shape: NDArray[np.float64], faces: Sequence[tuple[int, ...]], places: NDArray[np.float64]) -> Mesh:
    """Return a copy of a leaf at each place, turned at random."""
    random = _random()
    turns = np.linalg.qr(random.normal(size=(len(places), 3, 3)))[0]
    return _joined([(shape @ turn + place, faces) for turn, place in zip(turns, places, strict=True)])


CARD = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0]])


def cards(count: int = 300) -> Mesh:
    return _leaf(CARD, [(0, 1, 2, 3)], _places(count))


def folded(count: int = 300) -> Mesh:
    """Leaves of eight triangles."""
    points = np.array([[x * 0.2, y * 0.1, 0.05 * abs(x - 1)] for x in range(5) for y in (0, 1)])
    faces = [(2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1) for i in range(4)]
    return _leaf(points, faces, _places(count))


def needles(count: int = 600) -> Mesh:
    return _leaf(np.array([[0, 0, 0], [0.4, 0.01, 0], [0.4, -0.01, 0]]), [(0, 1, 2)], _places(count))


def _ball(radius: float, at: NDArray[np.float64], flat: float = 1.0, rings: int = 6, sides: int = 10) -> Mesh:
    angles = np.linspace(0.0, math.pi, rings + 1)[1:-1]
    turns = np.arange(sides) * math.tau / sides
    ring = [[math.sin(a) * math.cos(t), math.sin(a) * math.sin(t), flat * math.cos(a)] for a in angles for t in turns]
    points = np.array([[0, 0, flat], *ring, [0, 0, -flat]]) * radius + at
    last = len(points) - 1
    faces: list[tuple[int, ...]] = [(0, 1 + j, 1 + (j + 1) % sides) for j in range(sides)]
    for i in range(rings - 2):
        for j in range(sides):
            a, b = 1 + i * sides + j, 1 + i * sides + (j + 1) % sides
            faces.append((a, a + sides, b + sides, b))
    below = 1 + (rings - 2) * sides
    return points, [*faces, *((last, below + (j + 1) % sides, below + j) for j in range(sides))]


def blobs(count: int = 3) -> Mesh:
    places = CROWN + np.array([[0.0, 0.0, 0.5], [1.0, 0.3, -0.4], [-0.9, -0.4, -0.3]])[:count]
    return _joined([_ball(1.2 - 0.15 * i, place, sides=10 + i) for i, place in enumerate(places)])


def discs(count: int = 18) -> Mesh:
    return _joined([_ball(0.7, place, 0.25) for place in _places(count, 1.4)])


def fronds(count: int = 12) -> Mesh:
    def frond(turn: float) -> Mesh:
        along = np.linspace(0.0, 2.2, 11)
        rise = HEIGHT + 0.6 * along - 0.35 * along**2
        across = np.array([-math.sin(turn), math.cos(turn), 0.0]) * 0.2
        spine = np.stack([along * math.cos(turn), along * math.sin(turn), rise], axis=1)
        points = np.concatenate([spine - across, spine, spine + across])
        faces = [(i, i + 1, 12 + i, 11 + i) for i in range(10)] + [(11 + i, 12 + i, 23 + i, 22 + i) for i in range(10)]
        return points, faces

    return _joined([frond(math.tau * i / count) for i in range(count)])


def cones() -> Mesh:
    """A conifer of a kit: three cones of few triangles."""

    def cone(z: float, radius: float) -> Mesh:
        turns = np.arange(9) * math.tau / 9
        circle = np.stack([radius * np.cos(turns), radius * np.sin(turns), np.full(9, z)], axis=1)
        return np.concatenate([circle, [[0.0, 0.0, z + 1.6]]]), [(j, (j + 1) % 9, 9) for j in range(9)]

    return _joined([cone(1.2 + i, 1.4 - 0.3 * i) for i in range(3)])


def grass(count: int = 200) -> Mesh:
    random = _random()
    feet = np.concatenate([random.uniform(-1.5, 1.5, (count, 2)), np.zeros((count, 1))], axis=1)
    blade = np.array([[0, 0, 0], [0.04, 0, 0], [0.05, 0.05, 0.4], [0.02, 0.05, 0.4], [0.06, 0.15, 0.7]])
    return _joined([(blade + foot, [(0, 1, 2, 3), (3, 2, 4)]) for foot in feet])


def trunk() -> Mesh:
    return _tube(HEIGHT, 0.2, 6, 10)


def branched() -> Mesh:
    """A trunk with eight branches, each a tube of its own."""
    return _joined([trunk(), *(_tube(0.9, 0.05, 3, 6, tuple(place)) for place in _places(8, 1.0))])


def marks() -> Mesh:
    random = _random()
    rings = [(random.uniform(0.4, 2.2), random.uniform(0.0, math.tau)) for _ in range(24)]
    places = np.array([[0.2 * math.cos(t), 0.2 * math.sin(t), z] for z, t in rings])
    return _joined([(CARD * 0.2 + place, [(0, 1, 2, 3)]) for place in places])


def gravel() -> Mesh:
    random = _random()
    places = np.concatenate([random.uniform(-1.5, 1.5, (120, 2)), np.zeros((120, 1))], axis=1)
    stone = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.03, 0.03, 0.08]])
    return _joined([(stone + place, [(0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)]) for place in places])


def petals() -> Mesh:
    return _leaf(CARD * 0.4, [(0, 1, 2, 3)], _places(80, 1.7) + 0.05)


def pot() -> Mesh:
    return _tube(0.5, 0.5, 4, 12, (0.0, 0.0, -0.5))


def rock() -> Mesh:
    return _ball(0.3, np.array([1.2, 0.4, 0.15]), 0.5)


def ground() -> Mesh:
    return np.array([[-8.0, -8, 0], [8, -8, 0], [8, 8, 0], [-8, 8, 0]]), [(0, 1, 2, 3)]


def fewer_cards(step: int) -> Mesh:
    """Some of the cards, so much larger that their area stays: a coarser level of another tool."""
    leaves = cards()[0].reshape(-1, 4, 3)[::step]
    middles = leaves.mean(axis=1, keepdims=True)
    return _joined([(leaf, [(0, 1, 2, 3)]) for leaf in middles + math.sqrt(step) * (leaves - middles)])


def _some_cards(start: int, stop: int) -> Mesh:
    """Some of the cards, in parts of ten."""
    leaves = cards()[0].reshape(-1, 4, 3)
    return _joined([(leaf, [(0, 1, 2, 3)]) for i, leaf in enumerate(leaves) if start <= i % 10 < stop])


def far_card() -> Mesh:
    return CARD + np.array([60.0, 0.0, 3.0]), [(0, 1, 2, 3)]


CROWNS: dict[str, Callable[[], Mesh]] = {
    "cards": cards,
    "folded leaves": folded,
    "needles": needles,
    "blobs": blobs,
    "discs": discs,
    "fronds": fronds,
}


def _plant(crown: str, *beside: Part) -> list[Part]:
    return [Part("leaves", CROWNS[crown](), GREEN, True), Part("trunk", trunk(), BROWN, False), *beside]


def _packed(parts: list[Part], packing: str) -> None:
    """Put the parts into objects and materials of the scene."""
    words = {
        "named": {"leaves": "Leaves", "trunk": "Bark"},
        "German": {"leaves": "Blatt_grün", "trunk": "Rinde"},
        "Japanese": {"leaves": "葉", "trunk": "樹皮"},
        "wood named": {"trunk": "Wood"},
    }.get(packing, {})
    if packing == "one material":
        _object("Tree", _joined([part.mesh for part in parts]), [("Atlas", None)], None)
        return
    if packing == "objects":
        for number, part in enumerate(parts):
            _object(f"Object.{number:03}", part.mesh, [], None)
        return
    colors = {part.name: part.color if packing == "colors" else None for part in parts}
    materials = [(words.get(part.name, f"Mat.{i:03}"), colors[part.name]) for i, part in enumerate(parts)]
    indices = [i for i, part in enumerate(parts) for _ in part.mesh[1]]
    _object("Tree", _joined([part.mesh for part in parts]), materials, indices)


def _object(
    name: str, mesh: Mesh, materials: list[tuple[str, tuple[float, float, float] | None]], indices: list[int] | None
) -> None:
    data = bpy.data.meshes.new(name)
    data.from_pydata(mesh[0].tolist(), [], mesh[1])
    for word, color in materials:
        material = bpy.data.materials.new(word)
        if color is not None:
            if material.node_tree is None:  # From Blender 5.0 on every material has nodes.
                material.use_nodes = True
            material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*color, 1.0)
        data.materials.append(material)
    if indices is not None:
        data.polygons.foreach_set("material_index", np.array(indices, np.int32))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, data))


_MARKS = Part("marks", marks(), GREY, False)
_GRAVEL = Part("gravel", gravel(), GREY, False)
_PETALS = Part("petals", petals(), WHITE, True)
_POT = Part("pot", pot(), BROWN, False)
_ROCK = Part("rock", rock(), GREY, False)
_GROUND = Part("ground", ground(), BROWN, False)
_FAR = Part("far", far_card(), GREEN, None)


_LEAVES_APART = [
    Part(f"leaf {i}", (points, [(0, 1, 2, 3)]), GREEN, True) for i, points in enumerate(cards(60)[0].reshape(-1, 4, 3))
]


def _kinds() -> dict[str, tuple[list[Part], str]]:
    packings = ("named", "materials", "one material", "colors", "objects", "wood named")
    found = {f"{crown}, {packing}": (_plant(crown), packing) for crown in CROWNS for packing in packings}
    for packing in ("German", "Japanese"):
        found[f"cards, {packing}"] = (_plant("cards"), packing)
    branched_oak = [Part("leaves", cards(), GREEN, True), Part("trunk", branched(), BROWN, False)]
    apart = [*_LEAVES_APART, Part("trunk", trunk(), BROWN, False)]
    found["each leaf an object"] = (apart, "objects")
    levels = [Part(f"level {step}", fewer_cards(step), GREEN, None) for step in (2, 4)]
    found["levels without names"] = (_plant("cards", *levels), "objects")
    for share in (5, 7):
        halves = [
            Part(f"leaves {i}", _some_cards(*ends), GREEN, True) for i, ends in enumerate(((0, share), (share, 10)))
        ]
        found[f"leaves of two objects, {share} to {10 - share}"] = ([*halves, _plant("cards")[1]], "objects")
    for packing in ("materials", "one material"):
        found[f"cards on branches, {packing}"] = (branched_oak, packing)
        for part in (_MARKS, _GRAVEL, _PETALS, _POT, _ROCK, _GROUND, _FAR):
            found[f"folded leaves and {part.name}, {packing}"] = (_plant("folded leaves", part), packing)
        found[f"blobs and marks, {packing}"] = (_plant("blobs", _MARKS), packing)
        cones_on_a_stick = [Part("leaves", cones(), GREEN, True), Part("trunk", _tube(1.5, 0.2, 1, 6), BROWN, False)]
        found[f"cones, {packing}"] = (cones_on_a_stick, packing)
        ball = [Part("leaves", blobs(1), GREEN, True), Part("trunk", _tube(3.0, 0.15, 1, 6), BROWN, False)]
        found[f"a ball on a stick, {packing}"] = (ball, packing)
        found[f"no leaves, {packing}"] = ([Part("trunk", branched(), BROWN, False)], packing)
        found[f"a bush, {packing}"] = ([Part("leaves", cards(), GREEN, True)], packing)
        found[f"grass, {packing}"] = ([Part("leaves", grass(), GREEN, True)], packing)
    return found


KINDS = _kinds()


@cache
def found_in(kind: str) -> Found:
    """Build a plant in an empty scene, and find its leaves."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    parts, packing = KINDS[kind]
    _packed(parts, packing)
    try:
        tree = extract(bpy.context.evaluated_depsgraph_get(), None)
    except SceneError:
        return Found(0.0, 0.0, is_told=True)
    places, labels = _truth(parts)
    areas = {True: 0.0, False: 0.0, None: 0.0}
    for place, area in _triangles(*_of_geometry(tree.leaves, tree.matrix)):
        areas[labels[int(np.linalg.norm(places - place, axis=1).argmin())]] += area
    whole = max(sum(area for part in parts if part.is_leaf for _, area in _triangles(*part.mesh)), 1e-9)
    return Found(areas[True] / whole, (areas[False] + areas[None]) / whole, any("may be" in w for w in tree.warnings))


def _of_geometry(geometry: Geometry, matrix: NDArray[np.float64]) -> Mesh:
    return world_positions(geometry, matrix), [tuple(triangle) for triangle in geometry.triangles.tolist()]


def _truth(parts: list[Part]) -> tuple[NDArray[np.float64], list[bool | None]]:
    """Return the places of all triangles, and whether each is of leaves. Blender splits a quad at either diagonal."""
    labels, places = [], []
    for part in parts:
        for faces in (part.mesh[1], [(*face[1:], face[0]) for face in part.mesh[1]]):
            own = [place for place, _ in _triangles(part.mesh[0], faces)]
            places += own
            labels += [part.is_leaf] * len(own)
    return np.array(places), labels


def _triangles(
    points: NDArray[np.float64], faces: Sequence[tuple[int, ...]]
) -> list[tuple[NDArray[np.float64], float]]:
    """Return each triangle's middle and its area."""
    result = []
    for face in faces:
        for first, second, third in ((0, 1, 2), (0, 2, 3)) if len(face) == 4 else ((0, 1, 2),):
            a, b, c = (points[face[i]] for i in (first, second, third))
            result.append(((a + b + c) / 3.0, float(np.linalg.norm(np.cross(b - a, c - a))) / 2.0))
    return result
