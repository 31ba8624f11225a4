"""Puts faults into the sources, one after the other, and tells whether the tests find them: `make mutants`.

    python tools/mutants.py [NAME …]

A fault replaces one text in one file. The tests run until the first failure; then the file is as before. Needs a
working tree without changes. Faults in Rust compile the core again: two hours for all.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]


class Fault(NamedTuple):
    """A text of a file and what replaces it."""

    file: str
    text: str
    fault: str


FAULTS = {
    "the transition runs backward in Blender": Fault(
        "addon/nodes/laws.py",
        'section.math("SUBTRACT", distance, start), span, label="By camera"',
        'section.math("SUBTRACT", start, distance), span, label="By camera"',
    ),
    "the transition runs backward in engines": Fault(
        "shaders/leafcloud.glsl", "clamp((distance - start) /", "clamp((start - distance) /"
    ),
    "pruning keeps too many leaves": Fault(
        "shaders/leafcloud.glsl", "exp2(-log2(nearness) / log2(half_at))", "exp2(-log2(nearness) / log2(0.5))"
    ),
    "fades overlap in no pixel": Fault("shaders/leafcloud.glsl", "0.00583715)))) < share", "0.00583715)))) > share"),
    "a share is taken for a cutoff": Fault("shaders/shares.glsl", "pivot * alpha / cutoff", "alpha"),
    "the shape key holds no morph": Fault(
        "addon/levels/morphs.py", "transition.target.ravel()", "(0.0 * transition.target).ravel()"
    ),
    "vertex groups are those of the next billboard": Fault(
        "addon/levels/morphs.py", "add(members.tolist(), 1.0", "add((members - 1).tolist(), 1.0"
    ),
    "files lose the pivots of billboards": Fault(
        "addon/export/vertex_data.py",
        '("leaf_pivot", "leaf_pivot_target", "leaf_billboard_pivot")',
        '("leaf_pivot", "leaf_pivot_target")',
    ),
    "levels take over twice as far away": Fault(
        "addon/plan/schedule.py",
        "return rising([0.0, *distances])",
        "return rising([0.0, *(2 * d for d in distances)])",
    ),
    "pages are cut out elsewhere": Fault(
        "addon/levels/material.py",
        "opacity = shown_share(tree, texture, alpha_cutoff)",
        "opacity = shown_share(tree, texture, 0.9 * alpha_cutoff)",
    ),
    "roughness is metallic": Fault(
        "addon/material/describe.py",
        '"roughness": shading.roughness, "metallic": shading.metallic',
        '"roughness": shading.metallic, "metallic": shading.roughness',
    ),
    "a trunk's triangles get the materials of others": Fault(
        "addon/levels/trunk.py",
        "material_ids=geometry.material_ids[of_triangle]",
        "material_ids=geometry.material_ids[of_triangle[::-1]]",
    ),
    "light of the front on the back": Fault(
        "addon/scene/light.py", "Light(wound(front, matrix), wound(back", "Light(wound(back, matrix), wound(front"
    ),
    "a refused bake ends as if it were done": Fault(
        "bake.py",
        "            console.refuse(str(error))\n            return 1",
        "            console.refuse(str(error))\n            return 0",
    ),
    "three.js fades at the end of the morph": Fault(
        "engines/three/src/levels.js",
        "HAND_OVER * (source.end - source.start) : switchDistance",
        "(source.end - source.start) : switchDistance",
    ),
    "Babylon.js knows no end of a morph": Fault(
        "engines/babylon/src/levels.js", "...(morphs ? { start, end }", "...(morphs ? { start, end: start }"
    ),
    "the fit allows a tenth more": Fault(
        "rust/core/src/fit/mod.rs",
        "settings, settings.epsilon * foliage.frame().radius, progress, None)",
        "settings, 1.1 * settings.epsilon * foliage.frame().radius, progress, None)",
    ),
    "the inner leaves are drawn first": Fault(
        "rust/core/src/prune/order.rs", "b.0.total_cmp(&a.0)", "a.0.total_cmp(&b.0)"
    ),
    "mirrored trees are inside out": Fault(
        "rust/core/src/geometry/placement.rs", "if self.mirrors() { [a, c, b] }", "if !self.mirrors() { [a, c, b] }"
    ),
    "octahedral views look the other way": Fault(
        "rust/core/src/lod/octahedral/mapping.rs",
        "0.5 * (p.x + p.y), 0.5 * (p.x - p.y)",
        "0.5 * (p.x + p.y), 0.5 * (p.y - p.x)",
    ),
    "colors in KTX2 are taken for linear numbers": Fault(
        "rust/ktx2/src/container.rs", "Codes::Srgb => (1, 2)", "Codes::Srgb => (1, 1)"
    ),
    "mip levels of alpha lose an eighth": Fault(
        "rust/core/src/textures/mips.rs", "[0, 0, 0, (mean.x + 0.5) as u8]", "[0, 0, 0, (0.875 * mean.x) as u8]"
    ),
}


def is_found(fault: Fault) -> bool:
    """Run the tests with the fault. Return whether one fails."""
    path = ROOT / fault.file
    before = path.read_text(encoding="utf-8")
    if before.count(fault.text) != 1:
        sys.exit(f"leafcloud: {fault.file} has {before.count(fault.text)} × {fault.text!r}: mend the list of faults.")
    path.write_text(before.replace(fault.text, fault.fault), encoding="utf-8")
    try:
        return subprocess.run(["make", "test", "ARGS=-x"], cwd=ROOT, capture_output=True, check=False).returncode != 0
    finally:
        path.write_text(before, encoding="utf-8")


def main(names: list[str]) -> int:
    """Try the faults of these names, or all. Print a line for each."""
    if subprocess.run(["git", "diff", "--quiet", "HEAD"], cwd=ROOT, check=False).returncode != 0:
        sys.exit("leafcloud: the working tree has changes: commit them first.")
    if subprocess.run(["make", "test"], cwd=ROOT, capture_output=True, check=False).returncode != 0:
        sys.exit("leafcloud: the tests fail without a fault: mend them first.")
    missed = 0
    for name in names or FAULTS:
        begin = time.monotonic()
        found = is_found(FAULTS[name])
        missed += not found
        print(f"{'found' if found else 'MISSED'}\t{time.monotonic() - begin:.0f} s\t{name}", flush=True)
    return min(missed, 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
