"""Files of bakes that have the same bytes: one test for each claim of docs/decisions/reproducibility.md."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from glb import read_chunks

pytestmark = pytest.mark.night

ROOT = Path(__file__).resolve().parents[2]
FLAGS = ("--texture-size", "128", "--epsilon", "0.1", "--every-level", "--engine", "three", "--compress")
OLD_PROCESSOR = "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA,-FMA4,-BMI2"
"""Tells the C library that the processor has no wide vectors and no fused multiplication."""
CORE = """
import hashlib, sys, leafcloud
foliage = leafcloud.read_gltf(sys.argv[1])
options = {"levels": 1, "texture_size": 128, "normals": 0.5, "orm": True, "occlusion": True, "epsilon": 0.1}
chain = leafcloud.build_chain(foliage, **options)
arrays = [a for each in chain.clouds for a in (each.corners, each.targets, each.base_color, each.normal, each.orm)]
print(hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest())
"""

Bakes = Callable[..., Path]

on_x86_64_linux = pytest.mark.skipif(
    platform.machine() != "x86_64" or sys.platform != "linux", reason="names features of x86-64"
)


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory, shrub: Path) -> Bakes:
    """``baked(python, **environment)``: the folder of a bake of the small tree. The same arguments bake once."""
    folders: dict[tuple[object, ...], Path] = {}

    def bake(python: Path = Path(sys.executable), **environment: str) -> Path:
        key = (python, *sorted(environment.items()))
        if key not in folders:
            out = tmp_path_factory.mktemp("bake") / "out"
            command = [python, ROOT / "bake.py", "--input", shrub, "--out", out, *FLAGS]
            subprocess.run(command, check=True, timeout=280, env={**os.environ, **environment}, capture_output=True)
            folders[key] = out
        return folders[key]

    return bake


def hashes(folder: Path, *kinds: str) -> dict[str, str]:
    """Return the hash of each file of these kinds by its name. There must be some of each kind."""
    files = {kind: sorted(folder.glob(f"*{kind}")) for kind in kinds}
    assert all(files.values())
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for found in files.values() for file in found}


def without_seconds(value: Any) -> Any:
    """Return a value of JSON without all members of the name "seconds"."""
    if isinstance(value, dict):
        return {name: without_seconds(each) for name, each in value.items() if name != "seconds"}
    return [without_seconds(each) for each in value] if isinstance(value, list) else value


def report(folder: Path) -> Any:
    return without_seconds(json.loads((folder / "report.json").read_text(encoding="utf-8")))


def images_of(file: Path) -> dict[str, str]:
    """Return the hash of each named image in a GLB file."""
    document, binary = read_chunks(file)
    found = {}
    for image in document["images"]:
        view = document["bufferViews"][image["bufferView"]]
        start = view.get("byteOffset", 0)
        if "name" in image:
            found[image["name"]] = hashlib.sha256(binary[start : start + view["byteLength"]]).hexdigest()
    return found


@pytest.mark.parametrize("threads", ["1", "16"])
def test_models_textures_and_pictures_depend_on_no_number_of_threads(baked: Bakes, threads: str) -> None:
    """The models contain the textures as PNG and as KTX2."""
    assert hashes(baked(RAYON_NUM_THREADS=threads), ".glb", ".png") == hashes(baked(), ".glb", ".png")


@pytest.mark.parametrize("threads", ["1", "16"])
def test_reports_differ_in_seconds_only(baked: Bakes, threads: str) -> None:
    assert report(baked(RAYON_NUM_THREADS=threads)) == report(baked())


@on_x86_64_linux
def test_models_textures_and_pictures_depend_on_no_vectors_of_the_c_library(baked: Bakes) -> None:
    assert hashes(baked(GLIBC_TUNABLES=OLD_PROCESSOR), ".glb", ".png") == hashes(baked(), ".glb", ".png")


@on_x86_64_linux
def test_reports_depend_on_no_vectors_of_the_c_library(baked: Bakes) -> None:
    assert report(baked(GLIBC_TUNABLES=OLD_PROCESSOR)) == report(baked())


@pytest.mark.skipif(shutil.which("qemu-x86_64") is None, reason="needs qemu-x86_64 (Debian: qemu-user)")
@pytest.mark.parametrize("processor", ["SandyBridge", "Haswell"])
def test_levels_depend_on_no_processor(shrub: Path, processor: str) -> None:
    python = Path(sys.executable)
    emulated = ["qemu-x86_64", "-cpu", processor, "-0", str(python), str(python.resolve())]
    here, there = (
        subprocess.run([*start, "-c", CORE, shrub], check=True, timeout=280, capture_output=True, text=True).stdout
        for start in ([str(python)], emulated)
    )
    assert here == there


@pytest.mark.night
def test_textures_are_the_same_in_blender_4_5_and_5_0(baked: Bakes) -> None:
    other = ROOT / ".venv-5.0" / "bin" / "python"
    if not other.exists():
        pytest.skip("needs .venv-5.0: make environments")
    assert images_of(baked(other) / "shrub.glb") == images_of(baked() / "shrub.glb")


@pytest.mark.night
def test_colors_are_the_same_in_blender_4_2(baked: Bakes) -> None:
    """Its importer makes other normals."""
    other = ROOT / ".venv-4.2" / "bin" / "python"
    if not other.exists():
        pytest.skip("needs .venv-4.2: make environments")
    here, there = (images_of(folder / "shrub.glb") for folder in (baked(), baked(other)))
    assert here.keys() == there.keys()
    colors = [name for name in here if not name.endswith("_normal")]
    assert {name: there[name] for name in colors} == {name: here[name] for name in colors}
