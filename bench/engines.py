"""Measures what engines draw of a bake, and the files for them: `make bench-engines`.

usage: make bench-engines ARGS='[--quick] [--only SECTION] [TREE.glb …]'
(default: pine, oak and fir of ../shared/foliage)

- Hand-overs in three.js and Babylon.js, by the code of the packages' READMEs, in Chromium without a display: the next
  level beside the one before, from the same places. Also the tree at each of these distances, twice and four times as
  far, beside the leaves with 4 × 4 samples a pixel.
- A level in the engine beside the same level of the .blend in Cycles, from the same camera, without shading, with 4 × 4
  samples.
- Bytes of the files for each engine, with the validator's errors and warnings, for planned and for all effects.

Writes docs/bench/engines.md for all trees. `--quick` leaves out the files, and writes nothing.
`--only` measures one section of the document and keeps the others.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from commits import measured_commit
from engine_views import ROWS, bundle, code_of, fade_behind, hand_overs, levels_of, pictures, sphere_of
from flat_views import make_flat
from glb import Node
from mathutils import Vector
from numpy.typing import NDArray
from sections import sections_of, table

from addon.levels.material import page_of
from leafcloud import flip_map
from leafcloud.comparison import flip_near

ROOT = Path(__file__).resolve().parents[1]
FOLIAGE = ROOT.parent / "shared" / "foliage"
TREES = ("pine_cards_20k", "oak_cards_11k", "douglas_fir_105k")
BAKED = ROOT / "target" / "engines"
ENGINES = ("three", "babylon")
KTX2 = "babylon, KTX2"
"""Babylon.js with KTX2 textures, by the README's code for them."""
TRANSCODER = "/engines/babylon/node_modules/@babylonjs/core/assets/Basis"
PROFILES = ("generic", "three", "babylon", "godot", "unity", "unreal", "bevy")
SAMPLES = 4
"""Samples along a pixel's side of the leaves in the tables of distances."""
UNKNOWN = ("VALUE_NOT_IN_LIST", "IMAGE_UNRECOGNIZED_FORMAT")
"""What the validator says of each KTX2 image: it does not know the format."""
LEAST_CROWN = 60.0
"""Height of a crown in pixels, at least, for which eight pictures are enough. Smaller crowns need more."""
MOST_TURNS = 16
"""Limit of the number of pictures, in eights."""

Picture = NDArray[np.float64]


def directions(turns: int = 1) -> list[tuple[float, float, float]]:
    """Return eight directions from the tree to the eyes for each turn, Y-up."""
    ups = enumerate(np.linspace(-0.1, 0.8, 8 * turns).tolist())
    flat = ((i, up, math.sqrt(1.0 - up * up)) for i, up in ups)
    return [(math.cos(2.4 * i) * across, up, math.sin(2.4 * i) * across) for i, up, across in flat]


INTRODUCTION = """# Engines

Made by `make bench-engines` in Chromium without a graphics card: three.js and Babylon.js with the packages of this
repository, by the code of their READMEs. Pictures have 1,080 rows and a field of view of 50°, light from all sides, no
antialiasing.
"""
HEADS = {
    "Hand-overs": """\
Each level beside the one before it, from the same places: eight, or more where the crown has less than 60 pixels.
*Pixels*: covered by the level before. *FLIP*: mean within 4 pixels of the tree. Limits: coverage 0.95 to 1.05,
luminance 0.97 to 1.03. *There*, *2 ×*, *4 ×*: coverage of the tree as it is drawn behind the hand-over, and so many
times as far away, over that of the leaves with 4 × 4 samples a pixel; limits 0.9 to 1.1.
""",
    "Frames": """\
FLIP between two pictures of a tree that switches by itself, in the square around the crown, while the camera moves by
0.2 % of its distance: where a level begins to fade, where it is gone, and 3 % before it begins. Limit 0.02.
""",
    "Beside Cycles": """\
A level in the engine beside the same level in Cycles with the atlas page of the .blend, from the same cameras,
without shading, with 4 × 4 samples a pixel: FLIP within 4 pixels of the tree; limit 0.08. *Crown*: its height in
pixels. Cycles draws the cross impostor as the last level; the engines draw the octahedral impostor in its place where
a tree has one.
""",
    "Files": """\
Kilobytes of the leaves' own file, of each level's file, and of all levels in one file. The validator does not know
KTX2: its two warnings about each such image do not count.
""",
}
"""The sections of the document, with their introductions."""


@dataclass(frozen=True)
class View:
    """Views of a tree from `distance`, with as many pixels for the tree as in a picture of `ROWS`.

    side: of the picture in pixels. fov: its field of view in degrees. turns: number of pictures, in eights.
    """

    distance: float
    centre: NDArray[np.float64]
    side: int
    fov: float
    turns: int = 1

    @staticmethod
    def of(distance: float, level: Node, samples: int = 1) -> View:
        centre, radius = sphere_of(level)
        rows = ROWS * samples
        tangent = math.tan(math.radians(25.0))
        needed = 2.3 * radius / distance / tangent / 2.0 * rows
        side = min(max(64, 2 ** math.ceil(math.log2(needed))), 4096)
        half = tangent * side / rows
        return View(distance, centre, side, math.degrees(2.0 * math.atan(half)))

    def in_more_turns(self, level: Node) -> View:
        """Return more views of a crown that is small in each picture."""
        crown = ROWS * sphere_of(level)[1] / self.distance / math.tan(math.radians(25.0))
        return replace(self, turns=min(max(round((LEAST_CROWN / crown) ** 2), 1), MOST_TURNS))

    @property
    def question(self) -> dict[str, Any]:
        eyes = [self.centre + self.distance * np.array(direction) for direction in directions(self.turns)]
        views = [{"eye": eye.tolist(), "target": self.centre.tolist(), "fov": self.fov} for eye in eyes]
        return {"side": self.side, "views": views}


@cache
def bake(tree: Path, engine: str, effects: str = "auto", *more: str) -> Path:
    """Return the whole chain of a bake for an engine. `more`: flags."""
    out = BAKED / "_".join([tree.stem, engine, effects, *more])
    command = [sys.executable, str(ROOT / "bake.py"), "--input", str(tree), "--out", str(out), "--engine", engine]
    command += ["--files", "levels"]
    subprocess.run([*command, "--effects", effects, *more], check=True, capture_output=True)
    if engine == "babylon":
        bundle(out)
    return out / f"{tree.stem}.glb"


def drawn(
    engine: str,
    file: Path,
    view: View,
    views: Sequence[Any] = (),
    *,
    mips: bool = True,
    samples: bool = False,
    **settings: Any,
) -> Picture:
    """Return the pictures in an engine: linear light, premultiplied, (views, side, side, 4) in [0, 1].

    views: in place of those of `view`, with its field of view. mips: false for three.js without mip levels of PNG.
    samples: true for three.js with multisampling.
    """
    name = "babylon" if engine == KTX2 else engine
    code = code_of(name, 2).replace("/basis/", TRANSCODER) if engine == KTX2 else code_of(name)
    question = view.question
    asked = {
        **question,
        "views": views or question["views"],
        "code": code,
        "mips": mips,
        "samples": samples,
        "settings": {"pixels": zoomed(view), **settings},
    }
    found: Picture = np.stack([picture["pixels"] for picture in pictures(name, file, **asked)]) / 255.0
    colors, alpha = found[..., :3], found[..., 3:]
    if name == "babylon":  # Its alpha is that of the texture, not premultiplied; nothing blends here.
        alpha = (alpha > 0.0).astype(float)
    else:
        colors = (colors / np.maximum(alpha, 1e-6)).clip(0.0, 1.0)
    return np.concatenate([linear(colors) * alpha, alpha], axis=-1)


def zoomed(view: View) -> float:
    """Return the height for which a field of view of `view.fov` sees the levels of 50° over `ROWS`."""
    return ROWS * math.tan(math.radians(view.fov / 2.0)) / math.tan(math.radians(25.0))


def linear(colors: Picture) -> Picture:
    return np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)


def coverage(picture: Picture) -> float:
    return float(picture[..., 3].mean())


def luminance(picture: Picture) -> float:
    """Return the mean luminance of the covered pixels."""
    light = picture[..., :3] @ np.array([0.2126, 0.7152, 0.0722])
    return float(light.sum() / max(picture[..., 3].sum(), 1.0))


def flip(base: Picture, other: Picture) -> float:
    """Return the mean FLIP within 4 pixels of the silhouettes, over all pairs of pictures in which anything is seen."""
    seen = [pair for pair in zip(base, other, strict=True) if max(pair[0][..., 3].max(), pair[1][..., 3].max()) > 0.5]
    return float(np.mean([flip_near(encoded(before), encoded(after)) for before, after in seen]))


def encoded(picture: Picture) -> NDArray[np.uint8]:
    """Return sRGB bytes with straight alpha."""
    colors = picture[..., :3] / np.maximum(picture[..., 3:], 1e-6)
    srgb = np.where(colors <= 0.0031308, 12.92 * colors, 1.055 * np.maximum(colors, 1e-9) ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * np.concatenate([srgb, picture[..., 3:]], axis=-1)).clip(0, 255).astype(np.uint8)


def ratio(after: float, before: float) -> str:
    """Return a cell: how many times as much, or that nothing was drawn before."""
    return f"{after / before:.2f}" if before > 0.0 else "from nothing"


def hand_over_rows(tree: Path, engine: str) -> Iterator[list[str]]:
    """Yield a row of the table for each hand-over of a tree in an engine."""
    file = bake(tree, "babylon" if engine == KTX2 else engine)
    levels = levels_of(file)
    for number, distance in enumerate(hand_overs(levels)):
        view = View.of(distance, levels[0]).in_more_turns(levels[0])
        before, after = (drawn(engine, file, view, level=level) for level in (number, number + 1))
        far = [coverage_at(tree, engine, file, times * distance) for times in (1.26, 2.0, 4.0)]
        yield [
            *(tree.stem, engine, f"{number} → {number + 1}", f"{(before[..., 3] > 0.5).sum() / len(before):,.0f}"),
            ratio(coverage(after), coverage(before)),
            ratio(luminance(after), luminance(before)),
            f"{flip(before, after):.3f}",
            *(f"{each:.2f}" for each in far),
        ]


def frame_rows(tree: Path, engine: str) -> Iterator[list[str]]:
    """Yield the FLIP of neighboring frames at each hand-over."""
    file = bake(tree, "babylon" if engine == KTX2 else engine)
    levels = levels_of(file)
    for number, distance in enumerate(hand_overs(levels)):
        fade = fade_behind("transition_end" in levels[number].extras["leafcloud"])
        places = [distance, distance * (1.0 + fade), 0.97 * distance]
        view = View.of(0.9 * distance, levels[0])
        crown = int(view.side * sphere_of(levels[0])[1] / distance / math.tan(math.radians(view.fov / 2.0)))
        near = [replace(view, distance=place * step) for place in places for step in (0.999, 1.001)]
        frames = drawn(engine, file, view, [each for one in near for each in one.question["views"][:2]])
        frames = frames.reshape(len(places), 2, 2, *frames.shape[1:])  # places, steps, directions
        means = [np.mean([flip_in(one, other, crown) for one, other in zip(*both, strict=True)]) for both in frames]
        yield [tree.stem, engine, f"{number} → {number + 1}", *(f"{each:.3f}" for each in means)]


def flip_in(one: Picture, other: Picture, side: int) -> float:
    """Return the mean FLIP of two pictures on white, in a square of so many pixels in their middle."""
    start = max((len(one) - side) // 2, 0)
    crops = [each[start : start + side, start : start + side] for each in (one, other)]
    on_white = [np.dstack([each[..., :3] + 1.0 - each[..., 3:], np.ones_like(each[..., :1])]) for each in crops]
    return float(flip_map(*(encoded(np.ascontiguousarray(each)) for each in on_white)).mean())


@cache
def leaves_from(tree: Path, distance: float) -> float:
    """Return the area in pixels that the leaves cover from a distance, with `SAMPLES` samples along a pixel's side.

    Without mip levels, so that the textures themselves decide.
    """
    base = bake(tree, "three")
    level = levels_of(base)[0]
    fine = View.of(distance, level, SAMPLES).in_more_turns(level)
    leaves = drawn("three", base, fine, mips=False, level=0, byHand={"transition": 0.0, "keep": 1.0})
    return coverage(leaves) * (fine.side / SAMPLES) ** 2


def coverage_at(tree: Path, engine: str, file: Path, distance: float) -> float:
    """Return the coverage of the tree as it is drawn from a distance, over that of its leaves."""
    level = levels_of(file)[0]
    view = View.of(distance, level).in_more_turns(level)
    return coverage(drawn(engine, file, view)) * view.side**2 / leaves_from(tree, distance)


def cycles_rows(tree: Path) -> Iterator[list[str]]:
    """Yield for each level its FLIP in engines beside the same level in Cycles."""
    base = levels_of(bake(tree, "three"))
    _, radius = sphere_of(base[0])
    places = [0.5 * hand_overs(base)[0], *hand_overs(base)]
    for number, distance in enumerate(places):
        view = View.of(distance, base[0], SAMPLES)
        row = [
            tree.stem,
            str(number),
            f"{2.0 * radius * ROWS / (2.0 * distance * math.tan(math.radians(25.0))):.0f}",
        ]
        for engine in ENGINES:
            file = bake(tree, engine)
            cycles = in_cycles(file.with_name(f"{tree.stem}_LOD{number}.glb"), view)
            seen = drawn(engine, file, view, level=number)
            row.append(f"{flip(reduced(cycles), reduced(seen)):.3f}")
        yield row


def in_cycles(file: Path, view: View) -> Picture:
    """Return pictures of a level in Cycles without shading, one sample a pixel, as from `drawn`.

    Atlas pages are those of the .blend: files have other ones, made for mip levels, which Cycles does not draw.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(file))
    imported = list(bpy.data.materials)
    name, _, _ = file.stem.rpartition("_LOD")
    with bpy.data.libraries.load(str(file.with_name(f"{name}.blend"))) as (inside, wanted):
        wanted.materials = [material.name for material in imported if material.name in inside.materials]
    for material in imported:
        page = next((page_of(own) for own in wanted.materials if own.name.partition(".")[0] == material.name), None)
        if page is not None:
            show_page(material, *page)
        elif any(node.type == "BSDF_PRINCIPLED" for node in material.node_tree.nodes):
            make_flat(material)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.transparent_max_bounces = 1, 1024
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = view.side
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGBA", "32"
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.angle, camera.data.clip_end = math.radians(view.fov), 10.0 * view.distance
    scene.collection.objects.link(camera)
    scene.camera = camera
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (x, y, z) in enumerate(directions()):
            direction = Vector((x, -z, y))
            middle = Vector((view.centre[0], -view.centre[2], view.centre[1]))
            camera.location = middle + view.distance * direction
            camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
            scene.render.filepath = str(Path(folder) / f"{number}.exr")
            bpy.ops.render.render(write_still=True)
            loaded = bpy.data.images.load(scene.render.filepath)
            light = np.empty(4 * view.side**2, np.float32)
            loaded.pixels.foreach_get(light)
            found.append(light.reshape(view.side, view.side, 4)[::-1].astype(np.float64))
    return np.stack(found)


def show_page(material: bpy.types.Material, image: bpy.types.Image, cutoff: float) -> None:
    """Make the material emit an atlas page where its alpha reaches the cutoff."""
    tree = material.node_tree
    tree.nodes.clear()
    texture, cut, emission, clear, mix, output = (
        tree.nodes.new(f"ShaderNode{kind}")
        for kind in ("TexImage", "Math", "Emission", "BsdfTransparent", "MixShader", "OutputMaterial")
    )
    texture.image = image
    cut.operation, cut.inputs[1].default_value = "GREATER_THAN", cutoff
    for source, target in (
        (texture.outputs["Color"], emission.inputs[0]),
        (texture.outputs["Alpha"], cut.inputs[0]),
        (cut.outputs[0], mix.inputs[0]),
        (clear.outputs[0], mix.inputs[1]),
        (emission.outputs[0], mix.inputs[2]),
        (mix.outputs[0], output.inputs[0]),
    ):
        tree.links.new(source, target)


def reduced(pictures_of: Picture) -> Picture:
    """Return the means of the samples of each pixel."""
    views, side = pictures_of.shape[0], pictures_of.shape[1] // SAMPLES
    means: Picture = pictures_of.reshape(views, side, SAMPLES, side, SAMPLES, 4).mean(axis=(2, 4))
    return means


def file_rows(tree: Path) -> Iterator[list[str]]:
    """Yield for each profile the bytes of its files and what the validator says."""
    for engine, compressed in itertools.chain(((each, ()) for each in PROFILES), (("three", ("--compress",)),)):
        for effects in ("auto", "all"):
            folder = bake(tree, engine, effects, *compressed).parent
            files = sorted(folder.glob("*.glb"))
            levels = [file for file in files if "_LOD" in file.name]
            sizes = [file.stat().st_size / 1e3 for file in (*levels, folder / f"{tree.stem}.glb")]
            yield [
                *(tree.stem, " ".join([engine, *compressed]), effects, f"{tree.stat().st_size / 1e3:,.0f}"),
                ", ".join(f"{size:,.0f}" for size in sizes[:-1]),
                f"{sizes[-1]:,.0f}",
                str(issues(files)),
            ]


def issues(files: Sequence[Path]) -> int:
    """Return the number of errors and warnings of the Khronos validator, without those about KTX2 images."""
    command = ["node", "validate.mjs", *(str(file) for file in files)]
    run = subprocess.run(command, cwd=ROOT / "tests" / "gltf_validator", capture_output=True, text=True, check=True)
    serious = [issue for found in json.loads(run.stdout).values() for issue in found if issue["severity"] < 2]
    return sum(issue["code"] not in UNKNOWN or "/images/" not in issue["pointer"] for issue in serious)


def section(name: str, trees: Sequence[Path]) -> str:
    """Measure one section of the document, with its head."""
    commit = measured_commit()
    if name == "Hand-overs":
        names = ["tree", "engine", "levels", "pixels", "coverage", "luminance", "FLIP", "there", "2 ×", "4 ×"]
        rows = [row for tree in trees for engine in (*ENGINES, KTX2) for row in hand_over_rows(tree, engine)]
    elif name == "Frames":
        names = ["tree", "engine", "levels", "it begins to fade", "it is gone", "before"]
        rows = [row for tree in trees for engine in (*ENGINES, KTX2) for row in frame_rows(tree, engine)]
    elif name == "Beside Cycles":
        names = ["tree", "level", "crown", *ENGINES]
        rows = [row for tree in trees for row in cycles_rows(tree)]
    else:
        names = ["tree", "engine", "effects", "leaves", "levels", "whole chain", "errors and warnings"]
        rows = [row for tree in trees for row in file_rows(tree)]
    return f"## {name}\n\n{HEADS[name]}\nMeasured at {commit}.\n\n{table(names, rows)}"


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure what engines draw of a bake, and the files for them.")
    parser.add_argument(
        "trees", nargs="*", type=Path, help="GLB files (default: pine, oak and fir of ../shared/foliage)"
    )
    parser.add_argument("--quick", action="store_true", help="leave out the files")
    parser.add_argument("--only", choices=HEADS, help="measure this section alone; the document keeps the others")
    arguments = parser.parse_args()
    usual = [FOLIAGE / f"{name}.glb" for name in TREES]
    wanted = [arguments.only] if arguments.only else list(HEADS)[: 3 if arguments.quick else None]
    document = ROOT / "docs" / "bench" / "engines.md"
    found = sections_of(document) if arguments.only else {}
    for name in wanted:
        found[name] = section(name, arguments.trees or usual)
        print(found[name], flush=True)
    if not arguments.trees and not arguments.quick:
        parts = [found[name] for name in HEADS if name in found]
        document.write_text("\n".join([INTRODUCTION, *parts]), encoding="utf-8")


if __name__ == "__main__":
    main()
