"""Imports a tree of Leafcloud into Unreal Editor 5 as one static mesh with levels of detail.

In the editor's Python console, with the plugin *Python Editor Script Plugin*:

    py "…/import_tree.py" "…/pine.glb" /Game/Trees

The files of single levels (pine_LOD0.glb …) must lie beside pine.glb, which tells the screen sizes at which levels take
over. Static meshes have no morph targets: to hide the switch turn *Dithered LOD Transition* on in the materials.
Temporal antialiasing smooths the edges of leaves where the script can turn *Dither Opacity Mask* on.
"""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import Any

import unreal

CENTIMETRES = 100.0
"""Unreal's units in a meter."""


def read_document(path: Path) -> dict[str, Any]:
    """Return the JSON document of a GLB file. Raise `ValueError` for another file."""
    content = path.read_bytes()
    if content[:4] != b"glTF":
        raise ValueError(f"{path} is no GLB file: choose a NAME.glb that Leafcloud wrote")
    size = struct.unpack_from("<I", content, 12)[0]
    document: dict[str, Any] = json.loads(content[20 : 20 + size])
    return document


def coverages_and_radius(document: dict[str, Any]) -> tuple[list[float], float]:
    """Return for each level the share of the picture's height at which the next one takes over, and the radius of the
    crown in meters. Raise `ValueError` for a file without levels, and for one of several trees.
    """
    trees = [node for node in document.get("nodes", []) if "MSFT_screencoverage" in node.get("extras", {})]
    if not trees:
        raise ValueError("the file has no levels: choose a NAME.glb that Leafcloud wrote")
    if len(trees) > 1:
        raise ValueError(f"the file has {len(trees)} trees: bake each one by itself")
    [node] = trees
    scale = max(abs(each) for each in node.get("scale", [1.0]))
    return node["extras"]["MSFT_screencoverage"], node["extras"]["leafcloud"]["radius"] * scale


def screen_sizes(coverages: list[float], radius: float, bounds: float) -> list[float]:
    """Return the size at which each level takes over. Unreal measures the sphere around the whole mesh, of the radius
    `bounds` in centimeters; the file the sphere around the crown.
    """
    factor = bounds / (radius * CENTIMETRES)
    return [1.0, *(min(coverage * factor, 1.0) for coverage in coverages[:-1])]


def import_level(file: Path, folder: str) -> Any:
    """Import a file and return its static mesh."""
    task = unreal.AssetImportTask()
    task.set_editor_property("filename", str(file))
    task.set_editor_property("destination_path", folder)
    task.set_editor_property("automated", True)
    task.set_editor_property("replace_existing", True)
    unreal.AssetToolsHelpers.get_asset_tools().import_asset_tasks([task])
    paths = task.get_editor_property("imported_object_paths")
    assets = [unreal.EditorAssetLibrary.load_asset(path) for path in paths]
    meshes = [asset for asset in assets if isinstance(asset, unreal.StaticMesh)]
    if not meshes:
        raise ValueError(f"Unreal found no static mesh in {file}: bake the tree again with --engine unreal")
    return meshes[0]


def dither_masks(mesh: Any) -> None:
    """Turn *Dither Opacity Mask* on in the masked materials of a mesh. Warn about instances: their parent decides."""
    slots = mesh.get_editor_property("static_materials")
    materials = [slot.get_editor_property("material_interface") for slot in slots]
    for material in materials:
        if material.get_blend_mode() != unreal.BlendMode.BLEND_MASKED:
            continue
        if isinstance(material, unreal.Material):
            material.set_editor_property("dither_opacity_mask", True)
            unreal.MaterialEditingLibrary.recompile_material(material)
            unreal.EditorAssetLibrary.save_loaded_asset(material)
        else:
            parent = material.get_base_material().get_path_name()
            unreal.log_warning(
                f"{material.get_name()}: leaves have hard edges, because the parent {parent} decides. Copy it into the "
                "project, turn Dither Opacity Mask on in the copy, and make it the parent of the material"
            )


def import_tree(file: Path, folder: str) -> Any:
    """Import all levels of a tree into a folder of the content browser. Return the static mesh."""
    coverages, radius = coverages_and_radius(read_document(file))
    files = [file.with_name(f"{file.stem}_LOD{number}.glb") for number in range(len(coverages))]
    missing = [each.name for each in files if not each.is_file()]
    if missing:
        raise ValueError(f"{', '.join(missing)} must lie beside {file}: copy all files of the bake")
    mesh, *later = [import_level(each, f"{folder}/{file.stem}") for each in files]
    subsystem = unreal.get_editor_subsystem(unreal.StaticMeshEditorSubsystem)
    subsystem.remove_lods(mesh)
    for number, level in enumerate(later, start=1):
        if subsystem.set_lod_from_static_mesh(mesh, number, level, 0, True) != number:
            raise ValueError(f"Unreal did not take level {number} of {file}: look into its log")
    subsystem.set_lod_screen_sizes(mesh, screen_sizes(coverages, radius, mesh.get_bounds().sphere_radius))
    dither_masks(mesh)
    unreal.EditorAssetLibrary.save_loaded_asset(mesh)
    return mesh


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit("usage: import_tree.py NAME.glb /Game/FOLDER")
    import_tree(Path(sys.argv[1]), sys.argv[2])
