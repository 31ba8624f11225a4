"""The scripts for Unreal and Unity, as far as they can be checked without these editors.

Unreal's is run with a module in the place of `unreal`, Unity's is compiled against the declarations in
tests/support/unity_stubs.cs.
"""

from __future__ import annotations

import importlib.util
import json
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
COVERAGES = [0.5, 0.2, 0.05, 0.0]
RADIUS = 3.0
BOUNDS = 400.0
"""Radius of the sphere around the whole mesh in centimeters."""


class Properties:
    """An object of Unreal with editor properties."""

    def __init__(self, **properties: Any) -> None:
        self.properties = properties

    def set_editor_property(self, name: str, value: Any) -> None:
        self.properties[name] = value

    def get_editor_property(self, name: str) -> Any:
        return self.properties[name]


class Material(Properties):
    def get_blend_mode(self) -> str:
        return str(self.properties["blend_mode"])


class MaterialInstance(Properties):
    def get_blend_mode(self) -> str:
        return "masked"

    def get_name(self) -> str:
        return "leaves"

    def get_base_material(self) -> SimpleNamespace:
        return SimpleNamespace(get_path_name=lambda: "/Importer/Masked")


class StaticMesh(Properties):
    def __init__(self, name: str) -> None:
        super().__init__(static_materials=[])
        self.name = name
        self.levels: dict[int, str] = {0: name}
        self.sizes: list[float] = []

    def get_bounds(self) -> SimpleNamespace:
        return SimpleNamespace(sphere_radius=BOUNDS)


def import_tasks(tasks: list[Properties]) -> None:
    for task in tasks:
        name = Path(task.properties["filename"]).stem
        task.properties["imported_object_paths"] = [f"{task.properties['destination_path']}/{name}"]


def set_lod(mesh: StaticMesh, number: int, level: StaticMesh, source: int, reuse: bool) -> int:
    assert (source, reuse) == (0, True)
    mesh.levels[number] = level.name
    return number


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script for Unreal, as a module."""
    subsystem = SimpleNamespace(
        remove_lods=lambda mesh: True,
        set_lod_from_static_mesh=set_lod,
        set_lod_screen_sizes=lambda mesh, sizes: mesh.sizes.extend(sizes),
    )
    unreal = SimpleNamespace(
        AssetImportTask=Properties,
        AssetToolsHelpers=SimpleNamespace(get_asset_tools=lambda: SimpleNamespace(import_asset_tasks=import_tasks)),
        BlendMode=SimpleNamespace(BLEND_MASKED="masked"),
        EditorAssetLibrary=SimpleNamespace(load_asset=StaticMesh, save_loaded_asset=lambda asset: True),
        Material=Material,
        MaterialEditingLibrary=SimpleNamespace(
            recompile_material=lambda material: material.set_editor_property("is_recompiled", True)
        ),
        StaticMesh=StaticMesh,
        StaticMeshEditorSubsystem="subsystem",
        get_editor_subsystem=lambda kind: subsystem,
        log_warning=print,
    )
    monkeypatch.setitem(sys.modules, "unreal", unreal)
    spec = importlib.util.spec_from_file_location("import_tree", ROOT / "engines" / "unreal" / "import_tree.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def write_tree(folder: Path, levels: int = 4) -> Path:
    """Write the files of a bake, as far as the script reads them."""
    extras = {"leafcloud": {"level": 0, "radius": RADIUS / 2.0}, "MSFT_screencoverage": COVERAGES}
    document = {"nodes": [{"name": "camera"}, {"name": "pine_LOD0", "scale": [2.0, 2.0, 2.0], "extras": extras}]}
    text = json.dumps(document).encode()
    content = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text
    (folder / "pine.glb").write_bytes(content)
    for number in range(levels):
        (folder / f"pine_LOD{number}.glb").write_bytes(content)
    return folder / "pine.glb"


def test_unreal_gets_all_levels_in_one_mesh(script: ModuleType, tmp_path: Path) -> None:
    mesh = script.import_tree(write_tree(tmp_path), "/Game/Trees")
    assert mesh.levels == {number: f"/Game/Trees/pine/pine_LOD{number}" for number in range(4)}


def test_levels_take_over_in_unreal_where_the_crown_has_the_size_of_the_file(
    script: ModuleType, tmp_path: Path
) -> None:
    """Both measure a sphere's height in the picture: Unreal that around the mesh, the file that around the crown."""
    mesh = script.import_tree(write_tree(tmp_path), "/Game/Trees")
    assert mesh.sizes == pytest.approx([1.0, *(share * BOUNDS / (100.0 * RADIUS) for share in COVERAGES[:3])])


def test_unreal_dithers_masks_and_names_the_parents_that_decide(
    script: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    bark, leaves, instance = Material(blend_mode="opaque"), Material(blend_mode="masked"), MaterialInstance()
    mesh = StaticMesh("tree")
    materials = [Properties(material_interface=material) for material in (bark, leaves, instance)]
    mesh.set_editor_property("static_materials", materials)
    script.dither_masks(mesh)
    assert leaves.properties == {"blend_mode": "masked", "dither_opacity_mask": True, "is_recompiled": True}
    assert bark.properties == {"blend_mode": "opaque"}
    assert instance.properties == {}
    [warning] = capsys.readouterr().out.splitlines()
    assert "leaves" in warning
    assert "/Importer/Masked" in warning


def test_unreal_s_script_names_missing_files_and_files_without_levels(script: ModuleType, tmp_path: Path) -> None:
    file = write_tree(tmp_path, levels=2)
    with pytest.raises(ValueError, match=r"pine_LOD2\.glb, pine_LOD3\.glb must lie beside"):
        script.import_tree(file, "/Game/Trees")
    with pytest.raises(ValueError, match="no levels"):
        script.coverages_and_radius({"nodes": [{"name": "box"}]})
    (tmp_path / "a.txt").write_text("text")
    with pytest.raises(ValueError, match="no GLB file"):
        script.read_document(tmp_path / "a.txt")


@pytest.mark.skipif(shutil.which("mcs") is None, reason="needs mcs, the compiler of C# in Debian's package mono-mcs")
def test_unity_s_script_compiles(tmp_path: Path) -> None:
    sources = [ROOT / "engines" / "unity" / "Editor" / "LeafcloudTrees.cs", ROOT / "tests/support/unity_stubs.cs"]
    command = ["mcs", "-target:library", "-warnaserror+", f"-out:{tmp_path / 'script.dll'}", *map(str, sources)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
