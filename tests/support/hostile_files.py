"""Hostile glTF and OBJ files, made from a small tree by systematic changes. `make bench-hostile` bakes them."""

from __future__ import annotations

import base64
import copy
import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Document = dict[str, Any]
Write = Callable[[Path], Path]
"""Writes a case's files into an empty folder. Returns the file to bake."""


@dataclass(frozen=True)
class Case:
    """One hostile input. The class is the first word of the name."""

    name: str
    write: Write


VALUES: tuple[Any, ...] = (-1, 2**31, 2**63, 10**30, 0.5, 1e300, "../../x", True, [], {}, [[]], "\ud800\n")
"""Hostile values, in place of any value of a document."""

NAMES = (
    "../../up",
    "/absolute/x",
    "a/b\\c",
    "line\nline",
    "nul\0",
    "tab\t\x1b[31m",
    "half \ud800",
    "",
    ".",
    "..",
    "x" * 5000,
)
"""Hostile names of nodes, meshes, materials and images."""

PATHS = (
    "pipe", "/dev/zero", "/dev/stdin", "../outside.dat", "%2e%2e/outside.dat", "..\\outside.dat", "/etc/hostname",
    "link", "loop", "folder", "gone.dat", "http://127.0.0.1:9/x.png", "file:///etc/hostname", "data:", "data:,x",
    "data:;base64,!!!!", "nul%00", "x" * 5000, "", ".", "sparse", "short", "half\ud800",
)  # fmt: skip
"""Hostile names of files. `surround` makes those that lie in the folder."""


def png(side: int, pixels: int = 4) -> bytes:
    """Return a green image that declares `side`² texels, and has those of `pixels` rows."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", side, side, 8, 6, 0, 0, 0)
    body = zlib.compress((b"\0" + bytes((40, 120, 30, 255)) * side) * min(pixels, side))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def jpeg(side: int) -> bytes:
    """Return the headers of a JPEG file that declares `side`² texels."""
    return b"\xff\xd8\xff\xe0\0\x10JFIF\0\1\1\0\0\1\0\1\0\0\xff\xc0\0\x11\x08" + struct.pack(">HH", side, side) + (
        b"\3\1\x11\0\2\x11\1\3\x11\1\xff\xd9"
    )  # fmt: skip


def tree() -> tuple[Document, bytes]:
    """Return a small tree of every part that the importer reads: its document without a URI, and its buffer."""
    cards = np.random.default_rng(1).uniform(-1.0, 1.0, (24, 1, 3)) + np.array(
        [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.2, 0.05], [0.0, 0.2, 0.0]]
    )
    count = 4 * len(cards)
    corners = (4 * np.arange(len(cards))[:, None] + np.array([0, 1, 2, 0, 2, 3])).astype("<u2")
    parts = [
        cards.reshape(-1, 3).astype("<f4"),
        np.tile(np.array([0, 0, 1], "<f4"), (count, 1)),
        np.tile(np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4"), (len(cards), 1)),
        corners.reshape(-1, 1),
        np.array([[0], [1]], "<f4"),
        np.array([[0, 0, 0], [0, 0, 1]], "<f4"),
        np.frombuffer(png(4), np.uint8),
    ]
    body, views = b"", []
    for part in parts:
        views.append({"buffer": 0, "byteOffset": len(body), "byteLength": part.nbytes})
        body += part.tobytes() + bytes(-part.nbytes % 4)
    kinds = [(5126, "VEC3"), (5126, "VEC3"), (5126, "VEC2"), (5123, "SCALAR"), (5126, "SCALAR"), (5126, "VEC3")]
    accessors: list[Document] = [
        {"bufferView": number, "byteOffset": 0, "componentType": component, "count": len(parts[number]), "type": kind}
        for number, (component, kind) in enumerate(kinds)
    ]
    accessors[0] |= {"min": parts[0].min(axis=0).tolist(), "max": parts[0].max(axis=0).tolist()}
    document: Document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_texture_transform", "KHR_lights_punctual"],
        "scene": 0,
        "scenes": [{"name": "scene", "nodes": [0, 3]}],
        "nodes": [
            {"name": "tree", "children": [1, 2]},
            {"name": "leaves", "mesh": 0, "translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]},
            {"name": "leaves more", "mesh": 0, "matrix": np.eye(4).ravel().tolist()},
            {"name": "camera", "camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}},
        ],
        "meshes": [
            {
                "name": "leaves",
                "primitives": [
                    {
                        "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2},
                        "indices": 3,
                        "material": 0,
                        "mode": 4,
                        "targets": [{"POSITION": 0}],
                    }
                ],
                "weights": [0],
            }
        ],
        "materials": [
            {
                "name": "leaves",
                "pbrMetallicRoughness": {
                    "baseColorFactor": [1, 1, 1, 1],
                    "baseColorTexture": {
                        "index": 0,
                        "texCoord": 0,
                        "extensions": {"KHR_texture_transform": {"offset": [0, 0], "rotation": 0, "scale": [1, 1]}},
                    },
                    "metallicFactor": 0,
                    "roughnessFactor": 1,
                },
                "alphaMode": "MASK",
                "alphaCutoff": 0.5,
                "doubleSided": True,
                "emissiveFactor": [0, 0, 0],
            }
        ],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}],
        "images": [{"name": "leaf", "mimeType": "image/png", "bufferView": 6}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(body)}],
        "animations": [
            {
                "channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}],
                "samplers": [{"input": 4, "output": 5, "interpolation": "LINEAR"}],
            }
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1, "zfar": 100}}],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "color": [1, 1, 1], "intensity": 1}]}},
    }
    return document, body


def places(value: Any, before: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Return the ways to all values within a document."""
    for key, each in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*before, key)
        if isinstance(each, dict | list):
            yield from places(each, (*before, key))


def changed(document: Document, place: tuple[Any, ...], value: Any) -> Document:
    """Return a document with another value at a place; without the place if the value is `...`."""
    result = copy.deepcopy(document)
    part: Any = result
    for key in place[:-1]:
        part = part[key]
    if value is ...:
        del part[place[-1]]
    else:
        part[place[-1]] = value
    return result


def glb(document: Document | bytes, body: bytes) -> bytes:
    """Return the content of a GLB file."""
    text = document if isinstance(document, bytes) else json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body += bytes(-len(body) % 4)
    size = 12 + 8 + len(text) + 8 + len(body)
    return struct.pack("<4sIII4s", b"glTF", 2, size, len(text), b"JSON") + text + struct.pack(
        "<I4s", len(body), b"BIN\0"
    ) + body  # fmt: skip


def written(name: str, content: bytes, size: int | None = None) -> Write:
    """Return a writer of one file. `size`: the file's length, with a hole at its end."""

    def write(folder: Path) -> Path:
        surround(folder)
        (folder / name).write_bytes(content)
        if size is not None:
            os.truncate(folder / name, size)
        return folder / name

    return write


def surround(folder: Path) -> None:
    """Add a pipe, links, a folder, a sparse file and a short one to a folder, and a file outside of it."""
    os.mkfifo(folder / "pipe")
    (folder / "folder").mkdir()
    (folder / "loop").symlink_to("loop")
    (folder / "link").symlink_to("../outside.dat")
    (folder / "short").write_bytes(b"\x89PNG")
    (folder / "sparse").write_bytes(b"\x89PNG")
    os.truncate(folder / "sparse", 10**11)
    (folder.parent / "outside.dat").write_bytes(bytes(1 << 16))


def with_buffer(document: Document, body: bytes) -> Document:
    """Return a document with its buffer as a data URI."""
    uri = "data:application/octet-stream;base64," + base64.b64encode(body).decode()
    return changed(document, ("buffers", 0), {"byteLength": len(body), "uri": uri})


def gltf_cases() -> Iterator[Case]:
    document, body = tree()
    yield Case("fine glb", written("tree.glb", glb(document, body)))
    yield Case("fine gltf", written("tree.gltf", json.dumps(with_buffer(document, body)).encode()))
    for number, place in enumerate(places(document)):
        # Each place gets some of the values, all values meet many places.
        for value in (..., *(VALUES[(5 * number + step) % len(VALUES)] for step in range(2))):
            name = f"field {'.'.join(map(str, place))} = {'missing' if value is ... else ascii(value)}"
            yield Case(name, written("tree.glb", glb(changed(document, place, value), body)))
    for value in VALUES:
        for place in _NUMBERS_OF_DATA:
            name = f"number {'.'.join(map(str, place))} = {value!a}"
            yield Case(name, written("tree.glb", glb(changed(document, place, value), body)))
    for name in NAMES:
        for part in ("nodes", "meshes", "materials", "images"):
            number = 1 if part == "nodes" else 0
            yield Case(f"name {part} {name[:20]!a}", written("tree.glb", glb(
                changed(document, (part, number, "name"), name), body)))  # fmt: skip
    for path in PATHS:
        yield Case(f"path buffer {path[:30]!a}", written("tree.gltf", json.dumps(
            changed(document, ("buffers", 0, "uri"), path)).encode()))  # fmt: skip
        yield Case(f"path image {path[:30]!a}", written("tree.glb", glb(
            changed(document, ("images", 0), {"uri": path}), body)))  # fmt: skip
    yield from _cut("tree.glb", glb(document, body))
    yield from _cut("tree.gltf", json.dumps(with_buffer(document, body)).encode())
    yield from _headers(glb(document, body))
    for name, each in _structures(document):
        yield Case(f"structure {name}", written("tree.glb", glb(each, body)))
    yield from _bombs(document, body)


_NUMBERS_OF_DATA = (
    ("accessors", 0, "byteOffset"), ("accessors", 0, "count"), ("accessors", 3, "count"),
    ("accessors", 3, "componentType"), ("accessors", 0, "bufferView"), ("bufferViews", 0, "byteOffset"),
    ("bufferViews", 0, "byteLength"), ("bufferViews", 0, "byteStride"), ("bufferViews", 0, "buffer"),
    ("buffers", 0, "byteLength"), ("meshes", 0, "primitives", 0, "indices"),
    ("meshes", 0, "primitives", 0, "attributes", "POSITION"), ("nodes", 1, "mesh"), ("nodes", 0, "children", 0),
)  # fmt: skip


def _cut(name: str, content: bytes) -> Iterator[Case]:
    for share in range(16):
        yield Case(f"cut {name} at {share}/16", written(name, content[: len(content) * share // 16]))
    for size in (2**31, 2**32, 10**11):
        yield Case(f"sparse {name} of {size}", written(name, content, size))
    yield Case(f"sparse {name} of zeros", written(name, b"", 10**11))


def _headers(content: bytes) -> Iterator[Case]:
    """Other numbers in the headers of a GLB file: version, length, length and type of the first chunk."""
    for at in (0, 4, 8, 12, 16):
        for value in (0, 1, 2**31, 2**32 - 1):
            changed = content[:at] + struct.pack("<I", value) + content[at + 4 :]
            yield Case(f"header {at} = {value}", written("tree.glb", changed))


def _structures(document: Document) -> Iterator[tuple[str, Document | bytes]]:
    """Loops, depth and masses."""
    leaf = document["nodes"][1]
    text = json.dumps(document)

    def having(**lists: Any) -> Document:
        still: Document = {"animations": []} if "nodes" in lists else {}  # Animations refer to nodes.
        return {**copy.deepcopy(document), **still, **lists}

    def chain(count: int) -> Document:
        nodes = [{"children": [number + 1]} for number in range(count)]
        return having(nodes=[*nodes, leaf], scenes=[{"nodes": [0]}])

    yield "own child", having(nodes=[{**leaf, "children": [0]}], scenes=[{"nodes": [0]}])
    yield "loop", having(nodes=[{"children": [1]}, {**leaf, "children": [0]}], scenes=[{"nodes": [0]}])
    yield "loop apart", having(nodes=[leaf, {"children": [2]}, {"children": [1]}], scenes=[{"nodes": [0]}])
    yield "two parents", having(nodes=[{"children": [2]}, {"children": [2]}, leaf, {}], scenes=[{"nodes": [0, 1]}])
    yield "same child twice", changed(document, ("nodes", 0, "children"), [1, 1])
    yield "same root twice", changed(document, ("scenes", 0, "nodes"), [0, 0])
    for depth in (150, 250, 900, 5000):
        yield f"{depth} parents", chain(depth)
    for count in (20_000, 1_000_000):
        yield f"{count} nodes", having(nodes=[{}] * count, scenes=[{"nodes": []}])
        yield f"{count} roots", changed(document, ("scenes", 0, "nodes"), [0] * count)
    primitive = document["meshes"][0]["primitives"][0]
    for count in (3000, 100_000):
        yield f"{count} primitives", having(meshes=[{"primitives": [primitive] * count}])
        yield f"{count} materials", having(materials=document["materials"] * count)
        yield f"{count} scenes", having(scenes=document["scenes"] * count)
        yield (
            f"{count} targets",
            changed(document, ("meshes", 0, "primitives", 0, "targets"), [{"POSITION": 0}] * count),
        )
    yield "many meshes", having(meshes=document["meshes"] * 6000)
    for depth in (100, 500, 100_000):
        yield f"{depth} lists in extras", (text[:-1] + ', "extras": ' + "[" * depth + "]" * depth + "}").encode()
        yield (
            f"{depth} objects in extras",
            (text[:-1] + ', "extras": ' + '{"a":' * depth + "1" + "}" * depth + "}").encode(),
        )
    yield "long number", text.replace('"yfov": 1', '"yfov": ' + "9" * 10_000).encode()
    yield "NaN", text.replace('"yfov": 1', '"yfov": NaN').encode()
    yield "infinity", text.replace('"yfov": 1', '"yfov": 1e999').encode()
    yield "not UTF-8", text.replace("leaves", "\xff").encode("latin-1")
    yield "two million numbers", (text[:-1] + ', "extras": [' + "1," * 2_100_000 + "1]}").encode()
    extras: Any
    for extras in ({"level": "x"}, {"level": []}, {"level": 2**62}, {"level": -1}, {}, {"level": 1}, "x", 7):
        yield f"extras.leafcloud = {extras}", changed(document, ("nodes", 1, "extras"), {"leafcloud": extras})
    for extras in (
        {"targetNames": 5},
        {"targetNames": []},
        {"targetNames": ["\ud800"]},
        {"\ud800": 1},
        {"a" * 99: "x"},
    ):
        yield f"extras of a mesh = {extras!a}", changed(document, ("meshes", 0, "extras"), extras)
    for name, index in (("COLOR_0", 2), ("COLOR_0", 3), ("JOINTS_0", 0), ("_X", 3), ("NORMAL", 2), ("\ud800", 0)):
        yield (
            f"attribute {name!a} from {index}",
            changed(document, ("meshes", 0, "primitives", 0, "attributes", name), index),
        )
    for mode in range(7):
        yield f"mode {mode}", changed(document, ("meshes", 0, "primitives", 0, "mode"), mode)
    names: list[Any]
    for names in (["FOO"], ["KHR_draco_mesh_compression"], ["\n"], [[]]):
        yield f"required {names}", having(extensionsRequired=names, extensionsUsed=names)
    draco = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    yield "draco", changed(document, ("meshes", 0, "primitives", 0, "extensions"), draco)


def _bombs(document: Document, body: bytes) -> Iterator[Case]:
    """Small files that ask for much memory."""
    for side in (8193, 16_384, 30_000, 2**31 - 1):
        for name, image in (
            ("png", png(min(side, 16_384), 1) if side < 2**20 else png(4)),
            ("jpeg", jpeg(min(side, 65_535))),
        ):
            if name == "png":
                image = image[:16] + struct.pack(">II", side, side) + image[24:]
            uri = f"data:image/{name};base64," + base64.b64encode(image).decode()
            yield Case(f"bomb {name} {side} data", written("tree.glb", glb(
                changed(document, ("images", 0), {"uri": uri}), body)))  # fmt: skip
            longer = changed(
                document, ("bufferViews", 6), {"buffer": 0, "byteOffset": len(body), "byteLength": len(image)}
            )
            longer["buffers"][0]["byteLength"] = len(body) + len(image)
            yield Case(f"bomb {name} {side} view", written("tree.glb", glb(longer, body + image)))
    for count in (2**26, 2**31 - 1):
        accessor = {"componentType": 5126, "count": count, "type": "VEC3"}
        zeros = changed(document, ("accessors", 0), accessor)
        zeros["meshes"][0]["primitives"][0]["attributes"] = {"POSITION": 0}
        yield Case(f"bomb {count} zeros", written("tree.glb", glb(zeros, body)))
    instanced = copy.deepcopy(document)
    instanced["accessors"].append({"componentType": 5126, "count": 500_000, "type": "VEC3"})
    instanced["nodes"][1]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 6}}}
    instanced["extensionsUsed"].append("EXT_mesh_gpu_instancing")
    yield Case("bomb 500000 instances", written("tree.glb", glb(instanced, body)))


_OBJ = "mtllib tree.mtl\no leaves\nusemtl leaf\n" + "".join(
    f"v {x} 0 {z}\nv {x + 0.5} 0 {z}\nv {x} 0.5 {z + 0.1}\nvt 0 0\nvt 1 0\nvt 0 1\nf -3/-3 -2/-2 -1/-1\n"
    for x in range(6)
    for z in range(4)
)
_MTL = "newmtl leaf\nKd 0.2 0.5 0.1\nmap_Kd leaf.png\n"


def _obj(
    text: str | bytes, library: str | bytes = _MTL, image: bytes | None = None, sizes: tuple[Any, Any] = (None, None)
) -> Write:
    def write(folder: Path) -> Path:
        surround(folder)
        (folder / "leaf.png").write_bytes(png(4) if image is None else image)
        for name, content, size in (("tree.mtl", library, sizes[1]), ("tree.obj", text, sizes[0])):
            (folder / name).write_bytes(content if isinstance(content, bytes) else os.fsencode(content))
            if size is not None:
                os.truncate(folder / name, size)
        return folder / "tree.obj"

    return write


def _default_library(folder: Path) -> Path:
    """Write an OBJ file that names no library, beside a pipe where Blender expects one."""
    path = _obj(_OBJ.partition("\n")[2])(folder)
    (folder / "tree.mtl").unlink()
    os.mkfifo(folder / "tree.mtl")
    return path


def obj_cases() -> Iterator[Case]:
    yield Case("fine obj", _obj(_OBJ))
    yield Case("obj library by default", _default_library)
    for path in ("pipe", "/dev/zero"):
        yield Case(f"obj image continued {path}", _obj(_OBJ, _MTL.replace("leaf.png", f"\\\n{path}")))
    for path in PATHS:
        if "\0" in path or "\ud800" in path:
            continue
        yield Case(f"obj library {path[:30]!a}", _obj(_OBJ.replace("tree.mtl", path)))
        yield Case(f"obj image {path[:30]!a}", _obj(_OBJ, _MTL.replace("leaf.png", path)))
        yield Case(f"obj base {path[:30]!a}", _obj(_OBJ, _MTL.replace("leaf.png", f"far/away/{path}")))
        yield Case(f"obj option {path[:30]!a}", _obj(_OBJ, _MTL.replace("leaf.png", f"-s 1 1 1 {path}")))
    for corner in (
        "0",
        "-9999",
        "2147483648",
        "9223372036854775808",
        "x",
        "1/",
        "1//99999",
        "1/-99999",
        "1.5",
        "",
        "1e9",
    ):
        yield Case(f"obj corner {corner}", _obj(_OBJ + f"f 1 2 {corner}\n"))
    for line in (
        "v 1", "v a b c", "v nan 0 0", "v 1e39 0 0", "vt nan inf", "vn 0 0 0", "f", "f 1", "f 1 1 1", "f 1 2 1 2 1 2",
        "l 1 99999", "p 0", "cstype bezier", "cstype bspline\ndeg 100\ncurv 0 1 1 2 3\nend", "g " + "x" * 5000,
        "usemtl " + "x" * 5000, "o ../../up", "o \x1b[31m", "mtllib tree.mtl tree.mtl", "s 99999999999", "call pipe",
        "scmp pipe", "csh echo x > escaped", "deg 2147483648", "curv " + "1 " * 1000, "#MRGB " + "f" * 64,
    ):  # fmt: skip
        yield Case(f"obj line {line[:30]!a}", _obj(_OBJ + line + "\n"))
    yield Case("obj polygon of a million corners", _obj(_OBJ + "f" + " 1 2 3" * 333_333 + "\n"))
    yield Case("obj long line", _obj(_OBJ + "o " + "x" * 3_000_000))
    yield Case("obj null bytes", _obj(_OBJ.encode() + bytes(1000) + _OBJ.encode()))
    yield Case("obj sparse", _obj(_OBJ, sizes=(2 * 10**9, None)))
    yield Case("obj sparse 100 GB", _obj(_OBJ, sizes=(10**11, None)))
    yield Case("obj sparse library", _obj(_OBJ, sizes=(None, 2 * 10**9)))
    yield Case("obj 5000 materials", _obj(_OBJ, "".join(f"newmtl m{number}\n" for number in range(5000)) + _MTL))
    yield Case("obj bomb png", _obj(_OBJ, image=png(16_384, 1)))
    yield Case("obj bomb jpeg", _obj(_OBJ, image=jpeg(65_000)))
    for share in range(8):
        yield Case(f"obj cut at {share}/8", _obj(_OBJ[: len(_OBJ) * share // 8]))
        yield Case(f"obj image cut at {share}/8", _obj(_OBJ, image=png(4)[: len(png(4)) * share // 8]))
