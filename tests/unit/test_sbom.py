"""The bill of materials fits the schema of CycloneDX, and agrees with the wheel, its list of licenses, and npm."""

from __future__ import annotations

import json
import subprocess
from importlib.metadata import distribution, requires
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
PYTHON = ROOT / ".venv-supply" / "bin" / "python"

VALIDATE = """
import sys
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
error = JsonStrictValidator(SchemaVersion.V1_6).validate_str(open(sys.argv[1], encoding="utf-8").read())
sys.exit(str(error) if error else 0)
"""


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=280, check=False)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the path of a bill that tools/sbom.py writes."""
    assert PYTHON.exists(), "run `make .venv-supply/.installed` (make test does) first"
    out = tmp_path_factory.mktemp("sbom") / "new" / "leafcloud.cdx.json"
    made = run(PYTHON, "tools/sbom.py", "--out", out)
    assert made.returncode == 0, made.stderr
    return out


@pytest.fixture(scope="module")
def bill(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text())


@pytest.fixture(scope="module")
def components(bill: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the components by their package URLs, or by their names."""
    return {entry.get("purl", entry["name"]): entry for entry in bill["components"]}


def license_of(entry: dict[str, Any]) -> str:
    (found,) = entry["licenses"]
    return found.get("expression") or found["license"]["id"]


def test_bill_fits_the_schema(path: Path, bill: dict[str, Any], tmp_path: Path) -> None:
    assert bill["bomFormat"] == "CycloneDX"
    assert run(PYTHON, "-c", VALIDATE, path).returncode == 0
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps({**bill, "components": [{"type": "library"}]}))
    assert run(PYTHON, "-c", VALIDATE, broken).returncode != 0, "the validator accepts a component without a name"


def test_crates_are_those_that_maturin_writes_into_the_wheel(components: dict[str, dict[str, Any]]) -> None:
    """Maturin's list has more: crates for builds, and crates for platforms without wheels."""
    files = distribution("leafcloud").files or []
    (own,) = [file for file in files if file.parent.name == "sboms"]
    listed = {(entry["name"], entry["version"]): entry for entry in json.loads(own.read_text())["components"]}
    crates = [entry for url, entry in components.items() if url.startswith("pkg:cargo/") and "hashes" in entry]
    assert len(crates) >= 80
    for crate in crates:
        known = listed[crate["name"], crate["version"]]
        assert crate["hashes"] == known["hashes"]
        assert license_of(crate) == known["licenses"][0]["expression"]
        assert known["scope"] == "required"


def test_every_project_in_the_list_of_licenses_is_a_component(components: dict[str, dict[str, Any]]) -> None:
    head = (ROOT / "THIRD_PARTY_LICENSES.txt").read_text().partition("\n====")[0]
    names = {line.removeprefix("- ").rpartition(": ")[0] for line in head.splitlines() if line.startswith("- ")}
    found = {
        f"{entry['name']} {entry['version']}" if "version" in entry else entry["name"] for entry in components.values()
    }
    assert len(names) > 80
    assert names <= found


def test_needs_of_the_wheel_are_those_of_its_metadata(components: dict[str, dict[str, Any]]) -> None:
    needs = [Requirement(text) for text in requires("leafcloud") or []]
    assert needs
    found = {url.removeprefix("pkg:pypi/"): entry for url, entry in components.items() if url.startswith("pkg:pypi/")}
    assert set(found) == {need.name for need in needs} | {f"leafcloud@{distribution('leafcloud').version}"}
    for need in needs:
        assert found[need.name]["properties"][0]["value"] == str(need.specifier)
        assert found[need.name]["scope"] == ("optional" if need.marker else "required")


@pytest.mark.parametrize("engine", ["three", "babylon"])
def test_npm_packages_are_listed_with_their_needs(
    engine: str, bill: dict[str, Any], components: dict[str, dict[str, Any]]
) -> None:
    package = json.loads((ROOT / "engines" / engine / "package.json").read_text())
    shipped = components[f"pkg:npm/{package['name']}@{package['version']}"]
    assert license_of(shipped) == package["license"]
    uses = next(entry["dependsOn"] for entry in bill["dependencies"] if entry["ref"] == shipped["bom-ref"])
    assert {f"npm:{name}" for name in package["peerDependencies"]} == set(uses)


def test_root_depends_on_all_that_is_shipped(bill: dict[str, Any]) -> None:
    root = bill["metadata"]["component"]["bom-ref"]
    uses = next(entry["dependsOn"] for entry in bill["dependencies"] if entry["ref"] == root)
    names = {ref.partition(":")[2].partition("@")[0] for ref in uses}
    assert names == {
        "leafcloud",
        "leafcloud-extension",
        "leafcloud-three",
        "leafcloud-babylon",
        "leafcloud-godot",
        "leafcloud-bevy",
    }


def test_bill_has_no_path_of_this_machine(path: Path) -> None:
    assert str(ROOT) not in path.read_text()
    assert str(Path.home()) not in path.read_text()
