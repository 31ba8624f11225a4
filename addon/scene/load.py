"""Loader of glTF, OBJ and .blend files into an empty Blender.

Blender's importers trust their input. So `gltf_checks`, `obj_checks` and `blend_checks` check files before that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import bpy

from ..errors import SceneError
from .blend_checks import check_blend, check_opened_blend
from .gltf_checks import check_gltf
from .obj_checks import check_obj

_Opener: TypeAlias = Callable[[Path], None]


def load(path: Path | str) -> None:
    """Open a .glb, .gltf, .obj or .blend file. Closes the current file and loads Blender's factory settings.

    Raises `SceneError` for a missing file, another file type, a file that Blender cannot read, or vertices that are not
    finite.
    """
    path, opener = _opener(Path(path), {**_IMPORTERS, ".blend": _open_blend})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _open(path, opener)


def load_beside(path: Path | str) -> list[bpy.types.Object]:
    """Import a .glb, .gltf or .obj file into the open scene. Returns the new objects. Raises as `load`."""
    path, opener = _opener(Path(path), _IMPORTERS)
    before = set(bpy.data.objects)
    _open(path, opener)
    return [obj for obj in bpy.data.objects if obj not in before]


def _opener(path: Path, openers: Mapping[str, _Opener]) -> tuple[Path, _Opener]:
    opener = openers.get(path.suffix.lower())
    if opener is None:
        raise SceneError(f"{path} has an unsupported file type; give one of {', '.join(openers)}")
    if not path.is_file():
        raise SceneError(f"{path} does not exist, or is not a file; check the path")
    return path, opener


def _open(path: Path, opener: _Opener) -> None:
    try:
        opener(path)
    except OSError as error:
        failed = error.filename or path
        reason = error.strerror or error
        raise SceneError(f"{failed} cannot be read: {reason}; check the file and its permissions") from error


def _open_gltf(path: Path) -> None:
    before = set(bpy.data.objects)
    document = check_gltf(path)
    _run(path, bpy.ops.import_scene.gltf)
    if any("MSFT_lod" in node.get("extensions", {}) for node in document.get("nodes", [])):
        _remove_far_levels(set(bpy.data.objects) - before)


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


def _open_obj(path: Path) -> None:
    check_obj(path)
    _run(path, bpy.ops.wm.obj_import)


_IMPORTERS: Mapping[str, _Opener] = {".glb": _open_gltf, ".gltf": _open_gltf, ".obj": _open_obj}

SUFFIXES = tuple(_IMPORTERS)
"""Ends of the names of files that `load_beside` imports."""


def _open_blend(path: Path) -> None:
    check_blend(path)
    # Never run scripts in the file, whatever the preferences allow.
    _run(path, bpy.ops.wm.open_mainfile, load_ui=False, use_scripts=False)
    check_opened_blend(path)


def _run(path: Path, operator: Callable[..., set[str]], **options: bool) -> None:
    """Run an import operator. Blender reports errors by an exception, sometimes with several lines of text."""
    try:
        result = operator(filepath=str(path.resolve()), **options)
    except (RuntimeError, ValueError, TypeError) as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
        failed = next((number for number, line in enumerate(lines) if "Traceback (most recent call" in line), None)
        words = "; ".join(lines) if failed is None else f"Blender's importer failed with {_last_error(lines[failed:])}"
        words = words.removeprefix("Error: ")
        raise SceneError(f"{path} cannot be read: {words}; check the file, or export it again") from error
    if "FINISHED" not in result:
        raise SceneError(f"{path} cannot be read: Blender canceled opening it; check the file, or export it again")
