"""Each level of a file is one mesh: the trunk's primitives follow those of the leaves, at the trunk's own place."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from glb import Node, Primitive, read_glb
from mathutils import Euler, Matrix, Vector
from plan_scenes import add_crown
from scenes import add_mesh, bake, material, read

from addon.bake.values import TreeSet
from addon.export.files import write
from addon.export.gltf import y_up
from addon.settings.bake import BakeSettings

CORNERS = [(0.0, 0.0, -1.0), (0.2, 0.0, -1.0), (0.0, 0.3, -1.0), (0.1, 0.1, 1.0)]
FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
"""A closed tetrahedron with its normals outward: its signed volume is positive."""

PLACES = {
    "in place": Matrix(),
    "moved and turned": Matrix.LocRotScale(Vector((0.3, -0.2, 0.1)), Euler((0.3, 1.0, -2.0)), Vector((1.0, 2.0, 0.5))),
    "mirrored": Matrix.LocRotScale(Vector((0.1, 0.0, 0.0)), Euler((0.0, 0.4, 0.0)), Vector((-1.0, 1.0, 1.0))),
}


@pytest.fixture(params=PLACES)
def trunk(request: pytest.FixtureRequest) -> bpy.types.Object:
    add_crown(material("leaf"))
    return add_mesh("trunk", CORNERS, FACES, materials=[material("bark")], matrix=PLACES[request.param])


def written(folder: Path, name: str) -> dict[str, Node]:
    settings = BakeSettings(epsilon=0.2, quality=0.1, texture_size=64, levels=1, effects="transitions", files="levels")
    result = bake(read(leaf_names=["leaf"]), settings)
    write(TreeSet.of(result), folder, lambda *_: None, blend=False)
    return read_glb(folder / f"{result.collection.name}{name}.glb")


def volume(node: Node, primitive: Primitive) -> float:
    corners = node.to_world(primitive.attributes["POSITION"])[primitive.indices]
    return float(np.linalg.det(corners).sum()) / 6.0


def test_the_trunk_is_at_its_place_and_has_its_front_outside(trunk: bpy.types.Object, tmp_path: Path) -> None:
    places = np.array([trunk.matrix_world @ vertex.co for vertex in trunk.data.vertices], np.float32)
    nodes = written(tmp_path, "")
    for number in (0, 1):
        [node] = [each for each in nodes.values() if each.extras.get("leafcloud", {}).get("level") == number]
        [bark] = node.trunk
        assert bark.material["name"] == "bark"
        found = node.to_world(bark.attributes["POSITION"])
        nearest = np.linalg.norm(found[:, None] - y_up(places)[None], axis=2).min(axis=1)
        assert nearest.max() < 1e-6
        assert volume(node, bark) == pytest.approx(abs(trunk.matrix_world.determinant()) * 0.02, rel=1e-4)
        middle = found.mean(axis=0)
        normals = node.to_world(bark.attributes["NORMAL"]) - node.matrix[:3, 3]
        assert (np.einsum("ij,ij->i", normals, found - middle) > 0.0).all()
        assert np.linalg.norm(bark.attributes["NORMAL"], axis=1) == pytest.approx(1.0)


def test_the_trunk_stays_while_the_leaves_morph(trunk: bpy.types.Object, tmp_path: Path) -> None:
    [leaves] = [node for node in written(tmp_path, "_LOD0").values() if node.primitives]
    [bark] = leaves.trunk
    [target] = bark.targets
    assert target["POSITION"].shape == bark.attributes["POSITION"].shape
    assert not target["POSITION"].any()
    assert all(len(primitive.targets) == 1 for primitive in leaves.primitives)
