"""Refusals of the command line: one line, an exit status, and an unchanged folder."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import bpy
import pytest
from command_line import BAKE, QUICK, refusal, run, run_apart, saved


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--epsilon", "0"], ["--epsilon", "0.0", "from 1e-09"]),
        (["--epsilon", "-1"], ["--epsilon", "-1.0", "from 1e-09"]),
        (["--candidates", "0"], ["--candidates", "0", "from 1"]),
        (["--levels", "two"], ["--levels", "'two'", "from 1", "--help"]),
        (["--min-visibility", "0.5"], ["--min-visibility", "0.5", "0.1"]),
        (["--effects", "glitter"], ["--effects", "'glitter'", "transitions"]),
        (["--engine", "quake"], ["--engine", "'quake'", "godot"]),
        (["--frobnicate"], ["--frobnicate", "--help"]),
        (["--texture-size", "32"], ["--texture-size", "32", "from 64"]),
        (["--json"], ["--json", "--plan-only"]),
    ],
)
def test_a_wrong_command_line_is_refused(arguments: list[str], words: list[str], shrub: Path, tmp_path: Path) -> None:
    line = refusal(tmp_path / "out", "--input", shrub, *arguments)
    assert all(word in line for word in words), line


def test_a_bake_without_a_folder_is_refused(shrub: Path) -> None:
    done = run_apart("--input", shrub)
    assert (done.returncode, done.stderr) == (
        2,
        "bake.py: --out DIR is missing: name the output folder\n",
    )


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("leafcloud", "the module leafcloud is missing: run `make setup`"),
        ("bpy", "has no module bpy: run `make setup`"),
    ],
)
def test_a_missing_module_is_refused(module: str, words: str, shrub: Path, tmp_path: Path) -> None:
    without = (
        f"import runpy, sys; sys.modules[{module!r}] = None; sys.argv[0] = {str(BAKE)!r}; "
        "runpy.run_path(sys.argv[0], run_name='__main__')"
    )
    command = [sys.executable, "-c", without, "--input", str(shrub), "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert words in done.stderr


def test_an_empty_folder_name_is_no_folder(shrub: Path) -> None:
    done = run("--input", shrub, "--out", "")
    assert done.returncode == 2
    assert "--out" in done.stderr


def leaf_object(positions: list[tuple[float, float, float]], faces: list[tuple[int, ...]]) -> bpy.types.Object:
    mesh = bpy.data.meshes.new("leaves")
    mesh.from_pydata(positions, [], faces)
    obj = bpy.data.objects.new("leaves", mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    assert "nothing.glb" in refusal(tmp_path / "out", "--input", tmp_path / "nothing.glb")


def test_a_file_that_is_no_scene_is_refused(tmp_path: Path) -> None:
    for name in ("tree.fbx", "tree.glb", "tree.blend"):
        (tmp_path / name).write_text("no tree")
        assert name in refusal(tmp_path / "out", "--input", tmp_path / name)


def test_an_empty_scene_is_refused(tmp_path: Path) -> None:
    assert "there are no faces" in refusal(tmp_path / "out", "--input", saved(tmp_path / "empty.blend"))


def test_leaves_that_are_not_there_are_refused(shrub: Path, tmp_path: Path) -> None:
    line = refusal(tmp_path / "out", "--input", shrub, "--leaves", "petals")
    assert "'petals'" in line
    assert "branches" in line, "the message names the objects of the scene"


def test_a_mesh_without_faces_is_refused(tmp_path: Path) -> None:
    leaf_object([(0, 0, 0), (1, 0, 0)], [])
    assert "'leaves' has no faces" in refusal(tmp_path / "out", "--input", saved(tmp_path / "bare.blend"))


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_coordinates_that_are_not_finite_are_refused(value: float, tmp_path: Path) -> None:
    obj = leaf_object([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    obj.data.vertices.foreach_set("co", [0, 0, 0, 1, 0, value, 0, 1, 0])
    assert "finite" in refusal(tmp_path / "out", "--input", saved(tmp_path / "broken.blend"))


def test_triangles_without_area_are_refused(tmp_path: Path) -> None:
    leaf_object([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)])
    assert "area" in refusal(tmp_path / "out", "--input", saved(tmp_path / "flat.blend"))


def test_a_missing_texture_is_refused(shrub: Path, tmp_path: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    (image,) = (
        image for image in bpy.data.objects["leaves"].active_material.node_tree.nodes if image.type == "TEX_IMAGE"
    )
    image.image.unpack(method="REMOVE")
    image.image.filepath = "//gone.png"
    assert "gone.png" in refusal(tmp_path / "out", "--input", saved(tmp_path / "untextured.blend"))


def test_a_folder_that_cannot_be_made_is_refused(shrub: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    line = refusal(tmp_path / "file" / "out", "--input", shrub)
    assert str(tmp_path / "file" / "out") in line
    assert "--out" in line


def test_a_folder_that_is_full_is_refused_and_left_as_it_was(shrub: Path, tmp_path: Path) -> None:
    """A limit on file sizes stands in for a full disk."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.json").write_text("of an earlier bake")
    limited = (
        "import resource, runpy, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000)); "
        f"sys.argv[0] = {str(BAKE)!r}; runpy.run_path(sys.argv[0], run_name='__main__')"
    )
    command = [
        sys.executable,
        "-c",
        limited,
        "--input",
        str(shrub),
        "--out",
        str(out),
        *QUICK,
        "--levels",
        "1",
        "--last",
        "cross",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 1
    *progress, line = done.stderr.splitlines()
    assert all(stage.endswith("…") for stage in progress)
    assert line.startswith(f"bake.py: cannot write to {out}: shrub")
    assert ".glb: File too large; " in line
    assert [file.name for file in out.iterdir()] == ["report.json"]
    assert (out / "report.json").read_text() == "of an earlier bake"


@pytest.mark.parametrize("source", ["tree.glb", "tree.blend", "Tree.GLB", "tree_LOD0.glb"])
def test_a_bake_does_not_replace_its_input(source: str, shrub: Path, tmp_path: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    file = tmp_path / source
    if source.endswith(".blend"):
        saved(file)
    else:
        file.write_bytes(shrub.read_bytes())
    before = file.read_bytes()
    out = tmp_path / "link"
    out.symlink_to(tmp_path, target_is_directory=True)
    done = run("--input", file, "--out", out, *QUICK)
    assert done.returncode == 1
    assert f"would replace {file}" in done.stderr
    assert [each for each in tmp_path.iterdir() if each not in (file, out)] == []
    assert file.read_bytes() == before


def test_a_bake_does_not_replace_the_target_of_a_link(shrub: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    file = tmp_path / "out" / "tree.glb"
    file.write_bytes(shrub.read_bytes())
    (tmp_path / "tree.glb").symlink_to(file)
    done = run("--input", tmp_path / "tree.glb", "--out", tmp_path / "out", *QUICK)
    assert done.returncode == 1
    assert "would replace" in done.stderr
    assert file.read_bytes() == shrub.read_bytes()


def test_another_file_beside_the_results_is_baked(shrub: Path, tmp_path: Path) -> None:
    file = tmp_path / "old tree.glb"
    file.write_bytes(shrub.read_bytes())
    (tmp_path / "out").mkdir()
    assert run("--input", file, "--out", tmp_path / "out", *QUICK, "--levels", 1).returncode == 0


@pytest.mark.night
def test_a_name_that_is_no_utf_8_is_baked(shrub: Path, tmp_path: Path) -> None:
    file = tmp_path / "b\udce4um.glb"
    file.write_bytes(shrub.read_bytes())
    done = run_apart("--input", file, "--out", tmp_path / "bl\udce4tter", *QUICK, "--levels", 1)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "bl\udce4tter" / "b_um.glb").is_file()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit the address space")
def test_too_little_memory_for_blender_is_told(shrub: Path, tmp_path: Path) -> None:
    command = ["bash", "-c", 'ulimit -v 300000; exec "$@"', "bash", sys.executable, BAKE, "--input", shrub]
    done = subprocess.run(
        [str(each) for each in (*command, "--out", tmp_path / "out")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stderr.startswith("bake.py: the module bpy cannot be loaded: ")
    assert done.stderr.count("\n") == 1
