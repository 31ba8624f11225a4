"""Measures the savings of leaving out effects that a scene does not need: `make bench-minimal`.

usage: python bench/minimal.py [TREE.glb] [--runs N]

The scene is a tree (default: the pine), a still camera 2.8 radii away, and a sun. It is baked twice: as planned for
this camera only, and with all effects on except baked light, which excludes most others. Seconds are the program's,
minimum over the runs, without the time of --plan-only (Blender's start and reading the scene). Bytes are those of all
.glb files and the .blend. The cost of each effect, its bytes before compression, comes from the report. FLIP compares
both bakes' pictures from Cycles at the scene's camera, with and without the two effects that change the near picture:
forced wind moves leaves, and the shadow proxy shades them by billboards. Prints tables in Markdown; for the pine it
also writes docs/bench/minimal.md.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import flip_evaluator
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
from mathutils import Vector  # noqa: E402

from addon.bake.pipeline import describe  # noqa: E402
from addon.geometry import world_positions  # noqa: E402
from addon.levels.shadow_proxy import is_shadow_proxy  # noqa: E402
from addon.mesh.extract import extract  # noqa: E402
from addon.nodes.wind import GROUP_NAME  # noqa: E402
from addon.scene.load import load  # noqa: E402
from addon.settings.bake import BakeSettings  # noqa: E402

PINE = ROOT.parent / "shared" / "foliage" / "pine_cards_20k.glb"
RADII = 2.8
"""Nearer than the 2.9 radii from which a transition that is forced on moves leaves of the pine."""
SIZE, SAMPLES = 256, 32


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tree", nargs="?", type=Path, default=PINE)
    parser.add_argument("--runs", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scene = staged(options.tree, Path(folder) / "scene.blend")
        lines = report(scene, Path(folder), options.runs)
    print("\n".join(lines))
    if options.tree == PINE:
        (ROOT / "docs" / "bench" / "minimal.md").write_text("\n".join([*lines, ""]), encoding="utf-8")


def staged(tree: Path, path: Path) -> Path:
    """Save a .blend of the tree, a camera and a sun; return its path."""
    load(tree)
    scene = bpy.context.scene
    read = extract(bpy.context.evaluated_depsgraph_get(), None)
    facts = describe(read, BakeSettings())
    points = world_positions(read.leaves, read.matrix)
    centre = Vector((points.min(0) + points.max(0)) / 2.0)
    for old in [obj for obj in scene.objects if obj.type in ("CAMERA", "LIGHT")]:
        bpy.data.objects.remove(old)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = centre + Vector((0.0, -RADII * facts.radius, 0.0))
    camera.rotation_euler = (math.pi / 2.0, 0.0, 0.0)
    camera.data.sensor_fit, camera.data.angle = "VERTICAL", math.radians(50.0)
    camera.data.clip_end = 100.0 * facts.radius
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (0.6, 0.3, 0.0)
    for obj in (camera, sun):
        scene.collection.objects.link(obj)
    scene.camera = camera
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def report(scene: Path, folder: Path, runs: int) -> list[str]:
    reading = timed(runs, "--input", str(scene), "--plan-only")
    planned, seconds, size = baked(scene, folder / "auto", runs, "--viewer", "camera")
    forced, all_seconds, all_size = baked(scene, folder / "all", runs, "--effects", "all")
    seconds, all_seconds = seconds - reading, all_seconds - reading
    pictures = [picture(folder / "auto" / "scene.blend"), picture(folder / "all" / "scene.blend")]
    error, still = flip(*pictures), flip(pictures[0], picture(folder / "all" / "scene.blend", as_it_is=False))
    faster, smaller = all_seconds / seconds, all_size / size
    return [
        "| bake | seconds | MB of files |",
        "|---|---|---|",
        f"| start and reading, not included below | {reading:.1f} | |",
        f"| as planned | {seconds:.1f} | {size / 1e6:.2f} |",
        f"| everything on | {all_seconds:.1f} | {all_size / 1e6:.2f} |",
        "",
        f"As planned: {faster:.1f} × faster, {smaller:.1f} × smaller, FLIP {still:.4f}; {error:.4f} with "
        "the wind and the shadow proxy, which the scene does not need.",
        "",
        "| effect | planned | reason | seconds if forced on | MB if forced on |",
        "|---|---|---|---|---|",
        *(row(ours, on) for ours, on in zip(planned["effects"], forced["effects"], strict=True)),
    ]


def row(planned: dict[str, Any], forced: dict[str, Any]) -> str:
    costs = f"{forced['seconds']:.2f} | {forced['bytes'] / 1e6:.2f}"
    return f"| {planned['name']} | {'on' if planned['on'] else 'off'} | {planned['reason']} | {costs} |"


def baked(scene: Path, out: Path, runs: int, *flags: str) -> tuple[dict[str, Any], float, int]:
    """Bake; return the report, the seconds of the whole program, and the bytes of all .glb and .blend files."""
    seconds = timed(runs, "--input", str(scene), "--out", str(out), *flags)
    size = sum(file.stat().st_size for file in out.iterdir() if file.suffix in (".glb", ".blend"))
    return json.loads((out / "report.json").read_text(encoding="utf-8")), seconds, size


def timed(runs: int, *flags: str) -> float:
    """Run bake.py `runs` times; return the least seconds."""
    seconds = math.inf
    for _ in range(runs):
        begin = time.perf_counter()
        subprocess.run([sys.executable, str(ROOT / "bake.py"), *flags], check=True, capture_output=True)
        seconds = min(seconds, time.perf_counter() - begin)
    return seconds


def flip(first: NDArray[np.float32], second: NDArray[np.float32]) -> float:
    """Return the mean FLIP error between two pictures."""
    return float(np.mean(flip_evaluator.evaluate(first, second, "LDR", applyMagma=False)[0]))


def picture(path: Path, *, as_it_is: bool = True) -> NDArray[np.float32]:
    """Render a file at its camera with Cycles: (SIZE, SIZE, 3), sRGB. `as_it_is=False` hides wind and shadow proxy."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    if not as_it_is:
        for obj in bpy.data.objects:
            obj.hide_render |= is_shadow_proxy(obj)
            obj.visible_shadow = True
            for modifier in obj.modifiers:
                modifier.show_render &= not modifier.name.startswith(GROUP_NAME)
    scene = bpy.context.scene
    render, cycles = scene.render, scene.cycles
    render.engine, cycles.device, cycles.samples, cycles.seed = "CYCLES", "CPU", SAMPLES, 0
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.transparent_max_bounces = 1024
    render.resolution_x = render.resolution_y = SIZE
    render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"
    render.filepath = str(path.with_suffix(".png"))
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath)
    pixels = np.empty(SIZE * SIZE * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return np.ascontiguousarray(pixels.reshape(SIZE, SIZE, 4)[::-1, :, :3])


if __name__ == "__main__":
    main()
