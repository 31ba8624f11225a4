"""Makes shrub.glb, the small plant that comes with Leafcloud.

    python examples/make_shrub.py [OUT.glb]

A few hundred leaf cards with a drawn leaf on each (node ``leaves``, alpha MASK, double-sided) and stems (node
``branches``). Needs numpy only and gives the same bytes everywhere: random numbers come from PCG64, coordinates are
rounded, and the PNG is stored without compression. glTF's axes: Y up, metres.
"""

from __future__ import annotations

import json
import struct
import sys
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SEED = 7
STEMS = 16
TWIGS_PER_STEM = 7
LEAVES_PER_TWIG = 6
TEXTURE_SIZE = 128
UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class Mesh:
    """Positions and normals (v, 3), texture coordinates (v, 2) with v downwards, indices (3 t,)."""

    positions: FloatArray
    normals: FloatArray
    uvs: FloatArray
    indices: NDArray[np.uint16]


def join(meshes: list[Mesh]) -> Mesh:
    """One mesh with the vertices and triangles of all."""
    starts = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.positions for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.uvs for mesh in meshes]),
        np.concatenate([mesh.indices + start for mesh, start in zip(meshes, starts, strict=False)]).astype(np.uint16),
    )


def unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)


def perpendicular(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that stand on the unit vector ``direction`` and on each other."""
    side = unit(np.cross(direction, UP if abs(direction[1]) < 0.9 else np.array([1.0, 0.0, 0.0])))
    return side, np.cross(side, direction)


def tube(path: FloatArray, radii: FloatArray, sides: int) -> Mesh:
    """A tapered tube around the points of ``path`` (n, 3) with the radii (n,), open at both ends."""
    angles = np.arange(sides + 1) * (2 * np.pi / sides)
    across, along = perpendicular(unit(path[-1] - path[0]))
    ring = np.cos(angles)[:, None] * across + np.sin(angles)[:, None] * along
    positions = path[:, None] + radii[:, None, None] * ring
    normals = np.broadcast_to(ring, positions.shape)
    turns, lengths = np.meshgrid(angles / (2 * np.pi), np.linspace(0, 1, len(path)))
    lower = (np.arange(len(path) - 1)[:, None] * (sides + 1) + np.arange(sides)).ravel()
    upper = lower + sides + 1
    quads = np.stack([lower, upper, lower + 1, lower + 1, upper, upper + 1], axis=1)
    return Mesh(
        positions.reshape(-1, 3),
        normals.reshape(-1, 3),
        np.stack([turns, lengths], axis=-1).reshape(-1, 2),
        quads.ravel().astype(np.uint16),
    )


def card(base: FloatArray, direction: FloatArray, normal: FloatArray, length: float) -> Mesh:
    """A leaf: a quad that starts at ``base``, reaches ``length`` along ``direction`` and faces ``normal``."""
    side = np.cross(direction, normal) * (length * 0.5)
    tip = direction * length
    return Mesh(
        np.array([base - side, base + side, base + side + tip, base - side + tip]),
        np.tile(normal, (4, 1)),
        np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]),
        np.array([0, 1, 2, 0, 2, 3], dtype=np.uint16),
    )


def arc(start: FloatArray, direction: FloatArray, length: float, droop: float, points: int) -> FloatArray:
    """Points (n, 3) of a branch that sets out in ``direction`` and bends downwards by ``droop`` of its length."""
    share = np.linspace(0.0, 1.0, points)[:, None]
    return start + length * (share * direction - droop * share**2 * UP)


def shrub(random: np.random.Generator) -> tuple[Mesh, Mesh]:
    """The leaves and the branches."""
    leaves, branches = [], []
    for stem in range(STEMS):
        # The golden angle spreads the stems evenly around the root.
        turn = stem * np.pi * (3 - np.sqrt(5)) + random.uniform(-0.2, 0.2)
        lean = 0.05 + 0.85 * np.sqrt((stem + 0.5) / STEMS)
        outwards = np.array([np.cos(turn), 0.0, np.sin(turn)])
        direction = np.sin(lean) * outwards + np.cos(lean) * UP
        path = arc(0.03 * outwards, direction, random.uniform(0.8, 1.1), 0.2, 5)
        branches.append(tube(path, np.linspace(0.014, 0.005, len(path)), 5))
        for twig in range(TWIGS_PER_STEM):
            place = 0.35 + 0.65 * (twig + random.uniform(0.2, 0.8)) / TWIGS_PER_STEM
            start = np.array([np.interp(place * (len(path) - 1), np.arange(len(path)), axis) for axis in path.T])
            heading = unit(direction + random.normal(0.0, 0.7, 3))
            twig_path = arc(start, heading, random.uniform(0.15, 0.3), 0.15, 3)
            branches.append(tube(twig_path, np.linspace(0.005, 0.002, len(twig_path)), 3))
            leaves += twig_leaves(twig_path, heading, random)
    return join(leaves), join(branches)


def twig_leaves(path: FloatArray, heading: FloatArray, random: np.random.Generator) -> list[Mesh]:
    """Leaves along a twig, alternately to its two sides and one at its tip, the faces turned to the light."""
    across, _ = perpendicular(heading)
    leaves = []
    for leaf in range(LEAVES_PER_TWIG):
        base = path[1 + leaf * (len(path) - 1) // LEAVES_PER_TWIG]
        aside = 0.0 if leaf == LEAVES_PER_TWIG - 1 else 1.2 * (-1.0) ** leaf
        direction = unit(heading + aside * across + random.normal(0.0, 0.3, 3))
        light = UP + random.normal(0.0, 0.45, 3)
        normal = unit(light - direction * (light @ direction))
        leaves.append(card(base, direction, normal, random.uniform(0.09, 0.15)))
    return leaves


def leaf_texture(size: int) -> NDArray[np.uint8]:
    """A leaf on a transparent ground (size, size, 4): midrib upwards, sRGB, straight alpha."""
    x, y = np.meshgrid((np.arange(size) + 0.5) / size * 2 - 1, 1 - (np.arange(size) + 0.5) / size)
    width = 0.78 * np.sin(np.pi * np.clip(y - 0.06, 0.0, 0.92) / 0.92) ** 0.8 * (1 - 0.35 * y)
    serration = 0.05 * np.abs(np.modf(y * 13)[0] - 0.5)
    blade = np.abs(x) < width - serration
    stalk = (np.abs(x) < 0.035) & (y < 0.2)
    vein = np.abs(np.modf((y - 0.55 * np.abs(x) + 1) * 7)[0] - 0.5) < 0.07
    rib = np.abs(x) < 0.03 * (1.3 - y)
    colour = np.array([0.24, 0.42, 0.12]) + np.array([0.16, 0.18, 0.05]) * (0.5 * np.abs(x) + 0.5 * y)[..., None]
    colour = colour + np.where(rib, 0.14, np.where(vein, 0.05, 0.0))[..., None]
    alpha = (blade | stalk).astype(np.float64)
    return np.round(np.concatenate([colour, alpha[..., None]], axis=-1) * 255).clip(0, 255).astype(np.uint8)


def png(image: NDArray[np.uint8]) -> bytes:
    """A PNG file of ``image`` (h, w, 4), in stored deflate blocks: no compressor's version shows in the bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width = image.shape[:2]
    rows = b"".join(b"\0" + row.tobytes() for row in image)
    pieces = [rows[i : i + 0xFFFF] for i in range(0, len(rows), 0xFFFF)]
    blocks = b"".join(
        struct.pack("<BHH", piece is pieces[-1], len(piece), len(piece) ^ 0xFFFF) + piece for piece in pieces
    )
    deflated = b"\x78\x01" + blocks + struct.pack(">I", zlib.adler32(rows))
    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", deflated) + chunk(b"IEND", b"")


class GlbWriter:
    """Collects a glTF document and its binary buffer."""

    def __init__(self) -> None:
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "Leafcloud examples/make_shrub.py"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            **{key: [] for key in ("nodes", "meshes", "materials", "accessors", "bufferViews")},
        }
        self.binary = b""

    def add(self, key: str, value: dict[str, Any]) -> int:
        self.document[key].append(value)
        return len(self.document[key]) - 1

    def view(self, data: bytes, **fields: int) -> int:
        offset = len(self.binary)
        self.binary += data + b"\0" * (-len(data) % 4)
        return self.add("bufferViews", {"buffer": 0, "byteOffset": offset, "byteLength": len(data), **fields})

    def vertices(self, values: FloatArray, decimals: int) -> int:
        """An accessor of rounded float vectors (v, 2) or (v, 3), with their bounds."""
        # Rounded, because the last bits of sines differ between processors; + 0.0 turns −0 into 0.
        data = (np.round(values, decimals) + 0.0).astype("<f4")
        view = self.view(data.tobytes(), target=34962)
        bounds = {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
        kind = f"VEC{data.shape[1]}"
        return self.add(
            "accessors", {"bufferView": view, "componentType": 5126, "count": len(data), "type": kind, **bounds}
        )

    def indices(self, values: NDArray[np.uint16]) -> int:
        view = self.view(values.astype("<u2").tobytes(), target=34963)
        return self.add(
            "accessors", {"bufferView": view, "componentType": 5123, "count": len(values), "type": "SCALAR"}
        )

    def node(self, name: str, mesh: Mesh, material: int) -> None:
        attributes = {
            "POSITION": self.vertices(mesh.positions, 4),
            "NORMAL": self.vertices(mesh.normals, 6),
            "TEXCOORD_0": self.vertices(mesh.uvs, 4),
        }
        primitive = {"attributes": attributes, "indices": self.indices(mesh.indices), "material": material}
        node = self.add("nodes", {"name": name, "mesh": self.add("meshes", {"name": name, "primitives": [primitive]})})
        self.document["scenes"][0]["nodes"].append(node)

    def bytes(self) -> bytes:
        self.document["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(self.document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self.binary), b"BIN\0")
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks) + len(self.binary)) + chunks + self.binary


def glb() -> bytes:
    """The file."""
    leaves, branches = shrub(np.random.Generator(np.random.PCG64(SEED)))
    writer = GlbWriter()
    image = writer.view(png(leaf_texture(TEXTURE_SIZE)))
    writer.document["images"] = [{"name": "leaf", "mimeType": "image/png", "bufferView": image}]
    writer.document["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}]
    writer.document["textures"] = [{"source": 0, "sampler": 0}]
    surface = {"metallicFactor": 0.0, "roughnessFactor": 0.8}
    leaf = {
        "name": "leaves",
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, **surface},
        "alphaMode": "MASK",
        "alphaCutoff": 0.5,
        "doubleSided": True,
    }
    bark = {"name": "branches", "pbrMetallicRoughness": {"baseColorFactor": [0.13, 0.08, 0.05, 1.0], **surface}}
    writer.node("leaves", leaves, writer.add("materials", leaf))
    writer.node("branches", branches, writer.add("materials", bark))
    return writer.bytes()


def main() -> None:
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("shrub.glb")
    out.write_bytes(glb())


if __name__ == "__main__":
    main()
