"""Builds the Blender extension with Blender's own tool: add-on, wheel, laws, sample tree and licenses in one zip.

    python tools/build_extension.py --wheel target/wheels/leafcloud-….whl --out dist

Needs a Python with the bpy wheel, and prints the zip's path. The add-on's manifest in the repository lists no wheel,
because a wheel is for one platform; the copy in the zip lists the given wheel and its platform.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ADDON, SAMPLE = ROOT / "addon", ROOT / "examples" / "shrub.glb"
# Licenses of what the wheel holds, and of the wheel and the laws. The add-on's own license is in its folder.
LICENSES = [ROOT / name for name in ("THIRD_PARTY_LICENSES.txt", "LICENSE-MIT", "LICENSE-APACHE")]

# Blender's name of a platform by start and end of a wheel's platform tag.
PLATFORMS = {
    ("manylinux", "x86_64"): "linux-x64",
    ("manylinux", "aarch64"): "linux-arm64",
    ("linux", "x86_64"): "linux-x64",
    ("linux", "aarch64"): "linux-arm64",
    ("macosx", "x86_64"): "macos-x64",
    ("macosx", "arm64"): "macos-arm64",
    ("win", "amd64"): "windows-x64",
    ("win", "arm64"): "windows-arm64",
}


def blender_platform(wheel: Path) -> str:
    """Return Blender's name of the platform of `wheel`. Exit with a message if it is unknown."""
    tag = wheel.stem.split("-")[-1]
    for (system, machine), platform in PLATFORMS.items():
        if tag.startswith(system) and tag.endswith(machine):
            return platform
    sys.exit(f"{wheel.name}: Blender has no platform for the tag {tag!r}; known: {sorted(set(PLATFORMS.values()))}.")


def extension_tool() -> Path:
    """Return the path of `blender_ext.py`, the command-line tool for extensions inside the bpy wheel."""
    spec = importlib.util.find_spec("bpy")
    if spec is None or spec.origin is None:
        sys.exit(f"{sys.executable} has no bpy: run this with .venv/bin/python, which `make setup` makes.")
    tools = list(Path(spec.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    if len(tools) != 1:
        sys.exit(f"Expected one blender_ext.py below {Path(spec.origin).parent}, found {len(tools)}.")
    return tools[0]


def with_wheel(manifest: str, wheel: Path) -> str:
    """Return the text of the manifest with wheel and platform added before the first table."""
    head, bracket, tables = manifest.partition("\n[")
    entries = {"platforms": [blender_platform(wheel)], "wheels": [f"./wheels/{wheel.name}"]}
    # A JSON list of plain strings is a TOML list.
    lines = "".join(f"{key} = {json.dumps(value)}\n" for key, value in entries.items())
    return f"{head}{lines}{bracket}{tables}"


def build(wheel: Path, out: Path) -> Path:
    """Build and validate the zip in `out`, which is created if missing; return its path."""
    tool = extension_tool()
    manifest = (ADDON / "blender_manifest.toml").read_text(encoding="utf-8")
    fields = tomllib.loads(manifest)
    out.mkdir(parents=True, exist_ok=True)
    archive = out / f"{fields['id']}-{fields['version']}.zip"
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "addon"
        shutil.copytree(ADDON, source, ignore=shutil.ignore_patterns("__pycache__"))
        (source / "wheels").mkdir()
        shutil.copy(wheel, source / "wheels")
        (source / "samples").mkdir()
        shutil.copy(SAMPLE, source / "samples")
        for text in LICENSES:
            shutil.copy(text, source)
        (source / "blender_manifest.toml").write_text(with_wheel(manifest, wheel), encoding="utf-8")
        for arguments in (
            ["build", "--source-dir", str(source), "--output-filepath", str(archive)],
            ["validate", str(archive)],
        ):
            subprocess.run([sys.executable, str(tool), *arguments], check=True, stdout=sys.stderr, timeout=120)
    return archive


def main() -> None:
    parser = argparse.ArgumentParser(description="Build the Blender extension as a zip.")
    parser.add_argument("--wheel", type=Path, required=True, help="the wheel to bundle")
    parser.add_argument("--out", type=Path, required=True, help="the folder for the zip")
    arguments = parser.parse_args()
    print(build(arguments.wheel, arguments.out))


if __name__ == "__main__":
    main()
