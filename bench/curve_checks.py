"""Checks of the guarantees of cost curves. Prints the results.

usage: make bench-curve-checks ARGS='errors [COUNT]'     count the bakes that meet a requested error: COUNT bakes (100)
                                                         of varied crowns and settings
       make bench-curve-checks ARGS='budget [TREE.glb]'  compare requested with actual seconds
       make bench-curve-checks ARGS='front [TREE.glb]'   count the steps to more time with a worse result: 20 seeds

To compare predicted with measured seconds: `cargo run --release -p leafcloud-curve --example predicted TREE.glb …`.
"""

from __future__ import annotations

import itertools
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import leafcloud

FOLIAGE = Path(__file__).resolve().parents[1].parent / "shared" / "foliage"
SEEDS = 20


def trees(named: list[str]) -> list[Path]:
    return [Path(name) for name in named] or sorted(FOLIAGE.glob("*.glb"))


def crown(seed: int) -> leafcloud.Foliage:
    """Build a ball of 100 to 900 random cards of three sizes: mostly upright, mostly flat, or in any direction."""
    random = np.random.default_rng(seed)
    count = int(random.integers(100, 900))
    places = random.normal(size=(count, 3))
    places *= (random.uniform(size=(count, 1)) ** (1 / 3)) / np.linalg.norm(places, axis=1, keepdims=True)
    normals = random.normal(size=(count, 3)) * random.choice(
        np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 0.2], [0.2, 0.2, 1.0]])
    )
    right = np.cross(normals, [0.3, 0.5, 0.8])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    up = np.cross(normals, right)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    size = random.choice([0.05, 0.08, 0.12], size=(count, 1))
    corners = np.stack([places - size * right, places - size * up, places + size * right, places + size * up], axis=1)
    first = 4 * np.arange(count)[:, None, None]
    colors = np.repeat(random.uniform(0.1, 0.9, size=(count, 1, 4)), 4, axis=1)
    colors[..., 3] = 1.0
    return leafcloud.Foliage(
        corners.reshape(-1, 3),
        (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3),
        colors=colors.reshape(-1, 4),
    )


def errors(arguments: list[str]) -> None:
    count = int(arguments[0]) if arguments else 100
    met, refused, worst = 0, 0, 0.0
    for seed in range(count):
        random = np.random.default_rng(1000 + seed)
        foliage = crown(seed)
        settings: dict[str, Any] = {
            "levels": 1,
            "cross": False,
            "texture_size": int(random.choice([256, 512])),
            "seed": seed,
        }
        # An error between those of a coarse and a fine cloud is reachable.
        ends = [leafcloud.build_chain(foliage, epsilon=e, **settings).levels[0].image_error for e in (0.16, 0.02)]
        asked = min(ends) * (max(ends) / min(ends)) ** random.uniform(0.1, 1.0)
        try:
            reached = leafcloud.build_chain(foliage, image_error=asked, **settings).levels[0].image_error
        except leafcloud.LeafcloudError as error:
            refused += 1
            print(f"{seed}: {asked:.3f} refused: {error}", flush=True)
            continue
        met += reached <= asked
        worst = max(worst, reached / asked - 1.0)
        print(f"{seed}: requested {asked:.3f}, reached {reached:.3f}", flush=True)
    print(f"\n{met} of {count} met, {refused} refused, largest excess {100 * max(worst, 0.0):.0f} %")


def budget(arguments: list[str]) -> None:
    for tree in trees(arguments)[:1]:
        foliage = leafcloud.read_gltf(str(tree))
        begun = time.perf_counter()
        leafcloud.cost_curve(foliage, quick=True)
        quick = time.perf_counter() - begun
        for times in (3.0, 6.0, 12.0):
            begun = time.perf_counter()
            chain = leafcloud.build_chain(foliage, seconds=times * quick)
            took = time.perf_counter() - begun
            print(
                f"{tree.stem}: wanted {times * quick:.1f} s, took {took:.1f} s, error {chain.levels[0].image_error:.3f}"
            )


def front(arguments: list[str]) -> None:
    for tree in trees(arguments)[:1]:
        foliage = leafcloud.read_gltf(str(tree))
        small: dict[str, Any] = {"levels": 1, "cross": False, "texture_size": 1024}
        offers = leafcloud.cost_curve(foliage, quick=True, **small).offers
        found: list[tuple[float, float]] = []
        for offer in offers[:: max(1, len(offers) // 5)]:
            asked: dict[str, Any] = {**offer["settings"]}
            built = [leafcloud.build_chain(foliage, seed=seed, **asked) for seed in range(SEEDS)]
            reached = [chain.levels[0].image_error for chain in built]
            noise = statistics.stdev(reached) / SEEDS**0.5
            found.append((statistics.mean(reached), noise))
            taken = statistics.median(chain.seconds for chain in built)
            print(f"{tree.stem}: {taken:.2f} s, error {found[-1][0]:.4f} ± {noise:.4f}", flush=True)
        worse = sum(b - a > 2.0 * (u**2 + v**2) ** 0.5 for (a, u), (b, v) in itertools.pairwise(found))
        print(f"\n{worse} of {len(found) - 1} steps give a worse result beyond noise")


CHECKS: dict[str, Callable[[list[str]], None]] = {
    "errors": errors,
    "budget": budget,
    "front": front,
}


def main() -> None:
    if len(sys.argv) < 2 or sys.argv[1] not in CHECKS:
        raise SystemExit(f"{__doc__}")
    CHECKS[sys.argv[1]](sys.argv[2:])


if __name__ == "__main__":
    main()
