"""Measures the coverage of levels in an engine as they become small: `make bench-three`.

usage: python bench/three.py [TREE.glb …]      (default: those of ../shared/foliage up to 10 MB)

Bakes each tree into target/three and renders it with three.js, in Chromium without a display (bench/three/look.js):
unlit, from 8 views, at sizes from 512² to 16² pixels, each the mean over many subpixel offsets. Level 1 is rendered
with its PNG, with box-filtered mips from the engine, and with its KTX2, whose mip levels keep coverage. The leaves
are rendered at 1024² without mip levels; that coverage is the reference for every size. A second table has every
level with its trunk at the size of its switch, and at half and a quarter of it. Prints tables in Markdown; for all
trees it also writes docs/bench/three.md. target/three/TREE/strip.png shows the leaves, the PNG and the KTX2 of the
first view at 256² and at 64², the latter enlarged.
"""

from __future__ import annotations

import argparse
import base64
import json
import math
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from browser import ROOT, BrowserError, ask
from numpy.typing import NDArray

import leafcloud

FOLIAGE = ROOT.parent / "shared" / "foliage"
BAKED = ROOT / "target" / "three"
LARGEST_FILE = 10_000_000
SIZES = {512: 1, 256: 2, 128: 4, 64: 8, 32: 8, 16: 8}
"""Pixels along a picture's side, and the subpixel offsets along a pixel's side."""
LEAVES = {1024: 1}
"""The same for the leaves."""
SHOWN = (256, 64)
PIXELS = 1080.0 / math.tan(math.radians(25.0))
"""Diameter in pixels of a sphere of radius R at the distance R, for 1080 rows and a field of view of 50°."""
PARTS = (1, 2, 4)
PATIENCE = 600.0
"""Time limit of a page in seconds."""
LUMINANCE = (0.2126, 0.7152, 0.0722)

Picture = NDArray[np.float32]

INTRODUCTION = """# In an engine

Made by `make bench-three`: level 1 in three.js, unlit, from 8 views, at sizes at which the leaves'
bounding sphere fills the picture. *PNG*: the engine makes the mip levels with a box filter. *KTX2*: it uses the
file's mip levels, which keep coverage (`--engine three`). *Coverage*, *luminance*: level 1's divided by that of the
leaves, rendered without mip levels at 1024². *Texels*: along a pixel's side. Below 1 texels are magnified, and the
level before is still drawn. Level 2, which is not shown here, would take over at a crown of some 115 pixels. Files
larger than 10 MB are left out: they are for speed tests.
"""

HAND_OVERS = """## Where levels take over

A bake with default settings, including the trunk. *Own*: the level's size at its switch, in a view of 1080 rows
and 50°; then half and a quarter of that size. Coverage relative to the leaves and their trunk, as above.
"""


@dataclass(frozen=True)
class Request:
    """One request to the page; see bench/three/look.js."""

    url: str
    ktx2: bool = False
    mips: bool = True
    trunk: bool = False
    sizes: dict[int, int] = field(default_factory=SIZES.copy)


@dataclass(frozen=True)
class Seen:
    """The renders of a model by size: mean linear RGB and coverage per view (views, 4), and the first view's picture.

    texels: texels along the frame's side, or None without textures.
    """

    texels: float | None
    means: dict[int, NDArray[np.float64]]
    pictures: dict[int, Picture]

    def coverage(self, size: int) -> float:
        return float(self.means[size][:, 3].mean())

    def luminance(self, size: int) -> float:
        """Return the mean luminance of the covered part; NaN if nothing is covered."""
        light = float(self.means[size][:, :3].mean(0) @ LUMINANCE)
        return light / self.coverage(size) if self.coverage(size) else math.nan


def look(*looks: Request) -> list[Seen]:
    """Render each model with three.js."""
    try:
        answer = ask("bench/three/look.html", [vars(wanted) for wanted in looks], patience=PATIENCE)
    except BrowserError as error:
        raise SystemExit(str(error)) from None
    return [to_seen(each) for each in answer["seen"]]


def to_seen(answer: dict[str, Any]) -> Seen:
    sizes = {each["size"]: each for each in answer["sizes"]}
    return Seen(
        answer["texels"],
        {size: np.array(each["views"]) for size, each in sizes.items()},
        {size: to_picture(each["picture"], size) for size, each in sizes.items()},
    )


def to_picture(text: str, size: int) -> Picture:
    """Decode a picture (size, size, 4). WebGL's rows begin at the bottom, so the rows are reversed."""
    return np.frombuffer(base64.b64decode(text), np.float32).reshape(size, size, 4)[::-1]


def bake(tree: Path, out: Path, *options: str) -> str:
    """Bake for three.js into `out`; return the URL of the files without their suffixes."""
    command = [sys.executable, str(ROOT / "bake.py"), "--input", str(tree), "--out", str(out)]
    subprocess.run([*command, "--engine", "three", *options], check=True, capture_output=True)
    return f"/{out.relative_to(ROOT).as_posix()}/{tree.stem}"


def leaves_of(base: str, *, trunk: bool = False) -> Request:
    """Return the request for the leaves, without mip levels, which would thin out the leaves' own textures."""
    return Request(f"{base}_LOD0.glb", mips=False, trunk=trunk, sizes=LEAVES)


def measure(tree: Path) -> list[dict[str, Any]]:
    """Bake a tree and return a row for each size of level 1."""
    out = BAKED / tree.stem
    base = bake(tree, out, "--levels", "1", "--no-cross")
    leaves, png, ktx2 = look(leaves_of(base), Request(f"{base}_LOD1.glb"), Request(f"{base}_LOD1.glb", ktx2=True))
    leafcloud.write_png(str(out / "strip.png"), strip(leaves, png, ktx2))
    assert png.texels is not None
    return [
        {
            "tree": tree.stem,
            "size": size,
            "texels": png.texels / size,
            "png": ratios(png, leaves, size),
            "ktx2": ratios(ktx2, leaves, size),
        }
        for size in SIZES
    ]


def measure_hand_overs(tree: Path) -> list[dict[str, Any]]:
    """Return a row for each level: its size at its switch, and its coverage there and at half and a quarter of it."""
    out = BAKED / f"{tree.stem}_levels"
    base = bake(tree, out)
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    levels = report["levels"][1:]
    own = [2 * round(PIXELS * report["input"]["radius"] / level["switch_distance"] / 2) for level in levels]
    sizes = [{size // part: 8 for part in PARTS} for size in own]
    looks = [leaves_of(base, trunk=True)]
    for level, wanted in zip(levels, sizes, strict=True):
        url = f"{base}_LOD{level['level']}.glb"
        looks += [Request(url, ktx2=ktx2, trunk=True, sizes=wanted) for ktx2 in (False, True)]
    leaves, *seen = look(*looks)
    return [
        {
            "tree": tree.stem,
            "level": level["level"],
            "size": size,
            **{
                way: [ratios(shown, leaves, size // part)[0] for part in PARTS]
                for way, shown in zip(("png", "ktx2"), seen[2 * index :], strict=False)
            },
        }
        for index, (level, size) in enumerate(zip(levels, own, strict=True))
    ]


def ratios(level: Seen, leaves: Seen, size: int) -> tuple[float, float]:
    """Return coverage and luminance relative to the leaves, over all views."""
    [whole] = leaves.means
    return level.coverage(size) / leaves.coverage(whole), level.luminance(size) / leaves.luminance(whole)


def strip(leaves: Seen, *levels: Seen) -> NDArray[np.uint8]:
    """Return a picture on white with a row for each size in `SHOWN`."""
    [whole] = leaves.pictures.values()
    rows = []
    for size in SHOWN:
        pictures = [smaller(whole, size), *(level.pictures[size] for level in levels)]
        times = np.ones((SHOWN[0] // size, SHOWN[0] // size, 1), np.float32)
        rows.append(np.hstack([np.kron(picture, times) for picture in pictures]))
    light = np.vstack(rows)
    light[..., :3] += 1.0 - light[..., 3:]
    codes = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)
    codes[..., 3] = 1.0
    return np.rint(255.0 * codes.clip(0.0, 1.0)).astype(np.uint8)


def smaller(picture: Picture, size: int) -> Picture:
    times = len(picture) // size
    return picture.reshape(size, times, size, times, 4).mean((1, 3))


def table(rows: list[dict[str, Any]]) -> str:
    lines = [
        "| tree | size | texels | coverage, PNG | coverage, KTX2 | luminance, PNG | luminance, KTX2 |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        columns = (row[way][part] for part in (0, 1) for way in ("png", "ktx2"))
        shares = " | ".join("–" if math.isnan(share) else f"{share:.3f}" for share in columns)
        lines.append(f"| {row['tree']} | {row['size']}² | {row['texels']:.1f} | {shares} |")
    return "\n".join(lines)


def hand_over_table(rows: list[dict[str, Any]]) -> str:
    lines = [
        "| tree | level | own size | PNG: own, half, a quarter | KTX2: own, half, a quarter |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        columns = (", ".join(f"{share:.2f}" for share in row[way]) for way in ("png", "ktx2"))
        lines.append(f"| {row['tree']} | {row['level']} | {row['size']}² | {' | '.join(columns)} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the coverage of levels in three.js as they become small.")
    parser.add_argument("trees", nargs="*", type=Path, help="GLB files (default: all of ../shared/foliage up to 10 MB)")
    parser.add_argument("--hand-overs", action="store_true", help="only the second table; writes no file")
    arguments = parser.parse_args()
    whole = [tree for tree in sorted(FOLIAGE.glob("*.glb")) if tree.stat().st_size <= LARGEST_FILE]
    rows, hand_overs = [], []
    for tree in arguments.trees or whole:
        if not arguments.hand_overs:
            rows += measure(tree)
        hand_overs += measure_hand_overs(tree)
        print(hand_over_table(hand_overs).splitlines()[-1], file=sys.stderr, flush=True)
    text = f"{INTRODUCTION}\n{table(rows)}\n\n{HAND_OVERS}\n{hand_over_table(hand_overs)}\n"
    print(text)
    if not (arguments.trees or arguments.hand_overs):
        (ROOT / "docs" / "bench").mkdir(parents=True, exist_ok=True)
        (ROOT / "docs" / "bench" / "three.md").write_text(text)


if __name__ == "__main__":
    main()
