"""The packages for three.js and Babylon.js draw alpha of an atlas page as the covered share, at all mip levels.

The oracle is a literal page: the mean of its alpha is the share of the picture that a billboard covers, and billboards
behind one another hide 1 − (1 − share)² of the background.
"""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import ask
from engine_views import bundle, pictures
from laws import Floats
from night import rest_at_night
from PIL import Image

TEXELS = 64
TILE = 16
REPEATS = 64
SIDE = 256
LEVELS = (-1.0, 0.0, 0.5, 1.0, 2.0, 3.0)
"""Mip levels: log₂ of texels per pixel. Disks are some ten texels large."""


def page() -> Floats:
    """Return alpha in [0, 1] of a page: disks, whose outlines cover a share of their texels."""
    places = (np.arange(8 * TILE) + 0.5) / 8.0 - TILE / 2.0
    disk = np.hypot(places[:, None], places) < 0.33 * TILE
    alpha = disk.reshape(TILE, 8, TILE, 8).mean((1, 3))
    return np.tile(np.round(255.0 * alpha) / 255.0, (TEXELS // TILE, TEXELS // TILE))


def png(alpha: Floats) -> bytes:
    texels = np.full((*alpha.shape, 4), 255, np.uint8)
    texels[..., 3] = np.round(255.0 * alpha)
    saved = io.BytesIO()
    Image.fromarray(texels).save(saved, "PNG")
    return saved.getvalue()


def write(path: Path, billboards: int) -> Path:
    """Write a file of two levels; level 1 has so many billboards behind one another, white and without lights."""
    corners = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    points = np.concatenate([corners - [0.0, 0.0, 0.0123 * i] for i in range(billboards)]).astype(np.float32)
    # Disks of turned pages overlap like independent ones.
    turns = [np.array([[np.cos(i), -np.sin(i)], [np.sin(i), np.cos(i)]]) for i in range(billboards)]
    places = np.concatenate([corners[:, :2] @ turn * REPEATS / 2.0 for turn in turns]).astype(np.float32)
    indices = np.concatenate([np.array([0, 1, 2, 0, 2, 3]) + 4 * i for i in range(billboards)]).astype(np.uint16)
    normals = np.tile(np.float32([0, 0, 1]), (len(points), 1))
    body, views = bytearray(), []
    for part in (points.tobytes(), normals.tobytes(), places.tobytes(), indices.tobytes(), png(page())):
        views.append({"buffer": 0, "byteOffset": len(body), "byteLength": len(part)})
        body += part + b"\0" * (-len(part) % 4)

    def accessor(view: int, count: int, kind: str, component: int = 5126) -> dict[str, Any]:
        return {"bufferView": view, "componentType": component, "count": count, "type": kind}

    bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
    attributes = {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}
    white = {"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True}
    extras = {"centre": [0.0, 0.0, 0.0], "radius": 1.0}
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit", "MSFT_lod"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {
                "name": f"page_LOD{level}",
                "mesh": level,
                "extras": {"leafcloud": {"level": level, "switch_distance": 10.0 * level, **extras}},
            }
            for level in (0, 1)
        ],
        "meshes": [
            {"primitives": [{"attributes": attributes, "indices": 3, "material": material}]} for material in (0, 1)
        ],
        "materials": [
            white,
            {
                **white,
                "alphaMode": "MASK",
                "alphaCutoff": 0.5,
                "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
            },
        ],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 4, "mimeType": "image/png"}],
        "accessors": [
            {**accessor(0, len(points), "VEC3"), **bounds},
            accessor(1, len(points), "VEC3"),
            accessor(2, len(points), "VEC2"),
            accessor(3, len(indices), "SCALAR", 5123),
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": len(body)}],
    }
    document["nodes"][0]["extensions"] = {"MSFT_lod": {"ids": [1]}}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Return files of a page by the number of their billboards."""
    out = tmp_path_factory.mktemp("page")
    bundle(out)
    return {billboards: write(out / f"page_{billboards}.glb", billboards) for billboards in (1, 2)}


def covered(file: Path, renderer: str, samples: bool) -> Floats:
    """Return pictures (levels, side, side) of the covered share of pixels, in front of an opaque background."""
    views = []
    for level in LEVELS:
        half = SIDE * 2.0**level / (TEXELS * REPEATS)
        fov = 2.0 * np.degrees(np.arctan(half))
        views.append({"eye": [0.003, 0.007, 1.0], "target": [0.003, 0.007, 0.0], "fov": fov})
    own = {} if renderer in ("babylon", "webgl") else {"page": "three_webgpu", "renderer": renderer}
    engine = "babylon" if renderer == "babylon" else "three"
    asked = {"views": views, "side": SIDE, "settings": {"level": 1}, "samples": samples, "background": 0, **own}
    found = np.stack([picture["pixels"] for picture in pictures(engine, file, **asked)])
    assert (found[..., 3] == 255.0).all(), "the background stays opaque"
    shares = np.asarray(found[..., 0] / 255.0)
    # WebGPURenderer takes the mean of samples before it encodes colors, the others afterward.
    return shares if renderer in ("babylon", "webgl") else decoded(shares)


def decoded(shares: Floats) -> Floats:
    return np.where(shares > 0.04045, ((shares + 0.055) / 1.055) ** 2.4, shares / 12.92)


@pytest.mark.parametrize("samples", [False, True], ids=["one_sample", "multisampled"])
@pytest.mark.parametrize("renderer", rest_at_night(["webgl", "babylon", "webgpu", "webgl2"], 2))
def test_a_billboard_covers_the_share_that_its_alpha_says(files: dict[int, Path], renderer: str, samples: bool) -> None:
    if renderer == "webgpu":
        lacking = ask("tests/browser/three_webgpu.html", {"renderer": renderer}, patience=60.0)["lacking"]
        if lacking:
            pytest.skip(lacking)
    share = page().mean()
    assert 0.3 < share < 0.36
    for billboards, file in files.items():
        found = covered(file, renderer, samples)
        wanted = 1.0 - (1.0 - share) ** billboards
        print(renderer, samples, billboards, f"{wanted:.3f}", found.mean((1, 2)).round(3).tolist())
        assert found.mean((1, 2)) == pytest.approx(wanted, abs=0.02)
        soft = (found > 0.0) & (found < 1.0)
        assert (soft.mean((1, 2))[0] > 0.01) == samples, "magnified outlines are smooth"
