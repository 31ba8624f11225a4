"""The extension: the build, Blender's validation, and the installation in a separate Blender."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

INSTALL = """
import importlib.machinery, json, os, sys
import bpy
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
module = "bl_ext.user_default.leafcloud"
found = {
    "enabled": module in bpy.context.preferences.addons,
    "operator": "bake" in dir(bpy.ops.leafcloud) and bpy.ops.leafcloud.bake.get_rna_type().identifier,
}
unpacked = [path for path in sys.path if path.startswith(os.environ["BLENDER_USER_RESOURCES"])]
found["wheel"] = importlib.machinery.PathFinder.find_spec("leafcloud", unpacked) is not None
bpy.ops.preferences.addon_disable(module=module)
found["left"] = "bake" in dir(bpy.ops.leafcloud)
print("FOUND " + json.dumps(found), flush=True)
"""


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the zip from the add-on and the wheel of `make test`. Blender's tool validates it. Return its path."""
    wheels = list((ROOT / "target" / "checked").glob("leafcloud-*.whl"))
    assert len(wheels) == 1, "make test builds exactly one wheel"
    command = [sys.executable, "tools/build_extension.py", "--wheel", str(wheels[0])]
    out = tmp_path_factory.mktemp("extension")
    built = subprocess.run(
        [*command, "--out", str(out)], cwd=ROOT, check=True, capture_output=True, text=True, timeout=120
    )
    return Path(built.stdout.strip())


def test_archive_holds_all_licenses(archive: Path) -> None:
    with zipfile.ZipFile(archive) as zipped:
        found = {name: zipped.read(name) for name in zipped.namelist() if "LICENSE" in name}
        (wheel,) = (name for name in zipped.namelist() if name.endswith(".whl"))
        with zipfile.ZipFile(io.BytesIO(zipped.read(wheel))) as inner:
            bundled = [inner.read(name) for name in inner.namelist() if name.endswith("/THIRD_PARTY_LICENSES.txt")]
    third_party = (ROOT / "THIRD_PARTY_LICENSES.txt").read_bytes()
    assert found["THIRD_PARTY_LICENSES.txt"] == third_party
    assert bundled == [third_party]
    assert found["LICENSE-MIT"] == (ROOT / "LICENSE-MIT").read_bytes()
    assert found["LICENSE-APACHE"] == (ROOT / "LICENSE-APACHE").read_bytes()
    assert found["LICENSE"] == (ROOT / "addon" / "LICENSE").read_bytes()


def test_archive_holds_the_addon_the_wheel_and_the_licence(archive: Path) -> None:
    with zipfile.ZipFile(archive) as zipped:
        names = zipped.namelist()
        manifest = tomllib.loads(zipped.read("blender_manifest.toml").decode())
    sources = {path.relative_to(ROOT / "addon").as_posix() for path in (ROOT / "addon").rglob("*.py")}
    assert sources | {"blender_manifest.toml", "LICENSE"} <= set(names)
    assert [f"./{name}" for name in names if name.endswith(".whl")] == manifest["wheels"]
    assert len(manifest["platforms"]) == 1
    assert not [name for name in names if "__pycache__" in name]


def test_installed_extension_works(archive: Path, tmp_path: Path) -> None:
    """Enabling registers the operator and makes the wheel importable. Disabling removes the operator."""
    resources = tmp_path / "resources"
    resources.mkdir()
    result = subprocess.run(
        [sys.executable, "-c", INSTALL, str(archive)],
        cwd=tmp_path,
        env={**os.environ, "BLENDER_USER_RESOURCES": str(resources), "PYTHONPATH": ""},
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    found = json.loads(result.stdout.partition("FOUND ")[2].splitlines()[0])
    assert found["enabled"]
    assert found["wheel"]
    assert found["operator"] == "LEAFCLOUD_OT_bake"
    assert not found["left"]
