"""A Godot project with a baked tree and the add-on, and runs of a real Godot 4 in it (GODOT=command)."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = ROOT / "tests" / "godot"
ADDON = ROOT / "engines" / "godot" / "addons"
MEASURED = ROOT.parent / "shared" / "foliage" / "pine_cards_20k.glb"
TREE = MEASURED if MEASURED.is_file() else ROOT / "examples" / "shrub.glb"
GODOT = shlex.split(os.environ.get("GODOT", ""))

NEEDS_GODOT = [
    pytest.mark.skipif(not GODOT, reason="needs the environment variable GODOT, the command of a Godot 4.6"),
    pytest.mark.night,
]

RENDERERS = {"gl_compatibility": "Compatibility", "forward_plus": "Forward+", "mobile": "Forward Mobile"}
"""Godot's names of its renderers, in settings and when they start."""
DISPLAY = ["xvfb-run", "--auto-servernum", "--server-args=-screen 0 1280x1280x24"]

PROJECT = """config_version=5
[application]
config/name="test"
[editor_plugins]
enabled=PackedStringArray("res://addons/leafcloud/plugin.cfg")
[rendering]
renderer/rendering_method="gl_compatibility"
"""

PRESET = """[preset.0]
name="pack"
platform="Linux"
export_filter="all_resources"
include_filter=""
exclude_filter=""
export_path=""
[preset.0.options]
binary_format/architecture="x86_64"
texture_format/s3tc_bptc=true
"""


def godot(project: Path, *arguments: str) -> str:
    """Run Godot in the project. Return its output."""
    return checked([*GODOT, "--path", str(project), *arguments])


def checked(command: list[str]) -> str:
    """Run the command. Return its output, which must have no error of a script or a shader."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    except subprocess.TimeoutExpired as error:  # A script that fails does not quit.
        raise AssertionError(f"no end after 240 s: {error.stdout!r} {error.stderr!r}") from error
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    assert "SCRIPT ERROR" not in said, said
    assert "SHADER ERROR" not in said, said
    assert "Error compiling" not in said, said
    assert "ERROR: Bug" not in said, said
    return said


def window(renderer: str) -> list[str]:
    """Return the arguments for a window of 1080 × 1080 pixels."""
    driver = "opengl3" if renderer == "gl_compatibility" else "vulkan"
    renderers = ["--rendering-method", renderer, "--rendering-driver", driver]
    return [*renderers, "--audio-driver", "Dummy", "--resolution", "1080x1080"]


def run_script(project: Path, name: str, renderer: str = "gl_compatibility") -> Path:
    """Run one of the scripts in `SCRIPTS` in the project. Return the folder that it wrote into."""
    for script in SCRIPTS.glob("*.gd"):
        shutil.copy(script, project)
    return run_window(["--path", str(project)], name, project / "out" / renderer, renderer)


def run_window(game: list[str], name: str, out: Path, renderer: str = "gl_compatibility") -> Path:
    """Run a script of a game, a project or a pack, under Xvfb. Return the folder that it wrote into, `out`.

    Skips the test if the renderer does not start, as without a Vulkan driver.
    """
    out.mkdir(parents=True, exist_ok=True)
    said = checked([*DISPLAY, *GODOT, *game, *window(renderer), "--script", f"res://{name}", "--", str(out)])
    if f" - {RENDERERS[renderer]} - " not in said:
        pytest.skip(f"the renderer {RENDERERS[renderer]} does not start: Vulkan needs a driver, such as lavapipe")
    return out


def exported(project: Path, folder: Path) -> Path:
    """Export the project as a pack, alone in a new folder: a game without its program, which templates would have."""
    (project / "export_presets.cfg").write_text(PRESET)
    folder.mkdir()
    pack = folder / "game.pck"
    godot(project, "--headless", "--export-pack", "pack", str(pack))
    return pack


def project_with(folder: Path, trees: list[Path], *settings: str) -> Path:
    """Bake trees for Godot, and copy the file and the add-on into a new project: nothing else."""
    baked = folder / "baked"
    command = [sys.executable, str(ROOT / "bake.py"), "--input", *map(str, trees), "--out", str(baked)]
    subprocess.run([*command, "--engine", "godot", *settings], check=True, capture_output=True, timeout=240)
    project = folder / "project"
    project.mkdir()
    (project / "project.godot").write_text(PROJECT)
    shutil.copytree(ADDON, project / "addons")
    shutil.copy(baked / f"{'_'.join(tree.stem for tree in trees)}.glb", project / "tree.glb")
    godot(project, "--headless", "--import")
    return project


def codes(path: Path) -> NDArray[np.uint8]:
    """Return the pixels (h, w, 4)."""
    return np.asarray(Image.open(path).convert("RGBA"), np.uint8)


def colors(path: Path) -> NDArray[np.float64]:
    """Return the pixels (h, w, 3) in [0, 1]."""
    return codes(path)[..., :3] / 255.0


def seen(picture: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where (h, w) the picture differs from the background in its corner."""
    return np.asarray(np.abs(picture - picture[0, 0]).max(axis=-1) > 0.02)
