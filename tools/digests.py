"""Compares baked files before and after a change that must not touch them.

usage: python tools/digests.py save FILE [TREE.glb …]
       python tools/digests.py compare FILE

`save` bakes each tree with the planned effects, with all and with none, and writes digests of the baked files to FILE.
`compare` bakes again and prints a line for each difference; it exits with status 1 if there is one. Trees are the shrub
and all of ../shared/foliage except the tree of a million triangles, unless they are named.

GLB files and images are compared by their bytes, report.json without its times and once more without its texts. The
file of a .blend holds addresses, so the properties of its data-blocks are compared, up to 2 MB: they take minutes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]

FOLIAGE = ROOT.parent / "shared" / "foliage"
SHRUB = ROOT / "examples" / "shrub.glb"
LEFT_OUT = {"maple_1m"}
LARGEST_BLEND = 2_000_000
"""Bytes."""
BAKES = {
    "planned": ("--effects", "auto"),
    "all": ("--effects", "all", "--chain", "both"),
    "none": ("--effects", "none"),
}
TEXTS = {"reason", "warnings"}

Digests = dict[str, str]
"""By tree, bake and file."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=("save", "compare"))
    parser.add_argument("file", type=Path)
    parser.add_argument("trees", nargs="*", type=Path)
    options = parser.parse_args()
    if options.action == "save":
        measured = [tree for tree in sorted(FOLIAGE.glob("*.glb")) if tree.stem not in LEFT_OUT]
        trees = options.trees or [SHRUB, *measured]
        saved = {"trees": [str(tree.resolve()) for tree in trees], "digests": digests_of(trees)}
        options.file.write_text(json.dumps(saved, indent=1), encoding="utf-8")
        return 0
    saved = json.loads(options.file.read_text(encoding="utf-8"))
    before, after = saved["digests"], digests_of([Path(tree) for tree in saved["trees"]])
    differences = [name for name in sorted(before.keys() | after.keys()) if before.get(name) != after.get(name)]
    for name in differences:
        print(f"{name}: {'new' if name not in before else 'gone' if name not in after else 'differs'}")
    print(f"{len(after) - sum(name in after for name in differences)} of {len(after)} digests are the same")
    return 1 if differences else 0


def digests_of(trees: list[Path]) -> Digests:
    digests: Digests = {}
    for tree in trees:
        for bake, flags in BAKES.items():
            with tempfile.TemporaryDirectory() as folder:
                command = [sys.executable, str(ROOT / "bake.py"), "--input", str(tree), "--out", folder, *flags]
                subprocess.run(command, check=True, capture_output=True)
                for file in sorted(Path(folder).rglob("*")):
                    if file.is_file():
                        found = _of_file(file)
                        digests |= {f"{tree.stem} {bake} {file.name}{part}": each for part, each in found.items()}
            print(f"{tree.stem} {bake}", file=sys.stderr, flush=True)
    return digests


def _of_file(file: Path) -> Digests:
    if file.name == "report.json":
        report = json.loads(file.read_text(encoding="utf-8"))
        return {
            "": _digest(_without(report, {"seconds"})),
            " without texts": _digest(_without(report, {"seconds", *TEXTS})),
        }
    if file.name == "report.html":  # The pictures and values of other files, with times.
        return {}
    if file.suffix == ".blend" and file.stat().st_size > LARGEST_BLEND:
        return {}
    if file.suffix == ".blend":
        # In a process of its own: Blender may crash on the fourth file or so that is opened and read like this.
        script = f"import bpy, dumps; bpy.ops.wm.open_mainfile(filepath={str(file)!r}); print(*dumps.dump(), sep='\\n')"
        command = [sys.executable, "-c", script]
        found = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT / "tests" / "support")
        lines = defaultdict(list)
        for line in found.stdout.splitlines():
            lines[line.split(" ", 1)[0]].append(line)
        return {f" {kind}": _digest(found) for kind, found in lines.items()}
    return {"": hashlib.sha256(file.read_bytes()).hexdigest()}


def _without(value: Any, keys: set[str]) -> Any:
    """The JSON value without these keys, at any depth."""
    if isinstance(value, dict):
        return {key: _without(inner, keys) for key, inner in value.items() if key not in keys}
    return [_without(inner, keys) for inner in value] if isinstance(value, list) else value


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
