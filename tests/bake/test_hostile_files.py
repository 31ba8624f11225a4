"""Hostile files: refused before Blender reads them, in one line that names the fault.

Without the checks, Blender's importers hang on these files, fill the memory, read files elsewhere, or fail with a
traceback.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest
from command_line import refusal, refusal_apart, run_apart
from hostile_blends import blend_cases
from hostile_files import Case, gltf_cases, obj_cases
from hostile_masses import mass_cases
from night import rest_at_night

from addon.errors import SceneError
from addon.mesh.extract import extract
from addon.scene.image_sizes import declared_size
from addon.scene.load import load


def _cases() -> Iterator[Case]:
    yield from gltf_cases()
    yield from obj_cases()
    yield from blend_cases()
    yield from mass_cases()


CASES = {case.name: case for case in _cases()}

REFUSED = {
    "path buffer 'pipe'": "pipe is a pipe, not a file",
    "path buffer '/dev/zero'": "'/dev/zero' outside of the folder",
    "path buffer '../outside.dat'": "/../outside.dat' outside of the folder",
    "path buffer '%2e%2e/outside.dat'": "/../outside.dat' outside of the folder",
    "path buffer 'link'": "/link' outside of the folder",
    "path buffer 'sparse'": "sparse is sparse: ",
    "path buffer 'nul%00'": "which is no path",
    "path image 'pipe'": "pipe is a pipe, not a file",
    "path image '/dev/zero'": "'/dev/zero' outside of the folder",
    "path image 'link'": "/link' outside of the folder",
    "sparse tree.gltf of 100000000000": "of its 100000000000 bytes",
    "sparse tree.glb of 100000000000": "of its 100000000000 bytes",
    "number accessors.0.count = 9223372036854775808": "accessors[0].count is 9223372036854775808, but must be",
    "number accessors.0.byteOffset = 2147483648": "accessors[0] ends at byte 2147484800, but bufferViews[0] has 1152",
    "number bufferViews.0.byteOffset = -1": "bufferViews[0].byteOffset is -1, but must be a whole number from 0",
    "number meshes.0.primitives.0.indices = True": "primitives[0].indices is True, but must be a number from 0 to 5",
    "number nodes.0.children.0 = 2147483648": "nodes[0].children[0] is 2147483648, but must be a number from 0 to 3",
    "name nodes 'half \\ud800'": "nodes[1].name is 'half \\ud800', but must be a text",
    "structure own child": "nodes[0] is its own parent",
    "structure loop": "is its own parent",
    "structure 5000 parents": "has more than 200 parents",
    "structure 500 lists in extras": "at most 64 levels",
    "structure 100000 objects in extras": "at most 64 levels",
    "structure 1000000 nodes": "values, more than 2000000",
    "structure 20000 nodes": "nodes is a list of 20000 entries, but must be a list of 0 to 10000",
    "structure 3000 primitives": "primitives is a list of 3000 entries, but must be a list of 1 to 2000",
    "structure extras of a mesh = {'\\ud800': 1}": "half of a surrogate pair",
    "bomb png 16384 view": "images[0] has 16384 × 16384 texels",
    "bomb jpeg 30000 data": "images[0] has 30000 × 30000 texels",
    "bomb 2147483647 zeros": "without a 'bufferView' have 25769803764 bytes",
    "bomb 500000 instances": "500004 objects, more than 10000",
    "obj library 'pipe'": "pipe is a pipe, not a file",
    "obj image 'pipe'": "pipe is a pipe, not a file",
    "obj option 'pipe'": "pipe is a pipe, not a file",
    "obj base 'pipe'": "pipe is a pipe, not a file",
    "obj image '/dev/zero'": "'/dev/zero' outside of the folder",
    "obj image '../outside.dat'": "/../outside.dat' outside of the folder",
    "obj library by default": "tree.mtl is a pipe, not a file",
    "obj sparse": "of its 2000000000 bytes",
    "obj sparse library": "of its 2000000000 bytes",
    "obj null bytes": "has null bytes",
    "obj bomb png": "leaf.png has 16384 × 16384 texels",
    "blend library is a pipe": "library.blend, which is a pipe or a device",
    "blend library is a device": "library.blend, which is a pipe or a device",
    "blend mass mesh cache //pipe": "pipe, which is a pipe or a device",
    "blend mass OBJ from //pipe": "pipe, which is a pipe or a device",
    "blend mass PLY from /dev/zero": "/dev/zero, which is a pipe or a device",
    "blend image //pipe": "pipe, which is a pipe or a device",
    "blend image /dev/zero": "/dev/zero, which is a pipe or a device",
    "blend generated image 16384": "image 'leaf' has 16384 × 16384 texels",
    "blend packed image 65536": "image 'leaf' has 65536 × 65536 texels",
    "blend indices out of range": "the vertices of corners of mesh 'leaves' have the number 1000000000",
    "blend 2000 parents": "has more than 200 parents",
    "blend sparse": "of its 100000000000 bytes",
    "blend zstd bomb": "more than the file",
}
"""By the names of cases: words of the message."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder. A case may write beside it."""
    (tmp_path / "in").mkdir()
    return tmp_path / "in"


@pytest.mark.parametrize("name", REFUSED)
def test_a_hostile_file_is_refused_in_one_line(name: str, folder: Path) -> None:
    source = CASES[name].write(folder)
    with pytest.raises(SceneError) as caught:
        load(source)
    line = str(caught.value)
    assert REFUSED[name] in line
    assert line.isprintable(), "a single line of text"
    assert len(line) < 600


@pytest.mark.parametrize("kind", ["glb", "gltf", "obj", "blend", "compressed blend"])
def test_the_tree_without_a_change_is_read(kind: str, folder: Path) -> None:
    load(CASES[f"fine {kind}"].write(folder))
    assert len(extract(bpy.context.evaluated_depsgraph_get(), None).leaves.triangles) >= 24


@pytest.mark.parametrize(
    "options",
    [
        {"export_format": "GLB"},
        {"export_format": "GLTF_SEPARATE", "export_texture_dir": "deep"},
        {"export_format": "GLB", "export_draco_mesh_compression_enable": True},
        {"export_format": "GLB", "export_gpu_instances": True},
        {"export_format": "GLB", "export_try_sparse_sk": True, "export_attributes": True},
    ],
    ids=lambda options: " ".join(map(str, options.values())),
)
def test_files_of_blenders_exporter_are_read(options: dict[str, object], shrub: Path, tmp_path: Path) -> None:
    """The shrub twice, with morph targets, an animation, bones, a light and a camera."""
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    leaves = bpy.data.objects["leaves"]
    leaves.shape_key_add(name="Basis")
    leaves.shape_key_add(name="moved").data[0].co = (0.0, 0.0, 2.0)
    leaves.data.attributes.new("_AGE", "FLOAT", "POINT")
    leaves.keyframe_insert("location", frame=1)
    bones = bpy.data.objects.new("bones", bpy.data.armatures.new("bones"))
    copy = bpy.data.objects["branches"].copy()
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SPOT"))
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    for obj in (bones, copy, lamp, camera):
        bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = bones
    bpy.ops.object.mode_set(mode="EDIT")
    bones.data.edit_bones.new("stem").tail = (0.0, 0.0, 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    skin = bpy.data.objects["branches"]
    skin.parent = bones
    skin.modifiers.new("bones", "ARMATURE").object = bones
    skin.vertex_groups.new(name="stem").add(range(len(skin.data.vertices)), 1.0, "REPLACE")
    path = tmp_path / ("tree.gltf" if options["export_format"] == "GLTF_SEPARATE" else "tree.glb")
    bpy.ops.export_scene.gltf(filepath=str(path), export_lights=True, export_cameras=True, **options)
    load(path)
    assert {"leaves", "branches", "bones", "lamp", "camera"} <= {obj.name for obj in bpy.data.objects}
    assert len(bpy.data.objects["leaves"].data.polygons) == 1344


def test_a_million_instances_are_refused(folder: Path, tmp_path: Path) -> None:
    source = CASES["blend 1000000 instances"].write(folder)
    line = refusal_apart(tmp_path / "out", "--input", source)
    assert "more than 10000000 triangles with all instances, counted to object 'ground'" in line


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a guard")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("blend mass subdivision 11", "more than 1 GiB of memory"),
        pytest.param("blend 25000000 instances", "more than 1 GiB of memory", marks=pytest.mark.night),
        ("blend mass 10⁹ children", "the bake crashed"),
    ],
)
def test_a_scene_that_no_check_can_judge_ends_in_one_line(name: str, words: str, folder: Path, tmp_path: Path) -> None:
    source = CASES[name].write(folder)
    assert words in refusal_apart(tmp_path / "out", "--input", source, "--memory", 1)


def test_files_in_folders_below_the_input_and_links_to_them_are_read(folder: Path) -> None:
    source = CASES["obj image 'gone.dat'"].write(folder)
    (folder / "deep").mkdir()
    (folder / "deep" / "leaf.png").write_bytes((folder / "leaf.png").read_bytes())
    (folder / "gone.dat").symlink_to("deep/leaf.png")
    load(source)
    assert bpy.data.images["gone.dat"].size[:] == (4, 4)


@pytest.mark.parametrize(
    ("form", "suffix"),
    [
        ("PNG", "png"), ("JPEG", "jpg"), ("BMP", "bmp"), ("TARGA", "tga"), ("TARGA_RAW", "tga"), ("TIFF", "tif"),
        ("WEBP", "webp"), ("OPEN_EXR", "exr"), ("HDR", "hdr"), ("JPEG2000", "jp2"), ("IRIS", "rgb"), ("DPX", "dpx"),
    ],
)  # fmt: skip
def test_the_size_of_an_image_is_read_from_its_start(form: str, suffix: str, tmp_path: Path) -> None:
    """Blender writes the images."""
    scene = bpy.context.scene
    scene.render.image_settings.file_format = form
    path = tmp_path / f"image.{suffix}"
    bpy.data.images.new("image", 137, 121).save_render(str(path), scene=scene)
    assert declared_size(path.read_bytes()) == (137, 121)


@pytest.mark.parametrize("name", rest_at_night(["blend driver", "blend script"]))
def test_a_bake_runs_no_script_of_a_file(name: str, folder: Path, tmp_path: Path) -> None:
    source = CASES[name].write(folder)
    done = run_apart("--input", source, "--out", tmp_path / "out", "--texture-size", 64, "--levels", 1)
    assert done.returncode == 0, done.stderr
    assert not (folder / "escaped").exists()


def test_control_characters_of_a_name_do_not_reach_the_terminal(tmp_path: Path) -> None:
    source = tmp_path / "a\x1b[31m\ntree.glb"
    source.write_bytes(b"no tree")
    assert "a\\x1b[31m tree.glb is not glTF" in refusal(tmp_path / "out", "--input", source)


def test_a_bake_of_a_hostile_file_ends_in_one_line(folder: Path, tmp_path: Path) -> None:
    source = CASES["structure loop"].write(folder)
    assert "is its own parent" in refusal_apart(tmp_path / "out", "--input", source)
