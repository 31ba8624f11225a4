"""Smaller meshes in GLB files: rounded numbers (`KHR_mesh_quantization`), compressed by `EXT_meshopt_compression`.

A reader without these extensions cannot open such a file at all. So compression must be asked for, and only engines
that are known to read it can have it.

- Image coordinates within [0, 1]: 16 bits, normalized. Their largest error is 2⁻¹⁷.
- Normals and tangents: 8 bits, normalized. The largest error of a component is 1/254.
- All other floats (positions, offsets of morph targets, ranks, pivots): multiples of a step, which is a power of two.
  The largest error is 2⁻¹⁶ of the range of the component, or 2⁻²² of its largest number if that is more.
- Colors, indices and integers stay as they are.

Equal numbers stay equal, and sorted numbers sorted: all vertices of a leaf keep one rank and one pivot. Readers get the
coordinates of the uncompressed file; no node is scaled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leafcloud

from .glb_file import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Glb, accessor_uses

COMPRESSION, QUANTIZATION = "EXT_meshopt_compression", "KHR_mesh_quantization"

_BYTE, _UNSIGNED_SHORT = 5120, 5123
_TRIANGLES = 4
_BITS, _MOST_BITS = 16, 22
"""Bits of the range of a component, and most bits of a number beside its sign: the filter has 24 in all."""

_LEAST_EXPONENT = -100


@dataclass(frozen=True)
class _Stream:
    """The numbers of an accessor, compressed.

    stride: bytes of a decompressed element. mode, filter: names of the extension. target: of the buffer view. change:
    of the accessor.
    """

    data: bytes
    stride: int
    mode: str
    target: int
    filter: str = "NONE"
    change: dict[str, Any] = field(default_factory=dict)


def compress(glb: Glb) -> None:
    """Round and compress the vertex attributes, morph targets and triangles of a complete file."""
    glb.remove_unused()
    document = glb.document
    streams = {number: make(glb.values(number)) for number, make in _makers(glb).items()}
    for number in streams:
        for name in ("bufferView", "byteOffset"):
            document["accessors"][number].pop(name, None)
    glb.remove_unused_views()
    decompressed = {"byteLength": 0, "extensions": {COMPRESSION: {"fallback": True}}}
    """A buffer that takes no bytes of the file: readers decompress into it."""
    document["buffers"].append(decompressed)
    for number, stream in streams.items():
        _append(glb, document["accessors"][number], stream, decompressed)
    for name in (COMPRESSION, QUANTIZATION):
        glb.use_extension(name)
    document["extensionsRequired"] = sorted({*document.get("extensionsRequired", []), COMPRESSION, QUANTIZATION})


def _makers(glb: Glb) -> dict[int, Callable[[NDArray[Any]], _Stream]]:
    """Return the function that compresses each accessor. Accessors with uses of several kinds keep their numbers.

    Indices of lines and points stay uncompressed: the levels have none, other objects few.
    """
    found: dict[int, set[Callable[[NDArray[Any]], _Stream]]] = {}
    for primitive in glb.primitives:
        triangles = primitive.get("mode", _TRIANGLES) == _TRIANGLES
        for values, name in accessor_uses(primitive):
            if triangles or name != "indices":
                found.setdefault(values[name], set()).add(_MAKERS.get(name, _numbers))
    return {number: makers.pop() if len(makers) == 1 else _unchanged for number, makers in found.items()}


def _append(glb: Glb, accessor: dict[str, Any], stream: _Stream, decompressed: dict[str, Any]) -> None:
    """Append the stream and the buffer view of its decompressed bytes, and give it to the accessor."""
    document, count = glb.document, accessor["count"]
    start = -(-decompressed["byteLength"] // 4) * 4
    decompressed["byteLength"] = start + count * stream.stride
    glb.align()
    form = {} if stream.filter == "NONE" else {"filter": stream.filter}
    source: dict[str, Any] = {"buffer": 0, "byteOffset": len(glb.binary), "byteLength": len(stream.data)}
    source |= {"byteStride": stream.stride, "count": count, "mode": stream.mode, **form}
    glb.binary += stream.data
    view: dict[str, Any] = {"buffer": 1, "byteOffset": start, "byteLength": count * stream.stride}
    view["target"] = stream.target
    if stream.target == ARRAY_BUFFER:
        view["byteStride"] = stream.stride
    document["bufferViews"].append({**view, "extensions": {COMPRESSION: source}})
    accessor |= {"bufferView": len(document["bufferViews"]) - 1, **stream.change}


def _triangles(corners: NDArray[Any]) -> _Stream:
    data = leafcloud.compress_triangles(corners.reshape(-1, 3).astype(np.uint32))
    return _Stream(data, corners.itemsize, "TRIANGLES", ELEMENT_ARRAY_BUFFER)


def _unchanged(values: NDArray[Any], form: str = "NONE", change: dict[str, Any] | None = None) -> _Stream:
    """Compress elements (v, w) of any type as they are, filled up with zeros to a multiple of four bytes."""
    rows = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
    rows = np.pad(rows, ((0, 0), (0, -rows.shape[1] % 4)))
    return _Stream(leafcloud.compress_rows(rows), rows.shape[1], "ATTRIBUTES", ARRAY_BUFFER, form, change or {})


def _directions(values: NDArray[Any]) -> _Stream:
    """Compress normals (v, 3) or tangents (v, 4)."""
    return _unchanged(np.rint(values * 127.0).astype(np.int8), change={"componentType": _BYTE, "normalized": True})


def _coordinates(values: NDArray[Any]) -> _Stream:
    """Compress image coordinates (v, 2)."""
    if values.dtype != np.float32 or values.min() < 0.0 or values.max() > 1.0:
        return _numbers(values)
    change = {"componentType": _UNSIGNED_SHORT, "normalized": True}
    return _unchanged(np.rint(values.astype(np.float64) * 65535.0).astype(np.uint16), change=change)


def _numbers(values: NDArray[Any]) -> _Stream:
    """Compress numbers (v, w). Floats become multiples of a step: 24 bits of a factor below 8 bits of an exponent."""
    if values.dtype != np.float32:
        return _unchanged(values)
    exponents = exponents_of(values)
    factors = np.rint(np.ldexp(values.astype(np.float64), -exponents)).astype(np.int32)
    rounded = np.ldexp(factors.astype(np.float32), exponents)
    bounds = {"min": rounded.min(axis=0).tolist(), "max": rounded.max(axis=0).tolist()}
    return _unchanged((exponents << 24) | (factors & 0xFFFFFF), "EXPONENTIAL", bounds)


def exponents_of(values: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return for each column of (v, w) finite floats, v ≥ 1, the exponent of its step."""
    low, high = values.min(axis=0).astype(np.float64), values.max(axis=0).astype(np.float64)
    by_range, by_size = _exponent(high - low) - _BITS, _exponent(np.maximum(-low, high)) - _MOST_BITS
    return np.maximum(np.maximum(by_range, by_size), _LEAST_EXPONENT)


def _exponent(values: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return the exponents of the least powers of two above `values`; the least exponent for 0."""
    return np.where(values > 0.0, np.frexp(values)[1], _LEAST_EXPONENT).astype(np.int32)


_MAKERS: dict[str, Callable[[NDArray[Any]], _Stream]] = {
    "indices": _triangles,
    "NORMAL": _directions,
    "TANGENT": _directions,
    "TEXCOORD_0": _coordinates,
    "TEXCOORD_1": _coordinates,
}
"""The functions for attributes by name; `_numbers` for all others."""
