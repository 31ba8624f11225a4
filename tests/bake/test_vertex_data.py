"""Vertex data for shaders: files store each number once, in the form that the engine's importer keeps."""

from __future__ import annotations

import base64
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bakes import folder_of, kept
from browser import ask
from command_line import QUICK, bake, report_in, saved
from glb import read_chunks, read_glb
from godot import read_as_godot
from night import rest_at_night
from node_trees import new_material
from numpy.typing import NDArray
from scenes import add_mesh, import_part
from viewing import PAGE, PATIENCE

from addon.settings.choices import ENGINES

BY_NAME = ("generic", "three", "bevy")
BY_COORDINATES = ("babylon", "godot", "unity", "unreal")
PRUNING = ("--chain", "both", "--prune-pixels", "24")
"""Level 1 takes over where some of the shrub's leaves are pruned already."""

PLAIN, PRUNED, WINDY = 44, 32, 48
"""Bytes per leaf vertex. PLAIN: position, normal, texture coordinates, morph target. PRUNED, added by pruning: rank and
two pivots. WINDY, added by pruning and wind: also the billboard pivot, phase and flutter."""


@pytest.fixture(scope="module")
def folders() -> dict[str, Path]:
    """Folders of two bakes of the shrub with pruning and wind, one engine for each form of vertex data."""
    return {engine: folder_of(engine) for engine in ("generic", "godot")}


def own_rows(mesh: bpy.types.Mesh) -> set[tuple[float, ...]]:
    """Return a row per vertex, Y up: position, rank, pivot, pivot target, phase, billboard pivot, flutter."""

    def read(name: str, key: str, width: int) -> NDArray[np.float32]:
        values = np.empty(width * len(mesh.vertices), np.float32)
        mesh.attributes[name].data.foreach_get(key, values)
        return values.reshape(-1, width)

    def y_up(name: str) -> NDArray[np.float32]:
        x, y, z = read(name, "vector", 3).T
        return np.stack([x, z, -y], axis=1)

    def number(name: str, missing: float) -> NDArray[np.float32]:
        there = name in mesh.attributes
        return read(name, "value", 1) if there else np.full((len(mesh.vertices), 1), missing, np.float32)

    columns = [
        *(y_up("position"), number("leaf_rank", -1.0), y_up("leaf_pivot")),
        *(y_up("leaf_pivot_target"), number("leaf_phase", 0.0)),
        *(y_up("leaf_billboard_pivot"), number("leaf_flutter", 0.0)),
    ]
    return set(map(tuple, np.hstack(columns).tolist()))


@pytest.mark.parametrize("level", [0, 1])
def test_godot_gets_rank_pivots_and_wind_in_its_three_vectors(folders: dict[str, Path], level: int) -> None:
    """The vectors equal the level's attributes in every bit."""
    name = f"shrub_LOD{level}"
    surfaces = read_as_godot(folders["godot"] / f"{name}.glb")[name]
    rows = {tuple(row) for each in surfaces for row in np.hstack([each.vertices, *each.customs]).tolist()}
    bpy.ops.wm.open_mainfile(filepath=str(folders["godot"] / "shrub.blend"))
    assert [custom.shape[1] for each in surfaces for custom in each.customs] == [4, 4, 4]
    assert rows == own_rows(bpy.data.objects[name].data)


def test_godot_gets_two_vectors_without_wind() -> None:
    folder = kept(*QUICK, "--levels", 1, *PRUNING, "--engine", "godot")
    [surface] = read_as_godot(folder / "shrub.glb")["shrub_LOD0"]
    assert [custom.shape[1] for custom in surface.customs] == [4, 4]
    ranks = surface.customs[0][surface.indices, 0]
    assert (ranks == ranks[:, :1]).all()
    assert len(np.unique(ranks)) > 600
    assert len(surface.blend_shapes) == 1
    [cross] = read_as_godot(folder / "shrub_LOD2.glb")["shrub_LOD2"]
    assert cross.customs == []


def test_both_forms_hold_the_same_numbers(folders: dict[str, Path]) -> None:
    """The texture coordinates hold the named attributes in the order of Godot's vectors."""
    named, packed = (read_glb(folders[engine] / "shrub.glb") for engine in ("generic", "godot"))
    for level in (0, 1):
        for one, other in zip(*(nodes[f"shrub_LOD{level}"].primitives for nodes in (named, packed)), strict=True):
            sets = np.hstack([other.attributes[f"TEXCOORD_{number}"] for number in range(2, 8)])
            missing = np.tile(np.float32([-1.0, 0.0, 0.0]), (len(sets), 1))
            numbers = one.attributes.get("_LEAF_RANK", missing)
            expected = [
                *(numbers[:, :1], one.attributes["_LEAF_PIVOT"]),
                *(one.attributes["_LEAF_PIVOT_TARGET"], numbers[:, 1:2]),
                *(one.attributes["_LEAF_BILLBOARD_PIVOT"], numbers[:, 2:]),
            ]
            assert np.array_equal(sets, np.hstack(expected))
            assert not [name for name in other.attributes if name.startswith("_")]
            assert not [name for name in one.attributes if name.startswith("TEXCOORD_") and name != "TEXCOORD_0"]
    assert named["shrub_LOD0"].mesh_extras["leafcloud"].get("first_texcoord") is None
    assert packed["shrub_LOD0"].mesh_extras["leafcloud"]["first_texcoord"] == 2


def bytes_of_a_vertex(path: Path, node: str) -> float:
    """Return the bytes per vertex of a node's leaves in the file. Each accessor counts once."""
    document, _ = read_chunks(path)
    [mesh] = [document["meshes"][each["mesh"]] for each in document["nodes"] if each["name"] == node]
    primitive = mesh["primitives"][0]
    uses = [primitive["attributes"], *primitive.get("targets", [])]
    numbers = {number for values in uses for number in values.values()}
    views = [document["bufferViews"][document["accessors"][number]["bufferView"]] for number in numbers]
    count = document["accessors"][primitive["attributes"]["POSITION"]]["count"]
    return sum(view["byteLength"] for view in views) / count


@pytest.mark.parametrize("engine", ["generic", "godot"])
def test_each_number_is_stored_once(engine: str, folders: dict[str, Path]) -> None:
    """Padding is at most four bytes per vertex. Files have no unused accessors and buffer views."""
    pruned = kept(*QUICK, "--levels", 1, *PRUNING, "--engine", engine)
    spare = 4 if engine == "generic" else 0
    assert bytes_of_a_vertex(pruned / "shrub.glb", "shrub_LOD0") <= PLAIN + PRUNED + spare
    assert bytes_of_a_vertex(folders[engine] / "shrub.glb", "shrub_LOD0") == PLAIN + WINDY
    document, binary = read_chunks(folders[engine] / "shrub.glb")
    primitives = [primitive for mesh in document["meshes"] for primitive in mesh["primitives"]]
    sets = [values for each in primitives for values in (each["attributes"], *each.get("targets", []))]
    used = {number for values in sets for number in values.values()} | {each["indices"] for each in primitives}
    assert used == set(range(len(document["accessors"])))
    assert len(binary) <= sum(view["byteLength"] + 3 for view in document["bufferViews"]) + 3
    # Trunks do not morph: their targets share one buffer view of zeros.
    tables = [(mesh["primitives"], mesh.get("extras", {}).get("leafcloud", {})) for mesh in document["meshes"]]
    trunks = [each for found, table in tables for each in found[table.get("first_trunk_primitive", len(found)) :]]
    still = {target["POSITION"] for trunk in trunks for target in trunk.get("targets", [])}
    assert len({document["accessors"][number]["bufferView"] for number in still}) == 1


@pytest.mark.night
@pytest.mark.parametrize("chain", ["billboards", "both"])
def test_files_without_pruning_store_no_ranks(chain: str) -> None:
    """At the default epsilon the shrub's leaves are too large for `both`: level 1 takes over before any is pruned."""
    folder = kept(*QUICK, "--levels", 1, "--epsilon", 0.04, "--chain", chain)
    states = {effect["name"]: effect["on"] for effect in report_in(folder)["effects"]}
    assert (states["pruning"], states["contrast"]) == (False, False)
    assert bytes_of_a_vertex(folder / "shrub.glb", "shrub_LOD0") == PLAIN


def test_every_engine_has_its_form() -> None:
    assert set(BY_NAME) | set(BY_COORDINATES) == set(ENGINES)


@pytest.mark.parametrize("engine", rest_at_night(["generic", "godot", *BY_NAME[1:], "babylon", "unity", "unreal"], 2))
def test_engines_get_the_form_that_their_importers_keep(
    engine: str, shrub: Path, tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]
) -> None:
    quick = ("--levels", 1, "--texture-size", 64, "--epsilon", 0.2, "--quality", 0.1)
    import_part(shrub)
    source, out = saved(tmp_path / "shrub.blend"), tmp_path / "out"
    bake(source, out, *quick, "--effects", "transitions,pruning", "--engine", engine)
    [leaves] = read_glb(out / "shrub.glb")["shrub_LOD0"].primitives
    named = {"_LEAF_RANK", "_LEAF_PIVOT", "_LEAF_PIVOT_TARGET", "TEXCOORD_0"}
    sets = {f"TEXCOORD_{number}" for number in range(6)}
    assert set(leaves.attributes) - {"POSITION", "NORMAL"} == (named if engine in BY_NAME else sets)
    assert [issue for issue in gltf_issues(*out.glob("*.glb")) if issue["severity"] == 0] == []


def test_attributes_by_name_survive_blender_s_importer(folders: dict[str, Path]) -> None:
    """Blender's importer fails on attributes of different widths with some orders of names, so try three hash seeds."""
    script = "import bpy, sys; bpy.ops.import_scene.gltf(filepath=sys.argv[-1])"
    for seed in ("0", "3", "4"):
        command = [sys.executable, "-c", script, str(folders["generic"] / "shrub_LOD0.glb")]
        done = subprocess.run(
            command,
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert "Traceback" not in done.stderr, done.stderr


def test_three_uv_maps_do_not_move_the_sets_of_vertex_data(tmp_path: Path) -> None:
    """Materials that name three UV maps give three equal sets."""
    corners, faces, materials = [], [], []
    for number in range(12):
        x, y, z = number % 4, number // 4, 0.3 * number
        corners += [(x, y, z), (x + 0.4, y, z), (x, y + 0.4, z)]
        faces.append((3 * number, 3 * number + 1, 3 * number + 2))
    for number in range(3):
        leaf, shader, tree = new_material()
        leaf.name = f"leaf_{number}"
        image = bpy.data.images.new(f"image_{number}", 4, 4)
        image.pixels[:] = [0.2, 0.5, 0.1, 1.0] * 16
        image.pack()
        texture, places = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeUVMap")
        texture.image, places.uv_map = image, f"map_{number}"
        tree.links.new(places.outputs[0], texture.inputs[0])
        tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
        materials.append(leaf)
    obj = add_mesh("leaves", corners, faces, materials=materials)
    for number in range(3):
        obj.data.uv_layers.new(name=f"map_{number}")
    for polygon in obj.data.polygons:
        polygon.material_index = polygon.index % 3
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "tree.blend"))
    effects = ("--effects", "transitions,pruning", "--levels", 1, "--texture-size", 64, "--quality", 0.1)
    bake(tmp_path / "tree.blend", tmp_path / "out", *effects, "--engine", "godot")
    surfaces = read_as_godot(tmp_path / "out" / "tree.glb")["tree_LOD0"]
    assert len(surfaces) == 3
    for surface in surfaces:
        ranks = surface.customs[0][:, 0]
        assert ((ranks >= 0.0) & (ranks < 1.0)).all()
        assert len(np.unique(ranks)) == 4
    document, _ = read_chunks(tmp_path / "out" / "tree.glb")
    assert "texCoord" not in str(document["materials"])


@pytest.mark.browser
def test_the_viewer_moves_leaves_equally_with_both_forms(folders: dict[str, Path]) -> None:
    node = read_glb(folders["generic"] / "shrub.glb")["shrub_LOD0"]
    extras = node.extras["leafcloud"]
    centre = node.to_world(np.array([extras["centre"]]))[0]
    away = 0.5 * (extras["transition_start"] + extras["transition_end"])
    question = {
        "tree": "/files/shrub.glb",
        "settings": {"pruneStart": 0.7 * away},
        "eyes": [(centre + away * np.array([0.6, 0.48, 0.64])).tolist()],
        "seconds": 2.0,
    }
    seen = [ask(PAGE, question, patience=PATIENCE, files=folders[form])["seen"][0] for form in ("generic", "godot")]
    one, other = (np.frombuffer(base64.b64decode(each["meshes"][0]["places"]), "<f4") for each in seen)
    assert np.array_equal(one, other)
    [primitive] = node.primitives
    moved = np.linalg.norm(one.reshape(-1, 3) - primitive.attributes["POSITION"], axis=1)
    assert moved.max() > 0.01
    assert seen[0]["meshes"][0]["count"] < 3 * len(primitive.indices)
