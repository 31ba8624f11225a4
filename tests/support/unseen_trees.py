"""Makes two trees that no setting was chosen by: `python tests/support/unseen_trees.py OUT`.

Each is one file, OUT/NAME.glb, with the objects `leaves` and `stem`. They grow from branches of branches, unlike the
plants of `plants.py` and the measured trees. The same seed gives the same tree. The trees are the project's own, under
its license.

- `birch`: a tall crown of drooping twigs with cut-out leaves on cards.
- `walnut`: a broad crown of compound leaves, with modelled leaflets of one color.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from plants import (
    UP,
    Plant,
    Vectors,
    add_blade,
    add_card,
    add_tube,
    arch,
    direction,
    random_of,
    save,
    unit,
)

SEED = 20_261
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
"""Angle between one branch and the next around their stem."""


def add_branch(plant: Plant, points: Vectors, radius: float) -> Vectors:
    """Add a branch that gets thinner along `points`; return the points."""
    add_tube(plant.stem, points, np.linspace(radius, 0.25 * radius, len(points)), 5)
    return points


def along(points: Vectors, t: float) -> Vectors:
    """Return the place at the fraction t of a branch."""
    return np.array([np.interp(t * (len(points) - 1), np.arange(len(points)), axis) for axis in points.T])


def birch(random: np.random.Generator) -> Plant:
    """A tree of 12 m with 60 branches, 420 drooping twigs and 6,720 cards."""
    plant = Plant((0.38, 0.5, 0.16), cards=True)
    t = np.linspace(0.0, 1.0, 14)
    trunk = np.column_stack([0.25 * np.sin(3.0 * t), 0.2 * t**2, 12.0 * t])
    add_branch(plant, trunk, 0.16)
    for i in range(60):
        height = 0.2 + 0.76 * (i + random.uniform()) / 60
        length = 2.9 * math.sqrt(math.sin(math.pi * (0.12 + 0.86 * (height - 0.2) / 0.8))) * random.uniform(0.75, 1.1)
        rise = random.uniform(0.5, 1.0)
        bough = add_branch(plant, arch(along(trunk, height), GOLDEN * i, rise, length, 0.35, 9), 0.04)
        for j in range(7):
            base = along(bough, (j + 1.5 + random.uniform(-0.4, 0.4)) / 8.5)
            around = GOLDEN * i + random.uniform(-1.4, 1.4)
            twig = add_branch(
                plant, arch(base, around, random.uniform(-0.3, 0.4), random.uniform(0.6, 1.2), 0.9, 7), 0.01
            )
            for k in range(16):
                hanging = np.array([0.0, 0.0, -1.0]) + 0.7 * random.normal(size=3)
                place = along(twig, (k + random.uniform()) / 16.0)
                add_card(plant.leaves, place, hanging, direction(random), random.uniform(0.12, 0.19), 0.12)
    return plant


def add_compound_leaf(plant: Plant, base: Vectors, angle: float, rise: float, random: np.random.Generator) -> None:
    """Add a stalk with three pairs of leaflets and one at its tip."""
    stalk = arch(base, angle, rise, random.uniform(0.28, 0.4), 0.25, 5)
    forward = unit(stalk[-1] - stalk[0])
    side = unit(np.cross(forward, UP + 0.3 * random.normal(size=3)))
    normal = np.cross(side, forward)
    for pair in range(3):
        for sign in (-1.0, 1.0):
            place, size = along(stalk, 0.35 + 0.27 * pair), 0.13 + 0.03 * pair
            add_blade(plant.leaves, place, sign * side + 0.4 * forward, normal, size, 0.42 * size, 0.15)
    add_blade(plant.leaves, stalk[-1], forward, normal, 0.2, 0.085, 0.2)


def walnut(random: np.random.Generator) -> Plant:
    """A tree of 8 m with 9 limbs, 45 branches, 360 twigs and 7,560 leaflets."""
    plant = Plant((0.2, 0.4, 0.12), cards=False)
    trunk = arch(np.zeros(3), 0.4, 1.5, 2.6, 0.0, 6)
    add_branch(plant, trunk, 0.3)
    for i in range(9):
        start = along(trunk, 0.7 + 0.3 * i / 8.0)
        limb = add_branch(plant, arch(start, GOLDEN * i, 0.35 + 0.12 * i, random.uniform(3.4, 4.4), 0.05, 10), 0.14)
        for j in range(5):
            base, around = along(limb, 0.3 + 0.16 * j), GOLDEN * i + (-1.0) ** j * random.uniform(0.5, 1.2)
            branch = add_branch(
                plant, arch(base, around, random.uniform(0.2, 1.0), random.uniform(1.1, 1.9), 0.1, 7), 0.05
            )
            for k in range(8):
                place, angle = along(branch, (k + 1.0) / 8.0), around + GOLDEN * k
                twig = add_branch(plant, arch(place, angle, random.uniform(-0.2, 0.9), 0.35, 0.1, 4), 0.015)
                for leaf in range(3):
                    outward = angle + 2.1 * leaf + random.uniform(-0.4, 0.4)
                    add_compound_leaf(plant, along(twig, 0.5 + 0.25 * leaf), outward, random.uniform(-0.4, 0.5), random)
    return plant


TREES: dict[str, Callable[[np.random.Generator], Plant]] = {"birch": birch, "walnut": walnut}


def write(name: str, folder: Path) -> Path:
    """Write the tree with this name into a folder; the open scene is lost. Return the file."""
    return save(TREES[name](random_of(name, SEED)), name, folder)


def main() -> None:
    parser = argparse.ArgumentParser(description="Make two trees that no setting was chosen by.")
    parser.add_argument("folder", type=Path, metavar="OUT")
    for name in TREES:
        print(write(name, parser.parse_args().folder))


if __name__ == "__main__":
    main()
