"""Compares estimated with actual costs of effects: `make bench-plan`.

usage: python bench/plan.py [--runs N] [--texture-size N] [TREE.glb …]

The default trees are all of ../shared/foliage except the one of a million triangles. Each is baked with all effects
on and the chain `both`, with baked light, and with `blend_order`. Seconds are the minimum over the runs, because
other load on the machine only adds time. Prints a table in Markdown: for each effect and tree the measured and the
estimated cost, the largest factor between the two, and the factor on the rate in `addon/effects/` that minimizes
it. For all trees it also writes docs/bench/plan.md.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from addon.settings.effects import EFFECTS  # noqa: E402

FOLIAGE = ROOT.parent / "shared" / "foliage"
LEFT_OUT = {"maple_1m"}
BAKES = (
    ("--effects", "all", "--chain", "both"),
    ("--effects", "baked_light", "--no-cross", "--levels", "1"),
    ("--effects", "blend_order"),
)
LEAST = {"seconds": 0.05, "bytes": 1000}
"""Smaller costs are not compared, because they are below the clock's precision."""

Costs = dict[tuple[str, str], tuple[float, float]]
"""(measured, estimated) by effect and unit, "seconds" or "bytes"."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trees", nargs="*", type=Path)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--texture-size", type=int, default=2048)
    options = parser.parse_args()
    trees = options.trees or [tree for tree in sorted(FOLIAGE.glob("*.glb")) if tree.stem not in LEFT_OUT]
    costs = {tree.stem: measured(tree, options.runs, options.texture_size) for tree in trees}
    text = "\n".join(table(costs))
    print(text)
    if not options.trees:
        (ROOT / "docs" / "bench" / "plan.md").write_text(text + "\n", encoding="utf-8")


def measured(tree: Path, runs: int, texture_size: int) -> Costs:
    """Return the costs of the effects, each from the first bake with it on; seconds are the minimum over the runs."""
    costs: Costs = {}
    for flags in BAKES:
        here: Costs = {}
        for _ in range(runs):
            for effect in bake(tree, *flags, "--texture-size", str(texture_size))["effects"]:
                if not effect["on"] or effect["name"] not in EFFECTS:
                    continue
                for what in LEAST:
                    key = (effect["name"], what)
                    before = here.get(key, (math.inf, 0.0))[0]
                    here[key] = (min(before, effect[what]), effect["estimate"][what])
        costs = {**here, **costs}
        print(f"{tree.stem} {' '.join(flags)}", file=sys.stderr, flush=True)
    return costs


def bake(tree: Path, *flags: str) -> dict[str, Any]:
    """Bake in a separate process and return the report."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(ROOT / "bake.py"), "--input", str(tree), "--out", folder, *flags]
        subprocess.run(command, check=True, capture_output=True)
        return json.loads((Path(folder) / "report.json").read_text(encoding="utf-8"))


def table(costs: dict[str, Costs]) -> Iterator[str]:
    header = ["effect", "of", *costs, "greatest factor", "rate ×"]
    yield "Measured / estimated."
    yield ""
    yield "| " + " | ".join(header) + " |"
    yield "|" + "---|" * len(header)
    for effect in EFFECTS:
        for what, least in LEAST.items():
            pairs = [of_tree.get((effect, what), (0.0, 0.0)) for of_tree in costs.values()]
            ratios = [real / told for real, told in pairs if max(real, told) >= least and real > 0.0 and told > 0.0]
            if ratios:
                cells = [cell(real, told, what) for real, told in pairs]
                yield "| " + " | ".join([effect, what, *cells, *summary(ratios)]) + " |"


def cell(real: float, told: float, what: str) -> str:
    if max(real, told) < LEAST[what]:
        return "–"
    return f"{real:.2f} / {told:.2f} s" if what == "seconds" else f"{real / 1e6:.2f} / {told / 1e6:.2f} MB"


def summary(ratios: Sequence[float]) -> tuple[str, str]:
    """Return the largest factor between measured and estimated, and the factor on the rate that minimizes it."""
    worst = max(max(ratio, 1.0 / ratio) for ratio in ratios)
    return f"{worst:.2f}", f"{math.sqrt(min(ratios) * max(ratios)):.3f}"


if __name__ == "__main__":
    main()
