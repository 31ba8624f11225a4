"""Differences between Blender versions: inputs of geometry-node modifiers, EEVEE's name, custom normals."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from addon import versions

pytestmark = pytest.mark.version

FREE_NORMALS = bpy.app.version >= (4, 5, 0)


@pytest.fixture
def modifier() -> bpy.types.NodesModifier:
    """Return a modifier with one input of each type."""
    tree = bpy.data.node_groups.new("Inputs", "GeometryNodeTree")
    for kind in ("Float", "Int", "Bool", "Vector"):
        tree.interface.new_socket(f"A {kind}", in_out="INPUT", socket_type=f"NodeSocket{kind}")
    tree.interface.new_socket("An Output", in_out="OUTPUT", socket_type="NodeSocketFloat")
    obj = bpy.data.objects.new("Object", bpy.data.meshes.new("Mesh"))
    bpy.context.scene.collection.objects.link(obj)
    modifier = obj.modifiers.new("Inputs", "NODES")
    modifier.node_group = tree
    return modifier


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("A Float", 2.5, 2.5),
        ("A Float", 3, 3.0),
        ("A Float", np.float32(0.5), 0.5),
        ("A Int", np.int64(7), 7),
        ("A Bool", True, True),
        ("A Bool", 0, False),
        ("A Vector", (1.0, 2.0, 3.0), (1.0, 2.0, 3.0)),
        ("A Vector", np.array([4, 5, 6]), (4.0, 5.0, 6.0)),
    ],
)
def test_a_modifier_input_keeps_its_value_and_type(
    modifier: bpy.types.NodesModifier, name: str, value: Any, expected: Any
) -> None:
    versions.set_modifier_input(modifier, name, value)
    stored = versions.get_modifier_input(modifier, name)
    assert stored == expected
    assert type(stored) is type(expected)


def test_an_unknown_modifier_input_raises_with_the_known_names(modifier: bpy.types.NodesModifier) -> None:
    expected = "'Inputs' has no input 'An Output', it has .*A Float.*A Vector"
    with pytest.raises(KeyError, match=expected):
        versions.set_modifier_input(modifier, "An Output", 1.0)
    with pytest.raises(KeyError, match=expected):
        versions.get_modifier_input(modifier, "An Output")


def test_blender_accepts_the_name_of_eevee() -> None:
    bpy.context.scene.render.engine = versions.eevee_engine()
    assert bpy.context.scene.render.engine == versions.eevee_engine()


@pytest.fixture
def mesh() -> bpy.types.Mesh:
    """Return a mesh of two triangles that share an edge. The mesh has six corners."""
    mesh = bpy.data.meshes.new("Two Triangles")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0.25), (1, 1, 0)], [], [(0, 1, 2), (2, 1, 3)])
    return mesh


def unit_vectors(count: int, seed: int) -> NDArray[np.float32]:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


def corner_normals(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    normals = np.empty((len(mesh.loops), 3), np.float32)
    mesh.corner_normals.foreach_get("vector", normals.ravel())
    return normals


def assert_stored(mesh: bpy.types.Mesh, normals: NDArray[np.float32]) -> None:
    if FREE_NORMALS:
        assert np.array_equal(corner_normals(mesh), normals)
    else:
        np.testing.assert_allclose(corner_normals(mesh), normals, atol=2e-4)


@pytest.mark.parametrize("smooth", [False, True])
def test_corner_normals_are_stored(mesh: bpy.types.Mesh, smooth: bool) -> None:
    mesh.polygons.foreach_set("use_smooth", np.full(2, smooth))
    normals = unit_vectors(6, seed=1)
    versions.set_corner_normals(mesh, normals)
    assert_stored(mesh, normals)
    assert mesh.has_custom_normals


def test_corner_normals_replace_earlier_ones(mesh: bpy.types.Mesh) -> None:
    # Blender's own function stores encoded normals, an attribute of another type than free normals.
    mesh.normals_split_custom_set(unit_vectors(6, seed=1))
    for seed in (2, 3):
        normals = unit_vectors(6, seed)
        versions.set_corner_normals(mesh, normals)
        assert_stored(mesh, normals)


def test_corner_normals_may_be_f64_or_strided(mesh: bpy.types.Mesh) -> None:
    normals = unit_vectors(12, seed=4)
    versions.set_corner_normals(mesh, normals[::2].astype(np.float64))
    assert_stored(mesh, normals[::2])


def test_a_wrong_number_of_corner_normals_raises(mesh: bpy.types.Mesh) -> None:
    with pytest.raises(ValueError, match=r"'Two Triangles' have shape \(4, 3\), expected \(6, 3\)"):
        versions.set_corner_normals(mesh, unit_vectors(4, seed=5))
    assert not mesh.has_custom_normals
