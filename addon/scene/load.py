"""Opens a file in an empty Blender: glTF, OBJ or .blend.

Blender's importers repair coordinates that are not finite by setting them to zero, without a word. So the files are
looked at before they are imported.
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

from . import SceneError
from .realise import first_not_finite

_Opener: TypeAlias = Callable[[Path], None]

_GLB_HEADER, _GLB_CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")
_FLOAT = 5126
_OBJ_LIBRARY = re.compile(rb"^mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_OBJ_VERTEX = re.compile(rb"^[ \t]*v[ \t]+(.*)$", re.MULTILINE)
# What float32 may not hold: "nan", "inf", "1e39". Most lines have none of it and are not parsed.
_SUSPICIOUS = re.compile(rb"nan|inf|e\+?(?:3[89]|[4-9]\d|\d{3})", re.IGNORECASE)


def load(path: Path | str) -> None:
    """Opens .glb, .gltf, .obj or .blend; what was open before is gone, and Blender is in its factory settings.

    Raises `SceneError` for a file that is not there, that is of another kind, that Blender cannot read, or whose
    vertices are not finite.
    """
    path, opener = _opener(Path(path), {**_IMPORTERS, ".blend": _open_blend})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _open(path, opener)


def load_beside(path: Path | str) -> list[bpy.types.Object]:
    """Imports .glb, .gltf or .obj into the open scene; gives the objects that it has brought. Raises as `load`."""
    path, opener = _opener(Path(path), _IMPORTERS)
    before = set(bpy.data.objects)
    _open(path, opener)
    return [obj for obj in bpy.data.objects if obj not in before]


def _opener(path: Path, openers: Mapping[str, _Opener]) -> tuple[Path, _Opener]:
    opener = openers.get(path.suffix.lower())
    if opener is None:
        raise SceneError(f"{path} is not a file that can be read; give one of {', '.join(openers)}")
    if not path.is_file():
        raise SceneError(f"{path} is not there, or is not a file; check the path")
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
    """Removes the levels of a baked tree but the leaves, with their trunks: they lie in no scene of its file.

    Blender shows them before 4.5, and keeps them in a collection that is excluded from 4.5 on.
    """
    baked = {obj: obj.get("leafcloud") for obj in objects}
    levels = [obj for obj, found in baked.items() if hasattr(found, "get") and found.get("level", 0) > 0]
    for obj in {member for level in levels for member in (level, *level.children_recursive)}:
        bpy.data.objects.remove(obj)
    bpy.data.orphans_purge(do_recursive=True)  # Another bake may want their names.


def _open_obj(path: Path) -> None:
    _check_obj(path)
    _run(path, bpy.ops.wm.obj_import)


_IMPORTERS: Mapping[str, _Opener] = {".glb": _open_gltf, ".gltf": _open_gltf, ".obj": _open_obj}


def _open_blend(path: Path) -> None:
    # Scripts in the file stay off, whatever the settings say.
    _run(path, bpy.ops.wm.open_mainfile, load_ui=False, use_scripts=False)


def _run(path: Path, operator: Callable[..., set[str]], **options: bool) -> None:
    """Runs one of Blender's readers; it says an error by an exception whose text may have several lines."""
    try:
        result = operator(filepath=str(path.resolve()), **options)
    except RuntimeError as error:
        words = "; ".join(line.strip() for line in str(error).splitlines() if line.strip()).removeprefix("Error: ")
        raise SceneError(f"{path} cannot be read: {words}; check the file, or export it again") from error
    if "FINISHED" not in result:
        raise SceneError(f"{path} cannot be read: Blender gave up on it; check the file, or export it again")


def _check_gltf(path: Path) -> bool:
    """Whether a glTF file has levels by `MSFT_lod`. Refuses one that is broken or whose vertices are not finite."""
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
    """The JSON of a .gltf or .glb file and, of the latter, its binary chunk."""
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
    """(v, 3) the values of an accessor; `None` where they are compressed or sparse, or integers, which are finite."""
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
    """Refuses an OBJ file whose vertices are not finite, or whose materials are not there."""
    content = path.read_bytes()
    if _SUSPICIOUS.search(content):
        _check_obj_vertices(path, content)
    for match in _OBJ_LIBRARY.finditer(content):
        library = path.parent / match[1].strip().decode(errors="surrogateescape")
        if not library.is_file():
            raise SceneError(f"{library} is not there, {path.name} names its materials in it; put the file there")


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
