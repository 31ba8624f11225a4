"""Measures a refinement in Cycles, for `refine.py`: flat-lit, under suns, on a flight. All of them are slow."""

from __future__ import annotations

import base64
import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import flight
import numpy as np
import relit
from fidelity import LEVELS, ROOT, Pictures, flip, rendered, run, smaller
from flat_views import bounding_sphere
from refine_checks import REFINED
from refine_levels import LARGEST, Subject, errors

import leafcloud
from addon.bake.values import Baked
from addon.levels.mesh import polygon_faces
from addon.settings.bake import BakeSettings

sys.path.insert(0, str(ROOT / "tests" / "support"))
from small_glb import write_glb

EFFORTS = ("off", *REFINED)
GRID = 4
"""Samples along a pixel's side in the largest pictures; in smaller ones more."""
VIEWS = 8
SUN_SAMPLES = 8
"""Samples along a pixel's side under suns, by the metrics."""
WAYS = ("normals", "self-shadowed")
"""Ways of bench/relit.py."""


def write_level(level: leafcloud.Level, file: Path) -> Path:
    """Write the billboards with the page of the .blend file as a GLB file."""
    page = base64.b64encode(leafcloud.encode_png([level.base_color])).decode()
    # glTF's y is up, and v counts from the top.
    x, y, z = level.corners.T
    u, v = level.uvs.T
    polygons = np.arange(len(level.polygon_sizes))
    fans = polygon_faces(level.polygon_sizes, np.arange(level.triangles), polygons, mirrored=False)
    arrays = [
        np.stack([x, z, -y], axis=1).astype("<f4"),
        np.stack([u, 1.0 - v], axis=1).astype("<f4"),
        fans.corners.astype("<u4"),
    ]
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}
    material = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
        "alphaMode": "MASK",
        "alphaCutoff": level.alpha_cutoff,
        "doubleSided": True,
    }
    document: dict[str, Any] = {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "leaves", "mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [material],
        "textures": [{"source": 0}],
        "images": [{"uri": f"data:image/png;base64,{page}"}],
    }
    return write_glb(file, document, arrays)


def compare(subject: Subject) -> dict[str, Any]:
    """Measure the errors of level 1 with each effort in pictures of Cycles."""
    with tempfile.TemporaryDirectory() as folder:
        files = {name: write_level(subject.level(name).level, Path(folder) / f"{name}.glb") for name in EFFORTS}
        views = Path(folder) / "views.npz"
        models = [str(subject.leaves), *map(str, files.values())]
        run(sys.executable, ROOT / "bench" / "flat_views.py", views, LARGEST, VIEWS, GRID, *models)
        with np.load(views) as pictures:
            leaves: Pictures = pictures[models[0]]
            return {name: errors(leaves, pictures[str(file)]) for name, file in files.items()}


def compare_under_suns(subject: Subject) -> dict[str, Any]:
    """Measure level 1 with each effort under the suns of bench/relit.py.

    In Cycles its luminance errors by way, with white leaves. By the metrics FLIP at two sizes, with the leaves' colors.
    """
    shape = ("--max-billboards", subject.billboards, "--texture-size", LEVELS["level 1"])
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        blends = {
            name: relit.bake(subject.leaves, Path(folder) / name, *map(str, shape), "--refine", name)
            for name in EFFORTS
        }
        frame = bounding_sphere([relit.open_white_leaves(blends["off"])])
        with flight.quiet():
            base = relit.render(frame, lambda sun: None, shadows=True, folder=folder)
        for name, blend in blends.items():
            with flight.quiet():
                seen = {way: relit.seen(blend, way, frame, folder) for way in WAYS}
            found[name] = {way: [relit.error(base, other, times) for times in (1, 4)] for way, other in seen.items()}
    for name, errors_of_colors in colors_under_suns(subject).items():
        found[name]["colors"] = errors_of_colors
    return found


def colors_under_suns(subject: Subject) -> dict[str, list[float]]:
    """Return FLIP at relit.SIZE and a quarter of it, by effort: the mean over the suns, by the metrics."""
    found: dict[str, list[list[float]]] = {name: [] for name in EFFORTS}
    for azimuth, height in relit.SUNS:
        flat = math.cos(height)
        sun = (math.cos(azimuth) * flat, math.sin(azimuth) * flat, math.sin(height))
        leaves = rendered(subject.base, [subject.base], relit.SIZE, SUN_SAMPLES, sun)
        for name in EFFORTS:
            shown = subject.level(f"{name}, with normals").level.foliage()
            level = rendered(subject.base, [shown], relit.SIZE, SUN_SAMPLES, sun)
            found[name].append([flip(smaller(leaves, times), smaller(level, times)) for times in (1, 4)])
    return {name: np.mean(errors, axis=0).tolist() for name, errors in found.items()}


def fly_past(subject: Subject) -> dict[str, Any]:
    """Measure the pop at each switch of a whole bake as bench/flight.py does, with the efforts off and long.

    Quality sets the distances, so a refined level takes over nearer. The leaves alone at the frames of `off` show how
    much two frames differ without any switch.
    """
    found: dict[str, Any] = {}
    for name in ("off", "long"):
        # Every level is kept, so that both bakes have the same switches.
        baked, camera = flight.stage(subject.tree, BakeSettings(refine=name, every_level=True))
        found[name] = pops(baked, camera)
        if name == "off":
            frames = flight.switches(baked, flight.FRAMES)
            flight.leaves_alone(baked)
            found["leaves"] = pops(baked, camera, frames)
    return found


def pops(baked: Baked, camera: bpy.types.Object, frames: Sequence[int] | None = None) -> list[dict[str, float]]:
    """Return the distance in R and the pop at each frame of a switch, by default at the switches of the bake."""
    frames = flight.switches(baked, flight.FRAMES) if frames is None else frames
    near = sorted({frame + i for frame in frames for i in range(-flight.AROUND, flight.AROUND + 2)})
    changes = flight.changes(flight.fly(baked, camera, near, flight.FRAMES), flight.FRAMES)
    away = flight.distances(flight.FRAMES)
    return [{"at": float(away[frame]), "pop": flight.pop(changes, frame)} for frame in frames]
