"""The licenses of all that is shipped: allowed, in THIRD_PARTY_LICENSES.txt, and inside the wheel and the packages.

The oracles are cargo's resolved graph, the manifests and license files of the crates themselves, and npm's and cargo's
lists of the files in a package.
"""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
import tomllib
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pytest

from tools.third_party import allowed, alternatives, entries_of, excerpt, plain

ROOT = Path(__file__).resolve().parents[2]
ENGINES = ROOT / "engines"
DOCUMENT = (ROOT / "THIRD_PARTY_LICENSES.txt").read_text(encoding="utf-8")
RULES = tomllib.loads((ROOT / "deny.toml").read_text())
FACTS = tomllib.loads((ROOT / "tools" / "third_party.toml").read_text())
# Crates that are published without the text of a license.
WITHOUT_TEXT = {
    "basis-universal",
    "basis-universal-sys",
    "meshopt",
    "plotters",
    "plotters-backend",
    "plotters-bitmap",
    "plotters-svg",
    "pulp-wasm-simd-flag",
}
NO_FACTS: dict[str, dict[str, str]] = {"copyrights": {}}


def run(*command: str, folder: Path = ROOT) -> str:
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True, timeout=280).stdout


@pytest.fixture(scope="module")
def metadata() -> dict[str, Any]:
    """Return cargo's resolved graph of the workspace, with the crates that tests use."""
    options = ["--format-version", "1", "--locked", "--filter-platform", "x86_64-unknown-linux-gnu"]
    graph: dict[str, Any] = json.loads(run("cargo", "metadata", *options))
    # flate2 names zlib-rs in a weak feature only. cargo metadata counts such a crate, but no build compiles it.
    graph["packages"] = [package for package in graph["packages"] if package["name"] != "zlib-rs"]
    return graph


@pytest.fixture(scope="module")
def linked(metadata: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the crates of others that the wheel's crate reaches without dependencies for builds and tests."""
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    waiting = [package["id"] for package in metadata["packages"] if package["name"] == "leafcloud-python"]
    reached: set[str] = set()
    while waiting:
        identity = waiting.pop()
        if identity not in reached:
            reached.add(identity)
            uses = nodes[identity]["deps"]
            waiting += [use["pkg"] for use in uses if any(kind["kind"] is None for kind in use["dep_kinds"])]
    return [package for package in metadata["packages"] if package["id"] in reached and package["source"]]


def listed() -> set[str]:
    """Return the names and versions in the list at the head of the document."""
    lines = DOCUMENT.partition("\n====")[0].splitlines()
    return {line.removeprefix("- ").rpartition(": ")[0] for line in lines if line.startswith("- ")}


def test_every_crate_has_an_allowed_license(metadata: dict[str, Any]) -> None:
    """`make deny` checks the same, and the crates for Bevy and for fuzzing; this test needs no cargo-deny."""
    crates = metadata["packages"]
    assert len(crates) > 100
    for crate in crates:
        for choices in alternatives(crate["license"]):
            assert set(choices) & set(allowed(RULES, crate["name"])), f"{crate['name']}: {crate['license']}"


@pytest.mark.parametrize(
    ("expression", "parts"),
    [
        ("MIT", [["MIT"]]),
        ("MIT/Apache-2.0", [["MIT", "Apache-2.0"]]),
        ("Apache-2.0 / MIT", [["Apache-2.0", "MIT"]]),
        ("(MIT OR Apache-2.0) AND Unicode-3.0", [["MIT", "Apache-2.0"], ["Unicode-3.0"]]),
        ("Apache-2.0 WITH LLVM-exception OR MIT", [["Apache-2.0 WITH LLVM-exception", "MIT"]]),
    ],
)
def test_parts_and_choices_of_a_license(expression: str, parts: list[list[str]]) -> None:
    assert alternatives(expression) == parts


def crate_in(folder: Path, license: str) -> dict[str, Any]:
    return {"name": "someone", "version": "1.0.0", "license": license, "manifest_path": str(folder / "Cargo.toml")}


def test_crate_under_another_license_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"someone 1\.0\.0 is under GPL-2\.0-only, which deny\.toml does not allow"):
        entries_of(crate_in(tmp_path, "GPL-2.0-only"), RULES, NO_FACTS)


def test_crate_without_the_text_of_its_license_is_refused(tmp_path: Path) -> None:
    (tmp_path / "LICENSE").write_text("../LICENSE")
    with pytest.raises(SystemExit, match=r"someone 1\.0\.0 has no text of MIT"):
        entries_of(crate_in(tmp_path, "MIT"), RULES, NO_FACTS)


def test_excerpt_removes_the_marks_of_a_comment() -> None:
    source = "int a;\n/*\n * Copyright Somebody\n *\n * All rights.\n */\n// Copyright Other\n// Rights.\n"
    assert excerpt(source, "Somebody", "rights.") == "Copyright Somebody\n\nAll rights."
    assert excerpt(source, "Other", "Rights.") == "Copyright Other\nRights."


def test_document_is_up_to_date() -> None:
    command = [sys.executable, "tools/third_party.py", "--check"]
    checked = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=280, check=False)
    assert checked.returncode == 0, checked.stderr


def test_document_names_exactly_the_crates_of_the_wheel(linked: list[dict[str, Any]]) -> None:
    parts = {part["name"] for part in FACTS["parts"]}
    assert listed() == parts | {f"{crate['name']} {crate['version']}" for crate in linked}


def test_document_names_the_crates_that_the_compiled_library_names() -> None:
    """Messages of panics hold the path of their source, such as registry/src/…/png-0.18.1/src/decoder.rs."""
    module = importlib.util.find_spec("leafcloud._native")
    assert module is not None
    assert module.origin is not None
    library = Path(module.origin).read_bytes()
    found = re.findall(rb"registry[/\\]src[/\\][^/\\]+[/\\]([\w-]+?)-(\d[^/\\]*)[/\\]", library)
    crates = {f"{name.decode()} {version.decode()}" for name, version in found}
    assert len(crates) >= 10
    assert crates <= listed()
    standard = next(name for name in listed() if name.startswith("Rust's standard library"))
    for name in set(re.findall(rb"/rust/deps/([\w-]+?)-\d", library)):
        assert name.decode() in standard


def test_document_has_a_license_file_of_every_crate(linked: list[dict[str, Any]]) -> None:
    texts = plain(DOCUMENT)
    without = set()
    for crate in linked:
        folder = Path(crate["manifest_path"]).parent
        files = [path for path in folder.iterdir() if "licen" in path.name.lower() and path.is_file()]
        own = [plain(path.read_text(encoding="utf-8")) for path in files]
        if not any(len(text) > 200 and text in texts for text in own):
            without.add(crate["name"])
        assert not list(folder.glob("NOTICE*")), f"{crate['name']} has a notice that must be shipped"
    assert without == WITHOUT_TEXT


def test_document_has_the_holders_of_copyrights_in_bundled_sources() -> None:
    """From the heads of the C++ files that the crates compile."""
    for holder in (
        "Arseny Kapoulkine",
        "Meta Platforms, Inc. and affiliates",
        "Bitstream, Inc.",
        "Tavmjong Bah",
        "Hao Hou",
        "Unicode, Inc.",
    ):
        assert holder in " ".join(DOCUMENT.split()), holder


def test_crates_that_hold_other_sources_or_fonts_are_known(linked: list[dict[str, Any]]) -> None:
    """A new crate with C, C++ or fonts inside needs its parts in tools/third_party.toml."""
    suffixes = {".c", ".cc", ".cpp", ".S", ".ttf", ".otf", ".a", ".so", ".dll"}
    holding = {
        crate["name"]
        for crate in linked
        if any(path.suffix in suffixes for path in Path(crate["manifest_path"]).parent.rglob("*"))
    }
    # Benchmarks and fonts for the tests of ttf-parser, which no build compiles.
    assert holding - {"ttf-parser"} == {part["crate"] for part in FACTS["parts"] if "crate" in part} - {"unicode-ident"}


def test_wheel_holds_the_licenses() -> None:
    files = distribution("leafcloud").files or []
    found = {path.name: path.read_text() for path in files if path.parent.name == "licenses"}
    for name in ("LICENSE-MIT", "LICENSE-APACHE", "THIRD_PARTY_LICENSES.txt"):
        assert found[name] == (ROOT / name).read_text(encoding="utf-8")
    declared = distribution("leafcloud").metadata.get_all("License-File") or []
    assert "THIRD_PARTY_LICENSES.txt" in declared


@pytest.mark.parametrize("engine", ["three", "babylon"])
def test_npm_package_holds_its_licenses(engine: str) -> None:
    (package,) = json.loads(run("npm", "pack", "--dry-run", "--json", "--ignore-scripts", folder=ENGINES / engine))
    assert {"LICENSE-MIT", "LICENSE-APACHE"} <= {file["path"] for file in package["files"]}


def test_bevy_crate_holds_its_licenses() -> None:
    files = run("cargo", "package", "--list", "--allow-dirty", folder=ENGINES / "bevy").splitlines()
    assert {"LICENSE-MIT", "LICENSE-APACHE"} <= set(files)


@pytest.mark.parametrize("engine", ["three", "babylon", "bevy"])
@pytest.mark.parametrize("name", ["LICENSE-MIT", "LICENSE-APACHE"])
def test_licenses_of_packages_are_those_of_the_project(engine: str, name: str) -> None:
    assert (ENGINES / engine / name).read_text() == (ROOT / name).read_text(), "run python tools/copy_laws.py"
