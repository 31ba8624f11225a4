"""A planted forest as a GLB file: `EXT_mesh_gpu_instancing` puts each tree where Blender draws it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from command_line import QUICK, bake, saved
from glb import read_glb
from mathutils import Euler, Matrix, Vector
from numpy.typing import NDArray
from scenes import add_mesh, import_part

from addon.errors import ExportError
from addon.export.forest_file import add_instances, write_forest
from addon.export.gltf import y_up
from leafcloud._glb import GlbFile

STANDS = Matrix.LocRotScale(Vector((2.0, -1.0, 0.5)), Euler((0.2, -0.3, 0.9)), Vector((0.4, 0.4, 0.4)))
"""Where the baked tree stands."""
POINTS = [(0.0, 0.0, 0.0), (7.0, 0.0, 1.0), (0.0, 9.0, -2.0), (30.0, 4.0, 0.0)]


@pytest.fixture(scope="module")
def folder(shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a bake of a tree that is moved, turned and scaled."""
    out = tmp_path_factory.mktemp("forest")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    import_part(shrub)
    for obj in bpy.context.scene.objects:
        if obj.parent is None:
            obj.matrix_world = STANDS @ obj.matrix_world
    bake(saved(out / "shrub.blend"), out / "out", *QUICK, "--levels", 1, "--engine", "three")
    return out / "out"


def planted(folder: Path) -> bpy.types.Object:
    """Open the bake, and plant a forest of its tree."""
    bpy.ops.wm.open_mainfile(filepath=str(folder / "shrub.blend"))
    ground = add_mesh("Points", POINTS, [])
    bpy.context.view_layer.objects.active = ground
    assert bpy.ops.leafcloud.forest() == {"FINISHED"}
    return ground


def blender_s_boxes(ground: bpy.types.Object) -> NDArray[np.float64]:
    """Return the box (2, 3) of each tree's leaves as Blender draws them without levels, Y-up."""
    variant = bpy.data.collections["shrub_forest"].children[0].objects[0]
    points = np.empty((len(variant.data.vertices), 3), np.float32)
    variant.data.vertices.foreach_get("co", points.ravel())
    graph = bpy.context.evaluated_depsgraph_get()
    found = []
    for instance in graph.object_instances:
        drawn = instance.is_instance and instance.parent.original == ground
        if drawn and not instance.object.name.endswith("trunk"):
            world = np.array(instance.matrix_world)
            placed = y_up(points @ world[:3, :3].T + world[:3, 3])
            found.append([placed.min(axis=0), placed.max(axis=0)])
    return np.array(found)


def boxes_in(file: Path) -> NDArray[np.float64]:
    """Return the box of each tree's leaves in a file, by the words of the extension."""
    level = read_glb(file)["shrub_LOD0"]
    opened = GlbFile(file)
    node = next(each for each in opened.items("nodes") if each["name"] == "shrub_LOD0")
    attributes = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
    points = level.primitives[0].attributes["POSITION"].astype(float)
    found = []
    for place, (x, y, z, w), scale in zip(
        *(opened.values(attributes[name]).astype(float) for name in ("TRANSLATION", "ROTATION", "SCALE")), strict=True
    ):
        axis = np.array([x, y, z])
        turned = points * scale
        turned = turned + 2.0 * w * np.cross(axis, turned) + 2.0 * np.cross(axis, np.cross(axis, turned))
        placed = level.to_world(turned + place)
        found.append([placed.min(axis=0), placed.max(axis=0)])
    return np.array(found)


def test_trees_stand_where_blender_draws_them(
    registered: None, folder: Path, gltf_issues: Callable[..., list[dict[str, Any]]]
) -> None:
    ground = planted(folder)
    boxes = blender_s_boxes(ground)
    assert len(boxes) == len(POINTS)
    assert bpy.ops.leafcloud.export_forest(directory=str(folder)) == {"FINISHED"}
    file = folder / "shrub_forest.glb"
    assert np.abs(boxes_in(file) - boxes).max() < 1e-4
    assert [
        issue for issue in gltf_issues(file) if "ktx2" not in issue["message"] and "Image" not in issue["message"]
    ] == []
    content = GlbFile(file).document
    assert "EXT_mesh_gpu_instancing" in content["extensionsUsed"]
    assert "EXT_mesh_gpu_instancing" not in content.get("extensionsRequired", []), "others show one tree"


def test_a_forest_needs_the_files_of_its_trees(registered: None, folder: Path, tmp_path: Path) -> None:
    planted(folder)
    with pytest.raises(RuntimeError, match=r"shrub\.glb is not in .*: choose the folder with the files of all trees"):
        bpy.ops.leafcloud.export_forest(directory=str(tmp_path))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", [b"", b"glTF", b"glTF" + bytes(12) + b"\x02\0\0\0JSON[]"])
def test_a_damaged_tree_is_refused(tmp_path: Path, content: bytes) -> None:
    tree = tmp_path / "tree.glb"
    tree.write_bytes(content)
    with pytest.raises(ExportError, match=r"tree\.glb is no file of a baked tree"):
        write_forest(tree, tmp_path / "forest.glb", np.eye(4)[None])
    assert not (tmp_path / "forest.glb").exists()


def test_a_tree_with_several_scales_has_no_places() -> None:
    node = {"name": "tree_LOD0", "scale": [1.0, 2.0, 1.0]}
    turned = np.array(Matrix.Rotation(0.7, 4, "Y"))[None]
    with pytest.raises(ExportError, match=r"tree_LOD0 is scaled by 1, 2, 1"):
        add_instances(None, node, turned)  # type: ignore[arg-type]
    turned[0] = np.diag([1.0, 1.0, 3.0, 1.0])
    with pytest.raises(
        ExportError, match=r"a place of the forest is scaled by 1, 1, 3: .* apply the scale of its object"
    ):
        add_instances(None, {"name": "tree_LOD0"}, turned)  # type: ignore[arg-type]
