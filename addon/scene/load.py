"""Loader of files into an empty Blender: .blend, glTF, OBJ, and what else Blender has importers for.

Blender's importers trust their input. So `gltf_checks`, `obj_checks` and `blend_checks` check files before that. Of
other files only the imported meshes and images are checked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import bpy

from ..errors import SceneError
from ..material.cutouts import without_empty_alpha
from .blend_checks import check_blend, check_blocks
from .gltf_checks import check_gltf
from .gltf_source import GltfSource
from .gltf_transmission import add_transmission, marked
from .gltf_unpacked import as_glb
from .input_files import check_regular
from .obj_checks import check_obj
from .obj_corrections import Up, correct

_Opener: TypeAlias = Callable[[Path], list[str]]


def load(path: Path | str, up: Up = "auto") -> list[str]:
    """Open a file of a tree or a scene. Closes the current file and loads Blender's factory settings.

    up: the axis of an .obj file that points up. Returns sentences about what the scene has not as the file.

    Raises `SceneError` for a missing file, another file type, a file that Blender cannot read, or vertices that are not
    finite.
    """
    path, opener = _opener(Path(path), {**_importers(up), ".blend": _open_blend})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return _open(path, opener)


def load_beside(path: Path | str, up: Up = "auto") -> tuple[list[bpy.types.Object], list[str]]:
    """Import a file of a tree into the open scene. Returns the new objects, and sentences as `load`.

    Raises as `load`.
    """
    path, opener = _opener(Path(path), _importers(up))
    before = set(bpy.data.objects)
    notes = _open(path, opener)
    return [obj for obj in bpy.data.objects if obj not in before], notes


def _opener(path: Path, openers: Mapping[str, _Opener]) -> tuple[Path, _Opener]:
    opener = openers.get(path.suffix.lower())
    if opener is None:
        raise SceneError(f"{path} has an unsupported file type; give one of {', '.join(openers)}")
    if not path.is_file():
        raise SceneError(f"{path} does not exist, or is not a file; check the path")
    return path, opener


def _open(path: Path, opener: _Opener) -> list[str]:
    try:
        return opener(path)
    except OSError as error:
        failed = error.filename or path
        reason = error.strerror or error
        raise SceneError(f"{failed} cannot be read: {reason}; check the file and its permissions") from error


def _open_gltf(path: Path) -> list[str]:
    before, materials = set(bpy.data.objects), set(bpy.data.materials)
    source = check_gltf(path)
    readable = marked(source)
    if readable.file is not None:
        _run(path, bpy.ops.import_scene.gltf)
    else:
        with TemporaryDirectory() as folder:
            copy = Path(folder) / f"{path.stem}.glb"
            copy.write_bytes(as_glb(readable))
            _run(path, bpy.ops.import_scene.gltf, copy)
    imported = set(bpy.data.materials) - materials
    for material in imported:
        without_empty_alpha(material)
    transmission = [] if readable is source else add_transmission(source, imported)
    notes = [*_unread(source), *transmission]
    if any("MSFT_lod" in node.get("extensions", {}) for node in source.list("nodes")):
        _remove_far_levels(set(bpy.data.objects) - before)
    return notes


_READ = {
    f"KHR_materials_{name}"
    for name in (
        *("unlit", "specular", "ior", "transmission", "volume", "clearcoat", "sheen", "anisotropy"),
        *("diffuse_transmission", "emissive_strength", "pbrSpecularGlossiness"),
    )
}
"""Extensions of materials that are read, and those whose loss `material.losses` tells."""


def _unread(source: GltfSource) -> list[str]:
    """Return a sentence for each material with extensions that nothing reads."""
    return [
        f"material {material.get('name', number)!r}: {', '.join(lost)} of the file is left out"
        for number, material in enumerate(source.list("materials"))
        if (lost := sorted(set(material.get("extensions", {})) - _READ))
    ]


def _last_error(traceback: Sequence[str]) -> str:
    """Return the error at the end of a traceback, which may be followed by the place of the call."""
    return next((line for line in reversed(traceback) if not line.startswith(("Location:", "File "))), traceback[-1])


def _remove_far_levels(objects: set[bpy.types.Object]) -> None:
    """Remove all levels of a baked tree except level 0, with their trunks. They are in no scene of the glTF file.

    Blender before 4.5 shows them; from 4.5 on it puts them into an excluded collection.
    """
    kept = _unused()
    baked = {obj: obj.get("leafcloud") for obj in objects}
    levels = [obj for obj, found in baked.items() if hasattr(found, "get") and found.get("level", 0) > 0]
    for obj in {member for level in levels for member in (level, *level.children_recursive)}:
        bpy.data.objects.remove(obj)
    while left := _unused() - kept:  # Frees their names for another bake.
        bpy.data.batch_remove(left)


def _unused() -> set[bpy.types.ID]:
    """Return the data of levels that nothing uses."""
    kinds = (bpy.data.meshes, bpy.data.materials, bpy.data.images, bpy.data.shape_keys, bpy.data.collections)
    return {block for kind in kinds for block in kind if block.users == 0}


def _open_obj(path: Path, up: Up) -> list[str]:
    check_obj(path)
    before = set(bpy.data.objects)
    _run(path, bpy.ops.wm.obj_import)
    return correct(set(bpy.data.objects) - before, up)


def _open_other(path: Path, operator: Callable[..., set[str]]) -> list[str]:
    """Import an .fbx or USD file, then check the images and meshes that were imported."""
    check_regular(path)
    images, meshes = set(bpy.data.images), set(bpy.data.meshes)
    _run(path, operator)
    check_blocks(path, set(bpy.data.images) - images, set(bpy.data.meshes) - meshes)
    return []


def _importers(up: Up) -> Mapping[str, _Opener]:
    """Return the function that imports files of each ending, with the importers that this Blender has."""
    others: dict[str, _Opener] = {}
    if "fbx_import" in dir(bpy.ops.wm):
        others[".fbx"] = partial(_open_other, operator=bpy.ops.wm.fbx_import)
    elif "fbx" in dir(bpy.ops.import_scene):
        others[".fbx"] = partial(_open_other, operator=bpy.ops.import_scene.fbx)
    if "usd_import" in dir(bpy.ops.wm):
        usd = partial(_open_other, operator=bpy.ops.wm.usd_import)
        others |= dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), usd)
    return {".glb": _open_gltf, ".gltf": _open_gltf, ".obj": partial(_open_obj, up=up), **others}


SUFFIXES = (".glb", ".gltf", ".obj", ".fbx", ".usd", ".usda", ".usdc", ".usdz")
"""Ends of the names of files that `load_beside` imports."""


def _open_blend(path: Path) -> list[str]:
    check_blend(path)
    # Never run scripts in the file, whatever the preferences allow.
    _run(path, bpy.ops.wm.open_mainfile, load_ui=False, use_scripts=False)
    check_blocks(path, bpy.data.images, bpy.data.meshes)
    return []


def _run(path: Path, operator: Callable[..., set[str]], copy: Path | None = None, **options: bool) -> None:
    """Run an import operator on a file, or on its copy. Blender reports errors by an exception, sometimes with several
    lines of text."""
    try:
        result = operator(filepath=str((copy or path).resolve()), **options)
    except (RuntimeError, ValueError, TypeError) as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
        failed = next((number for number, line in enumerate(lines) if "Traceback (most recent call" in line), None)
        words = "; ".join(lines) if failed is None else f"Blender's importer failed with {_last_error(lines[failed:])}"
        words = words.removeprefix("Error: ")
        raise SceneError(f"{path} cannot be read: {words}; check the file, or export it again") from error
    if "FINISHED" not in result:
        raise SceneError(f"{path} cannot be read: Blender canceled opening it; check the file, or export it again")
