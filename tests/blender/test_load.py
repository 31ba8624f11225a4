"""Opening files of every supported type, and errors for broken files."""

from __future__ import annotations

import base64
import json
import math
import struct
from pathlib import Path

import bpy
import numpy as np
import pytest
from small_glb import QUAD, write_quad_glb

from addon.errors import SceneError
from addon.mesh.extract import extract
from addon.scene.load import load

pytestmark = pytest.mark.version

TRIANGLE_OBJ = "o leaves\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def triangles_in_scene() -> int:
    return len(extract(bpy.context.evaluated_depsgraph_get(), None).leaves.triangles)


def test_a_glb_replaces_the_open_scene(tmp_path: Path) -> None:
    bpy.context.collection.objects.link(bpy.data.objects.new("old", None))
    load(write_quad_glb(tmp_path / "tree.glb"))
    assert [obj.name for obj in bpy.data.objects] == ["leaves"]
    assert triangles_in_scene() == 2


def test_an_upper_case_suffix_and_a_text_path_are_accepted(tmp_path: Path) -> None:
    load(str(write_quad_glb(tmp_path / "TREE.GLB")))
    assert triangles_in_scene() == 2


@pytest.mark.parametrize("external", [True, False])
def test_a_gltf_with_an_external_or_embedded_buffer_is_read(tmp_path: Path, external: bool) -> None:
    _write_gltf(tmp_path / "tree.gltf", QUAD, external=external)
    load(tmp_path / "tree.gltf")
    assert triangles_in_scene() == 2


def test_an_obj_is_read(tmp_path: Path) -> None:
    (tmp_path / "tree.obj").write_text(TRIANGLE_OBJ)
    load(tmp_path / "tree.obj")
    assert triangles_in_scene() == 1


def test_a_blend_is_read(tmp_path: Path) -> None:
    mesh = bpy.data.meshes.new("leaves")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    bpy.context.collection.objects.link(bpy.data.objects.new("leaves", mesh))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "oak.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    load(tmp_path / "oak.blend")
    assert triangles_in_scene() == 1
    assert extract(bpy.context.evaluated_depsgraph_get(), None).name == "oak"


def test_a_blend_with_coordinates_that_are_not_finite_loads_but_extract_raises(tmp_path: Path) -> None:
    mesh = bpy.data.meshes.new("leaves")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, math.nan, 0)], [], [(0, 1, 2)])
    bpy.context.collection.objects.link(bpy.data.objects.new("leaves", mesh))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "oak.blend"))
    load(tmp_path / "oak.blend")
    with pytest.raises(SceneError, match="object 'leaves': vertex 2 lies at"):
        triangles_in_scene()


@pytest.mark.parametrize("name", ["gone.glb", "gone.gltf", "gone.obj", "gone.blend"])
def test_a_missing_file_raises(tmp_path: Path, name: str) -> None:
    with pytest.raises(SceneError) as caught:
        load(tmp_path / name)
    assert str(caught.value) == f"{tmp_path / name} does not exist, or is not a file; check the path"


def test_a_folder_raises(tmp_path: Path) -> None:
    (tmp_path / "folder.glb").mkdir()
    with pytest.raises(SceneError, match="does not exist, or is not a file"):
        load(tmp_path / "folder.glb")


@pytest.mark.parametrize("name", ["tree.dae", "tree", "tree.glb.zip"])
def test_an_unknown_file_type_raises_and_keeps_the_scene(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"")
    bpy.context.collection.objects.link(bpy.data.objects.new("old", None))
    with pytest.raises(SceneError) as caught:
        load(tmp_path / name)
    assert str(caught.value).startswith(
        f"{tmp_path / name} has an unsupported file type; give one of .glb, .gltf, .obj,"
    )
    assert "old" in bpy.data.objects


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_gltf_coordinates_that_are_not_finite_raise(tmp_path: Path, kind: str, bad: float) -> None:
    """Blender's importer would move the vertex to the origin without a warning."""
    path = tmp_path / f"tree.{kind}"
    positions = [*QUAD[:2], (0.5, bad, 0.25), QUAD[3]]
    if kind == "glb":
        write_quad_glb(path, positions=positions)
    else:
        _write_gltf(path, positions, external=True)
    with pytest.raises(SceneError) as caught:
        load(path)
    assert str(caught.value) == (
        f"{path}: vertex 2 of mesh 'quad' lies at (0.5, {bad:g}, 0.25), which is not finite; export it again"
    )


def test_an_obj_without_its_mtl_file_raises(tmp_path: Path) -> None:
    path = tmp_path / "tree.obj"
    path.write_text("mtllib my tree.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(SceneError, match=r"my tree\.mtl does not exist, but tree\.obj reads its materials from it"):
        load(path)
    (tmp_path / "my tree.mtl").write_text("newmtl leaves\n")
    load(path)


@pytest.mark.parametrize(
    ("line", "shown"), [("v 1 nan 0", "1, nan, 0"), ("v 1 0 -Inf", "1, 0, -inf"), ("v 1e39 0 0", "inf, 0, 0")]
)
def test_obj_coordinates_that_are_not_finite_raise(tmp_path: Path, line: str, shown: str) -> None:
    path = tmp_path / "tree.obj"
    path.write_text(f"# banana\nmtllib inf.mtl\nv 0 0 0\nv 1e2 1e-39 0\n\t{line}\nvn 0 0 1\nf 1 2 3\n")
    with pytest.raises(SceneError) as caught:
        load(path)
    assert str(caught.value) == (
        f"{path}: vertex 2 of the file lies at ({shown}), which is not finite; export it again"
    )


def test_an_obj_with_names_that_look_like_numbers_is_read(tmp_path: Path) -> None:
    (tmp_path / "tree.obj").write_text(TRIANGLE_OBJ + "# nan inf 1e99\nusemtl leaf_inf\n")
    load(tmp_path / "tree.obj")
    assert triangles_in_scene() == 1


@pytest.mark.parametrize("name", ["tree.glb", "tree.gltf", "tree.blend"])
@pytest.mark.parametrize("content", [b"", b"hello", b"[1, 2]", b"glTF", b"\xff\xfe\x00", b"BLENDER"])
def test_files_with_wrong_content_raise(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError) as caught:
        load(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name))
    assert "\n" not in str(caught.value)


def test_an_obj_without_faces_is_empty(tmp_path: Path) -> None:
    (tmp_path / "tree.obj").write_bytes(b"hello")
    load(tmp_path / "tree.obj")
    with pytest.raises(SceneError, match="there are no faces: no visible objects"):
        triangles_in_scene()


@pytest.mark.parametrize("share", [0.02, 0.2, 0.5, 0.99])
def test_a_truncated_glb_raises(tmp_path: Path, share: float) -> None:
    path = write_quad_glb(tmp_path / "tree.glb")
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(SceneError, match=r"tree\.glb is not glTF, or is broken"):
        load(path)


def test_a_gltf_without_its_buffer_raises(tmp_path: Path) -> None:
    _write_gltf(tmp_path / "tree.gltf", QUAD, external=True)
    (tmp_path / "the buffer.bin").unlink()
    with pytest.raises(SceneError) as caught:
        load(tmp_path / "tree.gltf")
    assert str(caught.value) == (
        f"{tmp_path / 'the buffer.bin'} cannot be read: No such file or directory; check the file and its permissions"
    )


def test_an_error_of_blenders_importer_is_passed_on(tmp_path: Path) -> None:
    path = tmp_path / "tree.gltf"
    path.write_text(json.dumps({"asset": {"version": "2.0"}, "extensionsRequired": ["FOO"], "extensionsUsed": ["FOO"]}))
    with pytest.raises(SceneError) as caught:
        load(path)
    words = "Extension FOO is not available on this addon version"
    assert str(caught.value) == f"{path} cannot be read: {words}; check the file, or export it again"


def _write_gltf(path: Path, positions: list[tuple[float, float, float]], *, external: bool) -> None:
    """Write the quad as .gltf, positions interleaved with zeros, with an external or embedded buffer."""
    vertices = np.zeros((4, 6), "<f4")
    vertices[:, :3] = positions
    body = vertices.tobytes() + struct.pack("<6I", 0, 1, 2, 0, 2, 3)
    if external:
        (path.parent / "the buffer.bin").write_bytes(body)
        uri = "the%20buffer.bin"
    else:
        uri = "data:application/octet-stream;base64," + base64.b64encode(body).decode()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "leaves", "mesh": 0}],
        "meshes": [{"name": "quad", "primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 96, "byteStride": 24},
            {"buffer": 0, "byteOffset": 96, "byteLength": 24},
        ],
        "buffers": [{"uri": uri, "byteLength": len(body)}],
    }
    path.write_text(json.dumps(document))
