"""Self-shadowing in the viewer: two textures multiply the light of a sun by a share."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from browser import FILES, ask
from laws import Floats, sun_share
from small_glb import QUAD, QUAD_UVS, png
from viewing import PAGE, PATIENCE

TANGENT = (0.6, 0.8, 0.0, -1.0)
"""A tangent in the plane of the quad, which faces +z. From the front the bitangent is to its left."""
AXES = np.array([TANGENT[:3], (0.8, -0.6, 0.0), (0.0, 0.0, 1.0)])
EYE = (0.5, 0.5, 3.0)


def code(value: float) -> int:
    """Return the 8-bit code of a number in [−1, 1]."""
    return round((value + 1.0) / 2.0 * 255.0)


def write_quad(path: Path, opened: int, toward: tuple[int, int, int], *, shading: bool) -> Path:
    """Write a white quad. Its two textures have one texel each, with these codes."""
    columns = {
        "POSITION": np.array(QUAD, "<f4"),
        "NORMAL": np.tile(np.float32([0.0, 0.0, 1.0]), (4, 1)),
        "TANGENT": np.tile(np.float32(TANGENT), (4, 1)),
        "TEXCOORD_0": np.array(QUAD_UVS, "<f4"),
    }
    images = [png([[(opened, 255, 0, 255)]]), png([[(*toward, 255)]])]
    parts = [values.tobytes() for values in columns.values()] + [np.uint16([0, 1, 2, 0, 2, 3]).tobytes(), *images]
    views, body = [], b""
    for part in parts:
        views.append({"buffer": 0, "byteOffset": len(body), "byteLength": len(part)})
        body += part + b"\0" * (-len(part) % 4)
    accessors = [
        {"bufferView": i, "componentType": 5126, "count": 4, "type": f"VEC{values.shape[1]}"}
        for i, values in enumerate(columns.values())
    ]
    accessors[0] |= {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 0.0]}
    accessors.append({"bufferView": 4, "componentType": 5123, "count": 6, "type": "SCALAR"})
    material = {
        "name": "cloud",
        "doubleSided": True,
        "pbrMetallicRoughness": {"metallicFactor": 0.0, "metallicRoughnessTexture": {"index": 0}},
        "extras": {"leafcloud": {"bentNormalTexture": {"index": 1}} if shading else {}},
    }
    primitive = {"attributes": {name: i for i, name in enumerate(columns)}, "indices": 4, "material": 0}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "extras": {"leafcloud": {"level": 0, "centre": [0.5, 0.5, 0.0], "radius": 0.5**0.5}}}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [material],
        "textures": [{"source": 0}, {"source": 1}],
        "images": [{"bufferView": 5 + i, "mimeType": "image/png"} for i in range(2)],
        "bufferViews": views,
        "accessors": accessors,
        "buffers": [{"byteLength": len(body)}],
    }
    text = json.dumps(document).encode()
    chunks = ((0x4E4F534A, text + b" " * (-len(text) % 4)), (0x004E4942, body))
    content = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(content)) + content)
    return path


def lights_of(file: Path, suns: Floats, eye: tuple[float, float, float]) -> Floats:
    """Return the light in the middle of the viewer's picture for each of the suns."""
    url = f"{FILES}{file.name}"
    question = {"tree": url, "settings": {}, "eyes": [eye] * len(suns), "suns": suns.tolist()}
    seen = ask(PAGE, question, patience=PATIENCE, files=file.parent)["seen"]
    pixels = [np.frombuffer(base64.b64decode(each["pixels"]), "<f4").reshape(64, 64, 4) for each in seen]
    return np.array([picture[32, 32, 1] for picture in pixels], float)


@pytest.mark.parametrize(
    ("opened", "toward"),
    [(0.3, (0.2, -0.1, 0.15)), (0.2, (0.1, 0.3, 0.2)), (0.7, (-0.3, 0.2, -0.3)), (0.5, (0.4, -0.4, 0.3))],
)
def test_the_textures_multiply_the_light_of_a_sun(
    tmp_path: Path, opened: float, toward: tuple[float, float, float]
) -> None:
    codes = (code(toward[0]), code(toward[1]), code(toward[2]))
    written = round(opened * 255.0)
    shaded = write_quad(tmp_path / "shaded.glb", written, codes, shading=True)
    plain = write_quad(tmp_path / "plain.glb", written, codes, shading=False)
    moment = 2.0 * np.array(codes) / 255.0 - 1.0
    strength = float(np.linalg.norm(moment))
    suns = np.array([[0.0, 0.0, 1.0], [0.8, 0.0, 0.6], [0.0, -0.8, 0.6]])
    cosines = suns @ AXES.T @ moment / strength
    expected = [sun_share(written / 255.0, strength, cosine) for cosine in cosines.tolist()]
    assert np.ptp(expected) > 0.1, "the suns have equal shares"
    assert lights_of(shaded, suns, EYE) / lights_of(plain, suns, EYE) == pytest.approx(expected, abs=0.01)


def test_the_back_has_the_same_sky_as_the_front(tmp_path: Path) -> None:
    """The texture stores the sky at a place. A view from behind with the sun behind uses the open sky there."""
    codes = (code(0.0), code(0.0), code(-0.4))
    shaded = write_quad(tmp_path / "shaded.glb", 77, codes, shading=True)
    plain = write_quad(tmp_path / "plain.glb", 77, codes, shading=False)
    suns, eye = np.array([[0.0, 0.0, -1.0]]), (EYE[0], EYE[1], -EYE[2])
    share = lights_of(shaded, suns, eye) / lights_of(plain, suns, eye)
    assert share == pytest.approx(sun_share(77 / 255.0, abs(2.0 * codes[2] / 255.0 - 1.0), 1.0), abs=0.01)
