"""Draws the picture of a forest for docs/engines.md in three.js: `make docs`.

usage: python tools/forest_picture.py PINE.glb OUT.png
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT)]
from engine_views import code_of, levels_of, pictures, sphere_of  # noqa: E402

COUNT = 1000
SIDE = 1024
LIGHT = """
scene.background = new THREE.Color(0xdfe7ee);
scene.children[0].intensity = 0.9;
const sun = new THREE.DirectionalLight(0xfff4e0, 2.5);
sun.position.set(0.6, 1.2, 0.8);
const ground = new THREE.Mesh(new THREE.CircleGeometry(1e5, 64), new THREE.MeshLambertMaterial({ color: 0x9aa583 }));
ground.rotation.x = -Math.PI / 2;
scene.add(sun, ground);
"""


def places(step: float) -> list[list[float]]:
    """Return matrices, as rows: trees on a spiral, turned and scaled at random."""
    random = np.random.default_rng(4)
    found = []
    for i in range(COUNT):
        turn, scale = random.uniform(0.0, 2.0 * math.pi), random.uniform(0.75, 1.25)
        x, z = step * math.sqrt(i + 4) * np.array([math.cos(2.4 * i), math.sin(2.4 * i)])
        c, s = scale * math.cos(turn), scale * math.sin(turn)
        found.append([c, 0.0, s, x, 0.0, scale, 0.0, 0.0, -s, 0.0, c, z, 0.0, 0.0, 0.0, 1.0])
    return found


def main() -> None:
    tree, out = map(Path, sys.argv[1:])
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(ROOT / "bake.py"), "--input", str(tree), "--out", folder, "--engine", "three"]
        subprocess.run(command, check=True)
        file = Path(folder) / f"{tree.stem}.glb"
        centre, radius = sphere_of(levels_of(file)[0])
        eye = centre + radius * np.array([0.0, 5.0, 30.0])
        view = {"eye": eye.tolist(), "target": [0.0, 0.0, 0.0], "fov": 45.0}
        code = code_of("three", 1) + LIGHT
        [picture] = pictures("three", file, code=code, places=places(1.6 * radius), views=[view], side=SIDE)
    top = SIDE // 5
    shown = Image.fromarray(picture["pixels"][top : top + SIDE // 2, :, :3].astype(np.uint8))
    shown.resize((SIDE * 3 // 4, SIDE * 3 // 8)).quantize(96).save(out, optimize=True)


if __name__ == "__main__":
    main()
