"""The command `leafcloud`.

leafcloud inspect FILE.glb … [--against LEAVES.glb] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from . import LeafcloudError, __version__
from .comparison import Score, compare
from .inspection import Inspection, inspect


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Return its exit status: 0, 1 if a file cannot be read or breaks a promise, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(prog="leafcloud", description="Tools for trees with levels of detail.")
    parser.add_argument("--version", action="version", version=f"leafcloud {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    inspecting = commands.add_parser(
        "inspect",
        help="show levels, bytes and promises of GLB files, and the parts that engines drop",
        description="Show the levels, bytes and promises of GLB files, of this or another tool.",
    )
    inspecting.add_argument("files", nargs="+", type=Path, metavar="FILE.glb", help="the files")
    inspecting.add_argument(
        "--against",
        type=Path,
        metavar="LEAVES.glb",
        help="compare pictures and cost of drawing of each level, also of another tool, with the finest level of this "
        "file",
    )
    inspecting.add_argument(
        "--json", action="store_true", help="print JSON in place of tables: of several files a list"
    )
    options = parser.parse_args(arguments)
    try:
        return _inspect(options)
    except KeyboardInterrupt:
        print("leafcloud: interrupted", file=sys.stderr)
        return 130


def _inspect(options: argparse.Namespace) -> int:
    """Read and print all files that can be read. Return the exit status."""
    read: dict[Path, tuple[Inspection, list[Score]]] = {}
    for file in options.files:
        try:
            read[file] = inspect(file), [] if options.against is None else compare(file, options.against)
        except LeafcloudError as error:
            print(f"leafcloud: {error}", file=sys.stderr)
    is_list = len(options.files) > 1
    if options.json and (is_list or read):
        rows = [{**({"file": str(file)} if is_list else {}), **_json(*each)} for file, each in read.items()]
        _print(json.dumps(rows if is_list else rows[0], indent=2))
    elif read:
        texts = ["\n".join([*([str(file), ""] if is_list else []), *_lines(*each)]) for file, each in read.items()]
        _print("\n\n\n".join(texts))
    holds = all(check.holds for found, _ in read.values() for check in found.checks)
    return 0 if holds and read.keys() == {*options.files} else 1


def _json(found: Inspection, scores: Sequence[Score]) -> dict[str, Any]:
    return {**asdict(found), "scores": [asdict(score) for score in scores]}


def _print(text: str) -> None:
    """Print text, with ? for letters that the terminal lacks, as far as its reader wants it."""
    encoding = sys.stdout.encoding or "utf-8"
    try:
        print(text.encode(encoding, "replace").decode(encoding), flush=True)
    except BrokenPipeError:
        # Python flushes again at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _lines(found: Inspection, scores: Sequence[Score]) -> list[str]:
    lines = aligned(
        ("level", "triangles", "vertices", "vertex KB", "texture MB", "textures"),
        [
            (
                level.name,
                f"{level.triangles:,}",
                f"{level.vertices:,}",
                f"{level.vertex_bytes / 1e3:,.0f}",
                f"{level.texture_bytes / 1e6:.2f}",
                ", ".join(f"{each.kind} {each.width} × {each.height}" for each in level.pictures),
            )
            for level in found.levels
        ],
    )
    lines += ["", *(f"{level.name}: {', '.join(level.attributes)}" for level in found.levels)]
    if all(level.number is None for level in found.levels):
        lines += ["", "no levels of Leafcloud"]
    if found.checks:
        lines += [
            "",
            *(f"{'holds ' if check.holds else 'BROKEN'} {check.name} ({check.figure})" for check in found.checks),
        ]
    if found.engines:
        lines += ["", *(f"{engine}: {loss}" for engine, loss in found.engines)]
    if scores:
        rows = [
            (each.level, f"{each.size}", f"{each.flip:.3f}", f"{each.coverage:.2f}", f"{each.cost:.3f}")
            for each in scores
        ]
        lines += ["", *aligned(("level", "pixels", "FLIP", "coverage", "cost of drawing"), rows)]
    return lines


def aligned(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines with columns of equal widths; all but the first and the last are aligned to the right."""
    widths = [max(len(row[column]) for row in (headings, *rows)) for column in range(len(headings))]
    last = len(headings) - 1

    def cell(text: str, column: int) -> str:
        return text.ljust(widths[column]) if column in (0, last) else text.rjust(widths[column])

    return ["  ".join(cell(text, i) for i, text in enumerate(row)).rstrip() for row in (headings, *rows)]


if __name__ == "__main__":
    sys.exit(main())
