"""Makes plants of many shapes from nothing but numbers: `python tests/support/plants.py OUT [NAME …]`.

The measured trees are trees. Artists also bake ferns, palms, grass, ivy, hedges, flowers, single branches, leaves on
the ground, a pot plant of 20 cm and a redwood of 60 m. Each plant is one file, OUT/NAME.glb, with an object `leaves`
and, if it has one, an object `stem`. Leaves are cards with a cut-out leaf, or modelled blades of one color. The same
name and seed give the same plant. The plants are the project's own, under its licence.
"""

from __future__ import annotations

import argparse
import math
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

Vectors = NDArray[np.float64]
UP = np.array([0.0, 0.0, 1.0])
TEXTURE = 128
"""Side of a leaf's texture in texels."""


@dataclass
class Surface:
    """Triangles and quads that grow, with texture coordinates."""

    positions: list[Vectors] = field(default_factory=list)
    uvs: list[Vectors] = field(default_factory=list)
    faces: list[tuple[int, ...]] = field(default_factory=list)

    def add(self, positions: Vectors, uvs: Vectors, faces: Iterable[Sequence[int]]) -> None:
        """Add vertices (n, 3) with coordinates (n, 2), and faces that count from the first of them."""
        start = sum(map(len, self.positions))
        self.positions.append(positions)
        self.uvs.append(uvs)
        self.faces += [tuple(start + corner for corner in face) for face in faces]


@dataclass
class Plant:
    """Leaves and stem. color: of the leaves, sRGB. cards: whether the leaves are cut out of a texture.

    upward: whether the leaves' normals point upward, as artists bend them for soft light.
    """

    color: tuple[float, float, float]
    cards: bool
    upward: bool = False
    leaves: Surface = field(default_factory=Surface)
    stem: Surface = field(default_factory=Surface)


def unit(vector: ArrayLike) -> Vectors:
    return np.asarray(np.asarray(vector) / np.linalg.norm(vector))


def add_card(surface: Surface, base: Vectors, along: ArrayLike, normal: ArrayLike, length: float, width: float) -> None:
    """Add a rectangle that starts at `base`. `along` and `normal` need not be perpendicular."""
    along = unit(along)
    side = unit(np.cross(along, np.asarray(normal, np.float64))) * width / 2.0
    tip = base + along * length
    uvs = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    surface.add(np.array([base - side, base + side, tip + side, tip - side]), uvs, [(0, 1, 2, 3)])


def add_blade(
    surface: Surface,
    base: Vectors,
    along: ArrayLike,
    normal: ArrayLike,
    length: float,
    width: float,
    droop: float = 0.0,
    segments: int = 2,
) -> None:
    """Add a pointed strip, widest before its middle. `droop`: how far its tip hangs, as a share of its length."""
    along = unit(along)
    side = unit(np.cross(along, np.asarray(normal, np.float64)))
    t = np.linspace(0.0, 1.0, segments + 1)[:-1]
    middles = base + np.outer(t, along) * length - np.outer(t**2, UP) * droop * length
    halves = np.outer(width / 2.0 * np.maximum(np.sin(math.pi * t**0.7), 0.15), side)
    rows = np.stack([middles - halves, middles + halves], axis=1).reshape(-1, 3)
    tip = base + along * length - UP * droop * length
    quads = [(2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2) for i in range(segments - 1)]
    last = 2 * (segments - 1)
    uvs = np.column_stack([np.tile([0.0, 1.0], segments), np.repeat(t, 2)])
    surface.add(np.vstack([rows, tip]), np.vstack([uvs, [0.5, 1.0]]), [*quads, (last, last + 1, last + 2)])


def add_tube(surface: Surface, points: Vectors, radii: ArrayLike, sides: int = 6) -> None:
    """Add a tube along `points` (n, 3), without ends."""
    directions = np.gradient(points, axis=0)
    angles = 2.0 * math.pi * np.arange(sides) / sides
    rings = []
    for point, direction, radius in zip(points, directions, np.asarray(radii), strict=True):
        across = unit(np.cross(direction, [0.3, 0.9, 0.1]))
        other = unit(np.cross(direction, across))
        rings.append(point + radius * (np.outer(np.cos(angles), across) + np.outer(np.sin(angles), other)))
    faces = [
        (ring * sides + i, ring * sides + (i + 1) % sides, (ring + 1) * sides + (i + 1) % sides, (ring + 1) * sides + i)
        for ring in range(len(points) - 1)
        for i in range(sides)
    ]
    uvs = np.column_stack([np.tile(np.arange(sides) / sides, len(points)), np.repeat(np.arange(len(points)), sides)])
    surface.add(np.vstack(rings), uvs, faces)


def direction(random: np.random.Generator) -> Vectors:
    """Return a random unit vector."""
    return unit(random.normal(size=3))


def turned(angle: float, rise: float) -> Vectors:
    """Return the unit vector at an angle around the vertical and an angle above the ground, in radians."""
    return np.array([math.cos(angle) * math.cos(rise), math.sin(angle) * math.cos(rise), math.sin(rise)])


def arch(base: Vectors, angle: float, rise: float, length: float, droop: float, count: int) -> Vectors:
    """Return points (count, 3) of a stem that leaves the ground at `rise` and hangs by `droop` of its length."""
    t = np.linspace(0.0, 1.0, count)
    return np.asarray(base + np.outer(t, turned(angle, rise)) * length - np.outer(t**2, UP) * droop * length)


def add_frond(plant: Plant, points: Vectors, pairs: int, leaflet: float, width: float, droop: float) -> None:
    """Add pairs of leaflets along a stem, longest a third of the way."""
    add_tube(plant.stem, points, np.linspace(0.02, 0.004, len(points)) * leaflet, 4)
    along = np.gradient(points, axis=0)
    for t in np.linspace(0.1, 1.0, pairs):
        place = t * (len(points) - 1)
        index = min(int(place), len(points) - 2)
        base = points[index] + (points[index + 1] - points[index]) * (place - index)
        forward = unit(along[index])
        side = unit(np.cross(forward, UP))
        long = leaflet * max(math.sin(math.pi * (0.2 + 0.8 * t)), 0.1)
        for sign in (-1.0, 1.0):
            add_blade(plant.leaves, base, sign * side + 0.5 * forward, UP, long, width * long, droop)


def fern(random: np.random.Generator) -> Plant:
    """Arching fronds of broad, modelled leaflets; 0.9 m."""
    plant = Plant((0.24, 0.45, 0.14), cards=False)
    for i in range(26):
        points = arch(np.zeros(3), 2.4 * i, random.uniform(0.6, 1.2), random.uniform(0.6, 0.9), 0.5, 12)
        add_frond(plant, points, 40, 0.16, 0.25, 0.1)
    return plant


def palm(random: np.random.Generator) -> Plant:
    """A trunk of 6 m and fronds of long, narrow leaflets that hang."""
    plant = Plant((0.3, 0.45, 0.18), cards=False)
    t = np.linspace(0.0, 1.0, 10)
    trunk = np.column_stack([0.4 * t**2, 0.2 * t, 6.0 * t])
    add_tube(plant.stem, trunk, np.linspace(0.22, 0.14, 10), 10)
    for i in range(28):
        points = arch(trunk[-1], 2.4 * i, random.uniform(-0.2, 1.2), random.uniform(2.2, 2.8), 0.45, 14)
        add_frond(plant, points, 60, 0.7, 0.06, 0.35)
    return plant


def grass(random: np.random.Generator) -> Plant:
    """A tuft of modelled blades; 0.4 m, without a stem."""
    plant = Plant((0.35, 0.5, 0.15), cards=False)
    for _ in range(500):
        angle, rise = random.uniform(0.0, 2.0 * math.pi), random.uniform(0.9, 1.5)
        base = 0.06 * random.uniform() * turned(angle, 0.0)
        normal = turned(angle, rise - math.pi / 2.0)
        length = random.uniform(0.2, 0.45)
        add_blade(plant.leaves, base, turned(angle, rise), normal, length, 0.008, random.uniform(0.1, 0.5), 5)
    return plant


def ivy(random: np.random.Generator) -> Plant:
    """Cards on a wall of 4 × 3 m, all on one side; without a stem."""
    plant = Plant((0.16, 0.32, 0.13), cards=True)
    for x, z in random.uniform(size=(3000, 2)) * [4.0, 3.0]:
        if z < 1.8 + math.sin(2.1 * x) + random.uniform(-0.3, 0.3):
            normal = np.array([0.0, -1.0, 0.0]) + 0.35 * random.normal(size=3)
            base = np.array([x, -0.12 * random.uniform(), z])
            add_card(plant.leaves, base, [random.normal(), 0.0, -1.0], normal, 0.14, 0.14)
    return plant


def hedge(random: np.random.Generator) -> Plant:
    """A box of 3 × 0.8 × 1.4 m, full of cards; without a stem."""
    plant = Plant((0.17, 0.35, 0.12), cards=True)
    for place in random.uniform(size=(9000, 3)) * [3.0, 0.8, 1.4]:
        add_card(plant.leaves, place, direction(random), direction(random), 0.09, 0.05)
    return plant


def flowers(random: np.random.Generator) -> Plant:
    """Stems of half a meter, each with a blossom of modelled petals and a few leaves."""
    plant = Plant((0.85, 0.3, 0.45), cards=False)
    for _ in range(70):
        foot = np.append(random.normal(size=2) * 0.15, 0.0)
        points = arch(foot, random.uniform(0.0, 6.3), random.uniform(1.2, 1.5), random.uniform(0.35, 0.6), 0.05, 6)
        add_tube(plant.stem, points, [0.003] * 6, 4)
        for i in range(8):
            add_blade(plant.leaves, points[-1], turned(0.785 * i, 0.4), UP, 0.04, 0.02, 0.0, 3)
        for height in (1, 2, 3):
            outward = turned(random.uniform(0.0, 6.3), 0.5)
            add_blade(plant.leaves, points[height], outward, UP, 0.1, 0.03, 0.3, 4)
    return plant


def bush(random: np.random.Generator) -> Plant:
    """A ball of cards, denser outside; 1.6 m, without a stem."""
    plant = Plant((0.25, 0.42, 0.16), cards=True)
    for _ in range(2500):
        outward = direction(random)
        place = outward * 0.8 * random.uniform() ** 0.25 + 0.8 * UP
        add_card(plant.leaves, place, outward + 0.6 * random.normal(size=3), direction(random), 0.12, 0.07)
    return plant


def branch(random: np.random.Generator) -> Plant:
    """A single branch of 1.2 m with 220 cards."""
    plant = Plant((0.3, 0.48, 0.2), cards=True)
    points = arch(np.zeros(3), 0.0, 0.3, 1.2, 0.25, 12)
    add_tube(plant.stem, points, np.linspace(0.012, 0.003, 12), 6)
    for _ in range(220):
        base = points[random.integers(2, 12)] + 0.04 * random.normal(size=3)
        add_card(plant.leaves, base, [0.6, *random.normal(size=2)], [0.0, 0.0, 1.0], 0.1, 0.06)
    return plant


def litter(random: np.random.Generator) -> Plant:
    """Dead leaves on the ground: cards that lie in a layer of 3 cm, 4 m wide."""
    plant = Plant((0.45, 0.28, 0.12), cards=True)
    for x, y in random.normal(size=(2500, 2)):
        base = np.array([x, y, 0.03 * random.uniform()])
        add_card(
            plant.leaves, base, np.append(random.normal(size=2), 0.0), UP + 0.2 * random.normal(size=3), 0.12, 0.09
        )
    return plant


def pot(random: np.random.Generator) -> Plant:
    """A plant of 20 cm with broad, curved, modelled leaves in a pot."""
    plant = Plant((0.2, 0.42, 0.2), cards=False)
    add_tube(plant.stem, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.03], [0.0, 0.0, 0.06]]), [0.03, 0.035, 0.04], 16)
    for i in range(40):
        angle, rise = 2.4 * i, random.uniform(0.3, 1.4)
        base = np.array([0.0, 0.0, 0.05])
        normal = turned(angle, rise - math.pi / 2.0)
        add_blade(plant.leaves, base, turned(angle, rise), -normal, random.uniform(0.1, 0.16), 0.05, 0.35, 8)
    return plant


def redwood(random: np.random.Generator) -> Plant:
    """A trunk of 60 m with sprays of needles on cards."""
    plant = Plant((0.18, 0.3, 0.16), cards=True)
    add_tube(
        plant.stem, np.column_stack([np.zeros((2, 12)).T, np.linspace(0.0, 60.0, 12)]), np.linspace(2.4, 0.1, 12), 12
    )
    for _ in range(420):
        height = random.uniform(14.0, 59.0)
        reach = 0.5 + 0.16 * (60.0 - height)
        points = arch(np.array([0.0, 0.0, height]), random.uniform(0.0, 6.3), 0.1, reach, 0.3, 6)
        add_tube(plant.stem, points, np.linspace(0.12, 0.03, 6), 4)
        for _ in range(24):
            base = points[random.integers(2, 6)] + 0.3 * random.normal(size=3)
            add_card(
                plant.leaves, base, points[-1] - points[0] + 2.0 * random.normal(size=3), direction(random), 1.3, 0.5
            )
    return plant


def hosta(random: np.random.Generator) -> Plant:
    """Broad, modelled leaves on the ground, in centimeters: 60 units wide."""
    plant = Plant((0.35, 0.5, 0.3), cards=False)
    for i in range(60):
        angle, rise = 2.4 * i, random.uniform(0.2, 1.1)
        normal = turned(angle, rise + math.pi / 2.0)
        add_blade(plant.leaves, np.zeros(3), turned(angle, rise), normal, random.uniform(18.0, 34.0), 14.0, 0.45, 8)
    return plant


PLANTS: dict[str, Callable[[np.random.Generator], Plant]] = {
    make.__name__: make for make in (fern, palm, grass, ivy, hedge, flowers, bush, branch, litter, pot, redwood, hosta)
}


def leaf_texture(color: Sequence[float]) -> NDArray[np.float32]:
    """Return a pointed leaf with a light midrib, RGBA (side, side, 4), transparent around it."""
    v, u = (np.mgrid[0:TEXTURE, 0:TEXTURE] + 0.5) / TEXTURE
    across = np.abs(u - 0.5)
    half = 0.46 * np.sin(math.pi * np.clip(v, 0.0, 1.0) ** 0.8)
    veins = 0.06 * np.cos(40.0 * (v - 0.8 * across))
    shade = 0.9 + veins + 0.35 * (across < 0.015)
    return np.dstack([*(np.clip(shade * part, 0.0, 1.0) for part in color), across < half]).astype(np.float32)


def material(name: str, color: Sequence[float], *, cut_out: bool) -> bpy.types.Material:
    """Return a Principled material of one color, or with a leaf that Math's Round cuts out."""
    made = bpy.data.materials.new(name)
    if made.node_tree is None:
        made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.8
    linear = [part**2.2 for part in color]
    shader.inputs["Base Color"].default_value = (*linear, 1.0)
    if cut_out:
        image = bpy.data.images.new(name, TEXTURE, TEXTURE, alpha=True)
        image.pixels.foreach_set(leaf_texture(color).ravel())
        image.pack()
        texture, cut = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeMath")
        texture.image, cut.operation = image, "ROUND"
        links.new(texture.outputs["Color"], shader.inputs["Base Color"])
        links.new(texture.outputs["Alpha"], cut.inputs[0])
        links.new(cut.outputs[0], shader.inputs["Alpha"])
    return made


def add_object(name: str, surface: Surface, made: bpy.types.Material, *, upward: bool = False) -> None:
    """Add a surface to the open scene. upward: all its normals point upward."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.vstack(surface.positions).tolist(), [], surface.faces)
    corners = np.array([corner for face in surface.faces for corner in face])
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", np.vstack(surface.uvs)[corners].astype(np.float32).ravel())
    mesh.materials.append(made)
    if upward:
        mesh.normals_split_custom_set_from_vertices([UP.tolist()] * len(mesh.vertices))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def write(name: str, folder: Path, seed: int = 1) -> Path:
    """Write the plant with this name into a folder; the open scene is lost. Return the file."""
    return save(PLANTS[name](random_of(name, seed)), name, folder)


def random_of(name: str, seed: int) -> np.random.Generator:
    """Return the random numbers of the plant with this name."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def save(plant: Plant, name: str, folder: Path) -> Path:
    """Write a plant into a file with this name in a folder; the open scene is lost. Return the file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    add_object("leaves", plant.leaves, material("leaf", plant.color, cut_out=plant.cards), upward=plant.upward)
    if plant.stem.faces:
        add_object("stem", plant.stem, material("bark", (0.35, 0.25, 0.18), cut_out=False))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.glb"
    bpy.ops.export_scene.gltf(filepath=str(path))
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description="Make plants of many shapes.")
    parser.add_argument("folder", type=Path, metavar="OUT")
    parser.add_argument("names", nargs="*", choices=[[], *PLANTS], metavar="NAME", help=", ".join(PLANTS))
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for name in options.names or PLANTS:
        print(write(name, options.folder, options.seed))


if __name__ == "__main__":
    main()
