"""Loader of glTF, OBJ and .blend files into an empty Blender.

Blender's importers silently set coordinates that are not finite to zero. So the loader checks files before it imports
them.
"""

from __future__ import annotations

import base64
import json
import re
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..mesh.realise import first_not_finite

_Opener: TypeAlias = Callable[[Path], None]

_GLB_HEADER, _GLB_CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")
_FLOAT = 5126
_OBJ_LIBRARY = re.compile(rb"^mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_OBJ_VERTEX = re.compile(rb"^[ \t]*v[ \t]+(.*)$", re.MULTILINE)
# Matches numbers that float32 may not hold: "nan", "inf", "1e39". Only lines with a match are parsed.
_SUSPICIOUS = re.compile(rb"nan|inf|e\+?(?:3[89]|[4-9]\d|\d{3})", re.IGNORECASE)


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
    levels_apart = _check_gltf(path)
    _run(path, bpy.ops.import_scene.gltf)
    if levels_apart:
        _remove_far_levels(set(bpy.data.objects) - before)


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
    _check_obj(path)
    _run(path, bpy.ops.wm.obj_import)


_IMPORTERS: Mapping[str, _Opener] = {".glb": _open_gltf, ".gltf": _open_gltf, ".obj": _open_obj}

SUFFIXES = tuple(_IMPORTERS)
"""Ends of the names of files that `load_beside` imports."""


def _open_blend(path: Path) -> None:
    # Never run scripts in the file, whatever the preferences allow.
    _run(path, bpy.ops.wm.open_mainfile, load_ui=False, use_scripts=False)


def _run(path: Path, operator: Callable[..., set[str]], **options: bool) -> None:
    """Run an import operator. Blender reports errors by an exception, sometimes with several lines of text."""
    try:
        result = operator(filepath=str(path.resolve()), **options)
    except RuntimeError as error:
        words = "; ".join(line.strip() for line in str(error).splitlines() if line.strip()).removeprefix("Error: ")
        raise SceneError(f"{path} cannot be read: {words}; check the file, or export it again") from error
    if "FINISHED" not in result:
        raise SceneError(f"{path} cannot be read: Blender canceled opening it; check the file, or export it again")


def _check_gltf(path: Path) -> bool:
    """Return whether a glTF file has levels by `MSFT_lod`. Raise `SceneError` for broken or non-finite data."""
    try:
        document, body = _gltf_document(path)
        accessors = {
            index: mesh.get("name", number)
            for number, mesh in enumerate(document.get("meshes", []))
            for primitive in mesh["primitives"]
            if (index := primitive["attributes"].get("POSITION")) is not None
        }
        for index, mesh_name in accessors.items():
            positions = _gltf_positions(path, document, body, index)
            if positions is not None:
                _check_finite(path, f"mesh {mesh_name!r}", positions)
        return any("MSFT_lod" in node.get("extensions", {}) for node in document.get("nodes", []))
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, struct.error) as error:
        raise SceneError(f"{path} is not glTF, or is broken ({error}); export it again") from error


def _gltf_document(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return the JSON of a .gltf or .glb file, and the binary chunk of a .glb file (else empty)."""
    content = path.read_bytes()
    if not content.startswith(b"glTF"):
        return json.loads(content), b""
    _, version, length = _GLB_HEADER.unpack_from(content)
    if version != 2 or length > len(content):
        raise ValueError(f"version {version} and {length} bytes in the header, {len(content)} in the file")
    chunks: dict[bytes, bytes] = {}
    at = _GLB_HEADER.size
    while at + _GLB_CHUNK.size <= length:
        size, kind = _GLB_CHUNK.unpack_from(content, at)
        at += _GLB_CHUNK.size
        chunks.setdefault(kind, content[at : at + size])
        at += size
    return json.loads(chunks[b"JSON"]), chunks.get(b"BIN\0", b"")


def _gltf_positions(path: Path, document: dict[str, Any], body: bytes, index: int) -> NDArray[np.float32] | None:
    """Return (v, 3) the values of an accessor; `None` if compressed, sparse, or integers (always finite)."""
    accessor = document["accessors"][index]
    if "bufferView" not in accessor or accessor["componentType"] != _FLOAT:
        return None
    view = document["bufferViews"][accessor["bufferView"]]
    content = _gltf_buffer(path, document["buffers"][view["buffer"]], body)
    if content is None:
        return None
    stride = view.get("byteStride", 12)
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    return np.ndarray((accessor["count"], 3), "<f4", content, start, (stride, 4))


def _gltf_buffer(path: Path, buffer: dict[str, Any], body: bytes) -> bytes | None:
    uri = buffer.get("uri")
    if uri is None:
        return body or None
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    return (path.parent / unquote(uri)).read_bytes()


def _check_obj(path: Path) -> None:
    """Raise `SceneError` for an OBJ file with non-finite vertices or a missing material library."""
    content = path.read_bytes()
    if _SUSPICIOUS.search(content):
        _check_obj_vertices(path, content)
    for match in _OBJ_LIBRARY.finditer(content):
        library = path.parent / match[1].strip().decode(errors="surrogateescape")
        if not library.is_file():
            raise SceneError(
                f"{library} does not exist, but {path.name} reads its materials from it; put the file there"
            )


def _check_obj_vertices(path: Path, content: bytes) -> None:
    for number, match in enumerate(_OBJ_VERTEX.finditer(content)):
        if _SUSPICIOUS.search(match[1]):
            coordinates = np.array([_number(word) for word in match[1].split()[:3]], np.float64)
            with np.errstate(over="ignore"):
                _check_finite(path, "the file", coordinates.astype(np.float32)[None], first=number)


def _number(word: bytes) -> float:
    try:
        return float(word)
    except ValueError:
        return float("nan")


def _check_finite(path: Path, where: str, positions: NDArray[np.float32], first: int = 0) -> None:
    bad = first_not_finite(positions)
    if bad is not None:
        index, shown = bad
        raise SceneError(
            f"{path}: vertex {first + index} of {where} lies at ({shown}), which is not finite; export it again"
        )
