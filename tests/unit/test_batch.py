"""Batches of bakes: skipped trees, limits, signals, and files left behind.

Most tests run a small program in place of `bake.py`, with its command line, files and exit statuses.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from studio import PROGRAM, Studio

from leafcloud.batch.command import main
from leafcloud.batch.trees import files_of, find_trees


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path)


def test_a_tree_that_fails_stops_no_other(studio: Studio, capsys: pytest.CaptureFixture[str]) -> None:
    for name, words in (("ash", ""), ("beech", "refused"), ("elm", "crash"), ("fir", "")):
        studio.add(name, words)
    assert studio.run("--processes", 2, "--", "--levels", 2) == 1
    reasons = {name: row["reason"] for name, row in studio.rows.items()}
    assert reasons["ash"] == reasons["fir"] == ""
    assert reasons["beech"] == "the tree has no leaves: add some"
    assert "SIGABRT" in reasons["elm"]
    assert (studio.out / "ash" / "tree.glb").read_text().endswith("--levels 2")
    page = (studio.out / "index.html").read_text()
    assert "add some" in page
    assert "&lt;thin&gt; leaves" in page
    said = capsys.readouterr()
    assert "2 of 4 trees are baked" in said.out
    assert "elm: failed" in said.err


def test_unchanged_trees_are_skipped(studio: Studio) -> None:
    """A change is another content, flag or program, or a lost result; another time of the file is none."""
    ash = studio.add("ash")
    studio.add("fir")
    assert studio.run() == 0
    assert sorted(studio.calls) == ["ash", "fir"]
    os.utime(ash, (1, 1))
    assert studio.run() == 0
    assert len(studio.calls) == 2
    assert {row["skipped"] for row in studio.rows.values()} == {True}
    assert studio.rows["ash"]["warnings"] == ["<thin> leaves"]

    def baked_again() -> list[str]:
        before = len(studio.calls)
        assert studio.run(*more) == 0
        return sorted(studio.calls[before:])

    more: tuple[str, ...] = ()
    ash.write_text("changed")
    assert baked_again() == ["ash"]
    (studio.out / "fir" / "tree.glb").unlink()
    assert baked_again() == ["fir"]
    (studio.out / "fir" / "tree.glb").write_text("cut")
    assert baked_again() == ["fir"]
    more = ("--", "--levels", "1")
    assert baked_again() == ["ash", "fir"]
    studio.program.write_text(PROGRAM + "# changed\n")
    assert baked_again() == ["ash", "fir"]
    more = ("--again", "--", "--levels", "1")
    assert baked_again() == ["ash", "fir"]


def test_failed_trees_are_baked_again(studio: Studio) -> None:
    studio.add("ash", "refused")
    assert studio.run() == 1
    assert studio.run() == 1
    assert studio.calls == ["ash", "ash"]


@pytest.mark.parametrize(
    ("words", "limit", "reason"),
    [
        ("slow litter", ("--minutes", 0.02), "not done after 0.02 minutes"),
        ("large", ("--memory", 0.2), "0.2 GiB of memory"),
    ],
)
def test_limits_end_a_bake(studio: Studio, words: str, limit: tuple[str, float], reason: str) -> None:
    studio.add("ash", words)
    studio.add("fir")
    assert studio.run(*limit) == 1
    assert reason in studio.rows["ash"]["reason"]
    assert studio.rows["fir"]["reason"] == ""
    assert list((studio.out / "ash").iterdir()) == [], "nothing is left behind"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_batch_goes_on_where_it_was(studio: Studio, number: signal.Signals) -> None:
    studio.add("ash")
    slow = studio.add("elm", "slow")
    studio.add("fir")
    command = [sys.executable, "-m", "leafcloud.batch.command", *studio.arguments("--processes", 1)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while "elm" not in studio.calls:
            time.sleep(0.05)
            assert process.poll() is None
        process.send_signal(number)
        _, said = process.communicate(timeout=30)
    assert process.returncode == 128 + number, said
    assert "stopped; 2 trees are left" in said
    assert studio.calls == ["ash", "elm"]
    slow.write_text("")
    assert studio.run() == 0
    assert studio.calls[2:] == ["elm", "fir"]


def test_wrong_command_lines_are_told(studio: Studio, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    studio.add("ash")
    for more, words in (
        (("--minutes", 0), "--minutes is 0.0; it must be above 0"),
        (("--processes", -1), "--processes is -1"),
        (("--", "--out", "x"), "--out is set for each tree"),
    ):
        assert studio.run(*more) == 2
        assert words in capsys.readouterr().err
    assert main([str(tmp_path / "none"), "--out", str(studio.out)]) == 2
    assert "does not exist" in capsys.readouterr().err
    empty = tmp_path / "empty"
    empty.mkdir()
    assert main([str(empty), "--out", str(studio.out)]) == 2
    assert "has no trees" in capsys.readouterr().err
    assert not studio.out.exists()


def test_a_program_that_cannot_start_fails_each_tree(studio: Studio) -> None:
    studio.add("ash")
    assert main([str(studio.trees), "--out", str(studio.out), "--bake", "/no/blender -b"]) == 1
    assert "/no/blender cannot be started" in studio.rows["ash"]["reason"]


def test_names_are_folders_of_their_own(tmp_path: Path) -> None:
    for name in ("a/oak.glb", "b/oak.obj", "b/Oak.blend", "b/oak_2.glb", "b/notes.txt"):
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text("")
    found = {
        tree.file.relative_to(tmp_path).as_posix(): tree.name
        for tree in find_trees([tmp_path, tmp_path / "a/oak.glb"], tmp_path / "out")
    }
    assert found.keys() == {"a/oak.glb", "b/oak.obj", "b/Oak.blend", "b/oak_2.glb"}
    assert len({name.casefold() for name in found.values()}) == 4
    assert found["a/oak.glb"] == "oak"


def test_files_that_a_tree_names_count(tmp_path: Path) -> None:
    """But none outside of its folder, and none that does not exist."""
    names = ("tree.bin", "leaf image.png", "tree.mtl", "bark.png")
    for name in names:
        (tmp_path / name).write_text("x")
    (tmp_path.parent / "outside.bin").write_text("x")
    uris = ["tree.bin", "leaf%20image.png", "../outside.bin", "missing.bin", "data:,x", None]
    (tmp_path / "tree.gltf").write_text(json.dumps({"buffers": [{"uri": uri} for uri in uris], "images": 3}))
    (tmp_path / "tree.obj").write_text("mtllib tree.mtl\nv 0 0 0\n")
    (tmp_path / "tree.mtl").write_text("newmtl bark\nmap_Kd -s 1 1 1 bark.png\n")

    def named(name: str) -> set[str]:
        return {file.name for file in files_of(tmp_path / name)}

    assert named("tree.gltf") == {"tree.gltf", "tree.bin", "leaf image.png"}
    assert named("tree.obj") == {"tree.obj", "tree.mtl", "bark.png"}
    (tmp_path / "bad.gltf").write_text("[" * 100_000)
    assert named("bad.gltf") == {"bad.gltf"}


def test_results_are_no_trees_and_trees_no_results(studio: Studio, capsys: pytest.CaptureFixture[str]) -> None:
    """A batch may write below its trees. It refuses to write where one of them lies."""
    studio.out = studio.trees / "levels"
    studio.add("ash")
    assert studio.run() == studio.run() == 0
    assert studio.rows.keys() == {"ash"}
    (studio.trees / "oak").mkdir()
    oak = studio.add("oak/oak")
    studio.out = studio.trees
    assert studio.run() == 2
    assert "lies where results are written" in capsys.readouterr().err
    assert oak.read_text() == ""


def test_a_complete_commit_of_a_killed_bake_stays_for_the_next_one(tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    studio.add("ash", "refused")
    for name, files in (("a", ()), ("b", ("leafcloud-commit.json",))):
        folder = studio.out / "ash" / f".leafcloud-{name}"
        folder.mkdir(parents=True)
        for file in files:
            (folder / file).write_text("{}")
    (studio.out / "ash" / "batch.json").write_text("{}")
    assert studio.run() == 1
    assert sorted(each.name for each in (studio.out / "ash").iterdir()) == [".leafcloud-b", "batch.json"]


def test_lists_of_files_are_read_in_time(tmp_path: Path) -> None:
    """In quadratic time they would take hours."""
    (tmp_path / "tree.obj").write_text("mtllib tree.mtl\n")
    (tmp_path / "tree.mtl").write_text("\n" * 1_000_000 + "map_Kd\nnewmtl foo\n" + "map_Kd -s " * 10_000)
    assert len(files_of(tmp_path / "tree.obj")) == 2


def test_wrong_flags_stop_the_batch_and_lose_nothing(studio: Studio, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("ash", "elm", "fir", "oak"):
        studio.add(name)
    assert studio.run("--", "--levels", 1) == 0
    page = (studio.out / "index.html").read_text()
    assert studio.run("--processes", 1, "--", "--wrong") == 2
    assert "the flags behind -- are wrong: error: unrecognized arguments: --wrong" in capsys.readouterr().err
    assert len(studio.calls) < 8, "it does not try all trees"
    assert (studio.out / "index.html").read_text() == page
    assert studio.run("--", "--levels", 1) == 0
    assert {row["skipped"] for row in studio.rows.values()} == {True}


@pytest.mark.parametrize(
    "streams", ["2>&-", ">&-", "<&- >&- 2>&-", ">/dev/full", "2>/dev/full", "> >(true)", "2> >(true)"]
)
def test_a_batch_bakes_all_trees_though_nobody_reads_its_messages(streams: str, studio: Studio) -> None:
    for name in ("ash", "elm", "fir"):
        studio.add(name)
    command = ["bash", "-c", f'exec "$@" {streams}', "bash", sys.executable, "-m", "leafcloud.batch.command"]
    done = subprocess.run([*command, *studio.arguments()], capture_output=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert sorted(studio.rows) == ["ash", "elm", "fir"]
    assert b"Traceback" not in done.stderr


def test_the_folder_of_another_bake_stays(studio: Studio) -> None:
    """A bake locks its folder as long as it lives."""
    fcntl = pytest.importorskip("fcntl")
    studio.add("ash", "litter")
    other = studio.out / "ash" / ".leafcloud-other"
    other.mkdir(parents=True)
    descriptor = os.open(other, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        studio.run()
    finally:
        os.close(descriptor)
    assert [each.name for each in (studio.out / "ash").glob(".leafcloud-*")] == [".leafcloud-other"]
