"""Checks of a glTF file before Blender imports it: its form, its data, and all files that it names.

Blender's importer trusts its input: it reads pipes and files anywhere, decodes images of any size, and fails in the
middle of its code. It silently sets coordinates that are not finite to zero.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SceneError
from ..mesh.realise import first_not_finite
from .gltf_format import COMPONENTS, SHAPES, Broken, Document, check
from .gltf_source import DEEPEST, GltfSource, read_document
from .gltf_unpacked import unpacked
from .image_sizes import ImageSizes
from .input_files import check_regular, shown

_MOST_OBJECTS, _DEEPEST_NODE = 10_000, 200
"""Limits on nodes with their instances, and on the parents of a node. The importer calls itself for each parent."""

_MOST_ZEROS = 1 << 26
"""Limit on the bytes of accessors without data, which the importer fills with zeros."""

_REUSE, _FREE = 16, 1_000_000
"""How often meshes may use the same data on average, and the number of corners that they may use more often."""

_DRACO = "KHR_draco_mesh_compression"

_ATTRIBUTES: dict[str, tuple[str, ...]] = {
    "POSITION": ("VEC3",),
    "NORMAL": ("VEC3",),
    "TANGENT": ("VEC4", "VEC3"),
    "TEXCOORD": ("VEC2",),
    "COLOR": ("VEC3", "VEC4"),
    "JOINTS": ("VEC4",),
    "WEIGHTS": ("VEC4",),
}
"""The types of accessors for each attribute. Tangents of morph targets have three components."""


def check_gltf(path: Path) -> GltfSource:
    """Return a glTF file without compressed data. Raise `SceneError` or `OSError` if Blender must not read it."""
    size = check_regular(path)
    try:
        document, body = read_document(path, size)
        _check_depth(document)
        check(document)
        _check_texts(document)
        stored = GltfSource(path.resolve().parent, document, body, path)
        _check_views(stored)
        source = unpacked(stored)
        for step in (_check_views, _check_accessors, _check_zeros, _check_primitives, _check_reuse, _check_nodes):
            step(source)
        _check_images(source)
        _check_values(source)
    except Broken as fault:
        raise SceneError(f"{path} is not glTF, or is broken: {fault}; export it again") from fault
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from error
    return source


def _check_depth(document: Any) -> None:
    """Raise `Broken` for values that are nested too deeply: Blender and its importer copy them recursively."""
    level = [document]
    for _ in range(DEEPEST):
        level = [
            part
            for value in level
            if isinstance(value, dict | list)
            for part in (value.values() if isinstance(value, dict) else value)
        ]
        if not level:
            return
    raise Broken(f"the JSON text is nested too deeply: at most {DEEPEST} levels are possible")


def _check_texts(document: Document) -> None:
    """Raise `Broken` for a text outside of the table, such as a custom property, that Blender cannot store."""
    try:
        json.dumps(document, ensure_ascii=False).encode()
    except UnicodeEncodeError as error:
        text = error.object[max(error.start - 20, 0) : error.end + 20]
        raise Broken(f"the text {shown(text)} is not Unicode: it has half of a surrogate pair") from error


def _check_views(source: GltfSource) -> None:
    for number, view in enumerate(source.list("bufferViews")):
        end = view.get("byteOffset", 0) + view["byteLength"]
        size = source.list("buffers")[view["buffer"]]["byteLength"]
        if end > size:
            raise Broken(f"bufferViews[{number}] ends at byte {end}, but buffers[{view['buffer']}] has {size} bytes")


def _check_accessors(source: GltfSource) -> None:
    for number, accessor in enumerate(source.list("accessors")):
        place, kind, count = f"accessors[{number}]", accessor["type"], accessor["count"]
        if "bufferView" in accessor:
            _check_span(source, place, accessor, accessor["componentType"], kind, count)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            indices, values = sparse["indices"], sparse["values"]
            if sparse["count"] > count:
                raise Broken(f"{place}.sparse.count is {sparse['count']}, but must be at most {count}")
            _check_span(source, f"{place}.sparse.indices", indices, indices["componentType"], "SCALAR", sparse["count"])
            _check_span(source, f"{place}.sparse.values", values, accessor["componentType"], kind, sparse["count"])


def _check_span(source: GltfSource, place: str, span: dict[str, Any], component: int, kind: str, count: int) -> None:
    """Raise `Broken` for data that leave their buffer view."""
    view = source.list("bufferViews")[span["bufferView"]]
    size = np.dtype(COMPONENTS[component]).itemsize
    stride = view.get("byteStride") or size * SHAPES[kind]
    if stride % size:
        raise Broken(f"{place} has a stride of {stride} bytes, which is no multiple of its components' {size}")
    end = span.get("byteOffset", 0) + stride * (count - 1) + size * SHAPES[kind]
    if end > view["byteLength"]:
        raise Broken(
            f"{place} ends at byte {end}, but bufferViews[{span['bufferView']}] has {view['byteLength']} bytes"
        )


def _check_zeros(source: GltfSource) -> None:
    compressed = {
        primitive["extensions"][_DRACO]["bufferView"]
        for _, primitive in source.primitives()
        if _DRACO in primitive.get("extensions", {})
    }
    # Draco takes far more than a byte for 256 bytes of vertices.
    most = _MOST_ZEROS + 256 * sum(source.list("bufferViews")[each]["byteLength"] for each in compressed)
    zeros = sum(
        accessor["count"] * SHAPES[accessor["type"]] * 4
        for accessor in source.list("accessors")
        if "bufferView" not in accessor
    )
    if zeros > most:
        raise Broken(f"accessors without a 'bufferView' have {zeros} bytes, more than {most}")


def _check_primitives(source: GltfSource) -> None:
    for place, primitive in source.primitives():
        attributes = primitive["attributes"]
        vertices = source.list("accessors")[attributes["POSITION"]]["count"] if "POSITION" in attributes else 0
        for names in (attributes, *primitive.get("targets", ())):
            for name, index in names.items() if vertices else ():
                _check_attribute(source, place, name, index, vertices)
        if "indices" in primitive:
            accessor = source.list("accessors")[primitive["indices"]]
            if accessor["type"] != "SCALAR" or accessor["componentType"] not in (5121, 5123, 5125):
                found = f"{accessor['type']} of {accessor['componentType']}"
                raise Broken(f"{place}.indices is {found}, but must be SCALAR of 5121, 5123 or 5125")


def _check_attribute(source: GltfSource, place: str, name: str, index: int, vertices: int) -> None:
    accessor = source.list("accessors")[index]
    kinds = _ATTRIBUTES.get(name.split("_")[0] or "_", ("SCALAR", "VEC2", "VEC3", "VEC4"))
    if accessor["type"] not in kinds:
        raise Broken(f"{place}: {shown(name)} is {accessor['type']}, but must be {' or '.join(kinds)}")
    if accessor["count"] != vertices:
        raise Broken(f"{place}: {shown(name)} has {accessor['count']} values, but there are {vertices} vertices")


def _check_reuse(source: GltfSource) -> None:
    """Raise `Broken` if meshes use the same data so often that a small file fills the memory."""
    used: Counter[int] = Counter()
    for _, primitive in source.primitives():
        corners = primitive.get("indices", primitive["attributes"].get("POSITION"))
        parts = (target["POSITION"] for target in primitive.get("targets", ()) if "POSITION" in target)
        used.update(each for each in (corners, *parts) if each is not None)
    counts = {index: source.list("accessors")[index]["count"] for index in used}
    corners = sum(counts[index] * times for index, times in used.items())
    most = _FREE + _REUSE * sum(counts.values())
    if corners > most:
        raise Broken(f"the meshes use {corners} corners of the same data, more than {most}")


def _check_nodes(source: GltfSource) -> None:
    """Raise `Broken` unless the nodes form trees that are not too deep."""
    nodes = source.list("nodes")
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", ()):
            if child in parents:
                raise Broken(f"nodes[{child}] has the parents {parents[child]} and {number}, but may have one")
            parents[child] = number
    depths: dict[int, int] = {}
    for number in range(len(nodes)):
        way = [number]
        while way[-1] not in depths and way[-1] in parents and len(way) <= _DEEPEST_NODE:
            way.append(parents[way[-1]])
        depth = depths.get(way[-1], 0) + len(way) - 1
        if depth >= _DEEPEST_NODE:
            looping = "is its own parent, or " if len(way) > len(set(way)) else ""
            raise Broken(f"nodes[{number}] {looping}has more than {_DEEPEST_NODE} parents")
        depths |= {each: depth - steps for steps, each in enumerate(way)}
    for number, scene in enumerate(source.list("scenes")):
        if len(set(scene.get("nodes", ()))) < len(scene.get("nodes", ())):
            raise Broken(f"scenes[{number}] has the same node twice")
    instances = [node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {}).get("attributes", {}) for node in nodes]
    accessors = source.list("accessors")
    objects = len(nodes) + sum(max((accessors[each]["count"] for each in one.values()), default=0) for one in instances)
    if objects > _MOST_OBJECTS:
        raise Broken(f"nodes and their instances are {objects} objects, more than {_MOST_OBJECTS}: join them")


def _check_images(source: GltfSource) -> None:
    sizes = ImageSizes()
    for number in range(len(source.list("images"))):
        image = source.image(number)
        if isinstance(image, Path):
            sizes.check_file(image)
        elif image is not None:
            sizes.check(image, f"images[{number}]")


def _check_values(source: GltfSource) -> None:
    """Raise `Broken` for indices of vertices that do not exist, `SceneError` for vertices that are not finite."""
    finite: set[int] = set()
    largest: dict[int, int] = {}
    for number, mesh in enumerate(source.list("meshes")):
        for primitive in mesh["primitives"]:
            position = primitive["attributes"].get("POSITION")
            if position is None or _DRACO in primitive.get("extensions", {}):
                continue
            if position not in finite:
                _check_finite(source, position, mesh.get("name", number))
                finite.add(position)
            index = primitive.get("indices")
            if index is not None and index not in largest:
                indices = source.values(index)
                largest[index] = 0 if indices is None else int(indices.max())
            vertices = source.list("accessors")[position]["count"]
            if index is not None and largest[index] >= vertices:
                raise Broken(
                    f"mesh {shown(mesh.get('name', number))} has the index {largest[index]} in accessors[{index}], "
                    f"but {vertices} vertices"
                )


def _check_finite(source: GltfSource, index: int, mesh: str | int) -> None:
    """Raise `SceneError` for a vertex that is not finite."""
    values = source.values(index)
    bad = None if values is None or values.dtype.kind != "f" else first_not_finite(values)
    if bad is not None:
        vertex, coordinates = bad
        raise SceneError(
            f"vertex {vertex} of mesh {shown(mesh)} lies at ({coordinates}), which is not finite; export it again"
        )
