"""Bake of the scene's light on both sides of leaves, by Cycles. The result is stored at the leaves' corners.

The stored value is the radiance of a white leaf, irradiance / π, so it multiplies base colors. A sun of strength S at
the angle θ gives S · cos θ / π; a world of one color gives that color. Light transmitted by the leaf itself is ignored;
light that other objects reflect and transmit counts.

The leaves cast shadows with their own materials, including cutout alpha. They do not receive the baked light
themselves, because leaf cards are transparent at their corners and touch the trunk and each other there. White
triangles that no ray hits receive it instead: three for each triangle of a leaf, with three samples each. A corner gets
the mean over its third of all triangles that share it with the same normal. So the mean over a leaf is correct, and
finer shadows are lost.

As in other Cycles renders, a triangle does not shadow itself, wherever its normals point: surfaces nearer than `near`
to a sample are transparent.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..geometry import Geometry, world_normals, world_positions, wound
from ..material.node_links import output_of
from ..versions import clear_terminator, set_corner_normals

SAMPLES = 16
"""Paths per sample. A corner has three samples or more, so at least 48 paths: within a few percent for an even sky."""

SEED = 0

PLACES = np.array([(10.0, 1.0, 1.0), (7.0, 4.0, 1.0), (7.0, 1.0, 4.0)]) / 12.0
"""Barycentric weights of a corner, the next and the previous one. All nine samples cover the triangle."""

BLOCK = 200_000
"""Triangles per bake. Cycles needs several kilobytes for each."""

LAYERS = 1024
"""Transparent bounces: the maximum of Cycles. With the default of 8, crowns of cards get darker than in engines, which
have no such limit."""

_ATTRIBUTE = "leafcloud light"


@dataclass(frozen=True)
class Light:
    """Light by corner: (t, 3, 3) linear RGB, in the order of the geometry. The front winds counter-clockwise."""

    front: NDArray[np.float32]
    back: NDArray[np.float32]

    def over(self, strength: float) -> Light:
        return Light(self.front / np.float32(strength), self.back / np.float32(strength))

    def at(self, order: NDArray[np.integer[Any]]) -> Light:
        """Return (c, 3) the light at the corners of the triangles `order`, one after another."""
        return Light(self.front[order].reshape(-1, 3), self.back[order].reshape(-1, 3))

    @property
    def nbytes(self) -> int:
        return self.front.nbytes + self.back.nbytes


@dataclass(frozen=True)
class LitScene:
    """The scene around a tree for a bake of light.

    layer: its lights, world and shadows count. sources: the objects that show the tree; they are hidden. casters:
    meshes in the tree's coordinates that cast shadows in place of the sources; their materials are replaced.
    """

    layer: bpy.types.ViewLayer
    sources: Sequence[bpy.types.Object]
    casters: Sequence[bpy.types.Mesh]


def bake_light(geometries: Sequence[Geometry], matrix: NDArray[np.float64], around: LitScene) -> list[Light]:
    """Return the light on each geometry. The scene stays unchanged, even after an error.

    `matrix`: (4, 4) from the geometries to the world.
    Raises `SceneError` if Cycles cannot bake.
    """
    places = [_places(geometry, matrix) for geometry in geometries]
    points = np.concatenate([each.points.reshape(-1, 3) for each in places])
    # The second term exceeds the rounding of single precision, 6e-8 of the coordinates.
    near = 1e-4 * float(np.ptp(points, axis=0).max()) + 1e-5 * float(np.abs(points).max())
    with _without(around.sources), _own_scene(around.layer) as layer, _casting(around.casters, matrix, layer, near):
        return [_light(each, layer, near, matrix) for each in places]


@dataclass(frozen=True)
class _Places:
    """World-space triangles: points and normals (t, 3, 3); shared (t, 3), equal for corners that share their light."""

    points: NDArray[np.float64]
    normals: NDArray[np.float32]
    shared: NDArray[np.int64]

    @property
    def across(self) -> NDArray[np.float64]:
        """(t, 3) triangle normals, their length twice the area."""
        a, b, c = self.points.transpose(1, 0, 2)
        return np.cross(b - a, c - a)


def _places(geometry: Geometry, matrix: NDArray[np.float64]) -> _Places:
    triangles = wound(geometry.triangles, matrix)
    normals = wound(world_normals(geometry, matrix), matrix)
    keys = np.concatenate([triangles[:, :, None], normals.view(np.int32)], axis=2).reshape(-1, 4)
    rows = np.ascontiguousarray(keys).view(np.dtype((np.void, 16))).ravel()
    _, shared = np.unique(rows, return_inverse=True)
    return _Places(world_positions(geometry, matrix)[triangles], normals, shared.reshape(-1, 3))


def _light(places: _Places, layer: bpy.types.ViewLayer, near: float, matrix: NDArray[np.float64]) -> Light:
    blocks = range(0, len(places.points), BLOCK)
    sides = [_block(places, slice(start, start + BLOCK), layer, near) for start in blocks]
    front, back = (_shared(np.concatenate(side), places) for side in zip(*sides, strict=True))
    return Light(wound(front, matrix), wound(back, matrix))


def _shared(values: NDArray[np.float32], places: _Places) -> NDArray[np.float32]:
    """Return (t, 3, 3) the area-weighted means over corners that share their light."""
    areas = np.repeat(np.linalg.norm(places.across, axis=1), 3) + 1e-30
    numbers = places.shared.ravel()
    total = np.bincount(numbers, areas)
    sums = [np.bincount(numbers, areas * channel) for channel in values.reshape(-1, 3).T]
    means: NDArray[np.float64] = np.stack(sums, axis=1) / total[:, None]
    return means[numbers].reshape(values.shape).astype(np.float32)


def _block(
    places: _Places, part: slice, layer: bpy.types.ViewLayer, near: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return (t, 3, 3) the light by corner on the fronts and on the backs of the triangles `part`."""
    corners, normals, across = places.points[part], places.normals[part].astype(np.float64), places.across[part]
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.divide(across, length, out=np.zeros_like(across), where=length > 0.0)[:, None]
    normals = np.where((normals != 0.0).any(axis=2, keepdims=True), normals, across)
    # Three samples per corner. They wind counter-clockwise about the normal, just off the leaf on that side.
    spread = PLACES @ np.stack([np.roll(corners, -corner, axis=1) for corner in range(3)], axis=1)
    against = (normals * across).sum(axis=2, keepdims=True) < 0.0
    up = np.where(against, -across, across)[:, :, None] * (near / 16.0)
    turned = spread[:, :, [0, 2, 1]]
    front = np.where(against[..., None], turned, spread) + up
    back = np.where(against[..., None], spread, turned) - up
    baked = _baked(layer, np.stack([front, back]), np.repeat(np.stack([normals, -normals])[:, :, :, None], 3, axis=3))
    lit = np.nan_to_num(baked.reshape(2, *front.shape).mean(axis=3), posinf=0.0)
    return lit[0], lit[1]


def _baked(
    layer: bpy.types.ViewLayer, points: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return (samples, 3) the light reflected by white triangles at (…, 3, 3) points; no ray hits these triangles."""
    count = points.size // 3
    mesh, white = bpy.data.meshes.new(_ATTRIBUTE), _white()
    obj = bpy.data.objects.new(_ATTRIBUTE, mesh)
    try:
        mesh.vertices.add(count)
        mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
        mesh.loops.add(count)
        mesh.loops.foreach_set("vertex_index", np.arange(count, dtype=np.int32))
        mesh.polygons.add(count // 3)
        mesh.polygons.foreach_set("loop_start", np.arange(0, count, 3, dtype=np.int32))
        mesh.materials.append(white)
        mesh.color_attributes.active_color = mesh.color_attributes.new(_ATTRIBUTE, "FLOAT_COLOR", "CORNER")
        mesh.update(calc_edges=True)
        set_corner_normals(mesh, normals.reshape(-1, 3).astype(np.float32))
        layer.id_data.collection.objects.link(obj)
        for rays in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
            setattr(obj, f"visible_{rays}", False)  # Keep the camera ray: Cycles skips objects hidden from all rays.
        clear_terminator(obj)
        _bake(layer, obj)
        colors = np.empty(4 * count, np.float32)
        mesh.color_attributes[_ATTRIBUTE].data.foreach_get("color", colors)
    finally:
        bpy.data.objects.remove(obj)
        bpy.data.meshes.remove(mesh)
        bpy.data.materials.remove(white)
    return colors.reshape(-1, 4)[:, :3]


def _bake(layer: bpy.types.ViewLayer, obj: bpy.types.Object) -> None:
    obj.select_set(True, view_layer=layer)
    layer.objects.active = obj
    chosen = {"object": obj, "active_object": obj, "selected_objects": [obj], "selected_editable_objects": [obj]}
    with bpy.context.temp_override(scene=layer.id_data, view_layer=layer, **chosen):
        bpy.ops.object.bake(
            type="DIFFUSE",
            pass_filter={"DIRECT", "INDIRECT"},
            target="VERTEX_COLORS",
            use_selected_to_active=False,
        )


def _white() -> bpy.types.Material:
    material, tree, output = _new_material(_ATTRIBUTE)
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    return material


def _new_material(name: str) -> tuple[bpy.types.Material, bpy.types.NodeTree, bpy.types.Node]:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # From Blender 5.0 on every material has nodes.
        material.use_nodes = True
    output = output_of(material.node_tree)
    assert output is not None  # new materials have one
    return material, material.node_tree, output


@contextmanager
def _without(sources: Sequence[bpy.types.Object]) -> Iterator[None]:
    """Hide the objects from renders during the block."""
    hidden = [obj for obj in sources if not obj.hide_render]
    for obj in hidden:
        obj.hide_render = True
    try:
        yield
    finally:
        for obj in hidden:
            obj.hide_render = False


@contextmanager
def _own_scene(layer: bpy.types.ViewLayer) -> Iterator[bpy.types.ViewLayer]:
    """Yield the layer in a copy of its scene with settings for the bake. The copy shares the objects.

    Bounces are those of the scene, except for transparent ones (`LAYERS`). Errors of Cycles become `SceneError`.
    """
    scene = layer.id_data.copy()
    try:
        scene.render.engine = "CYCLES"
        scene.render.bake.view_from = "ABOVE_SURFACE"
        cycles = scene.cycles
        cycles.device, cycles.samples, cycles.seed, cycles.use_animated_seed = "CPU", SAMPLES, SEED, False
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        cycles.film_exposure, cycles.time_limit = 1.0, 0.0
        cycles.transparent_max_bounces = LAYERS
        own = scene.view_layers[layer.name]
        own.material_override, own.samples = None, 0
        yield own
    except (RuntimeError, TypeError) as error:
        raise SceneError(
            f"the light of the scene {layer.id_data.name!r} could not be baked ({error}); enable the add-on Cycles "
            f"Render Engine, wait for other renders to end, or turn the effect baked_light off"
        ) from error
    finally:
        bpy.data.scenes.remove(scene)


@contextmanager
def _casting(
    meshes: Sequence[bpy.types.Mesh], matrix: NDArray[np.float64], layer: bpy.types.ViewLayer, near: float
) -> Iterator[None]:
    """Add the meshes to the layer's scene during the block, transparent to rays shorter than `near`."""
    objects: list[bpy.types.Object] = []
    materials: dict[bpy.types.Material | None, bpy.types.Material] = {}
    try:
        for mesh in meshes:
            for number, material in enumerate(mesh.materials):
                if material not in materials:
                    materials[material] = _copy(material)
                    _clear_when_near(materials[material], near)
                mesh.materials[number] = materials[material]
            obj = bpy.data.objects.new(mesh.name, mesh)
            objects.append(obj)
            obj.matrix_world = matrix.T.tolist()
            layer.id_data.collection.objects.link(obj)
        yield
    finally:
        for obj in objects:
            bpy.data.objects.remove(obj)
        for made in materials.values():
            bpy.data.materials.remove(made)


def _copy(material: bpy.types.Material | None) -> bpy.types.Material:
    """Return a copy of a material; a new one if it has no output node."""
    if material is None or material.node_tree is None or output_of(material.node_tree) is None:
        return _new_material(_ATTRIBUTE)[0]
    return material.copy()


def _clear_when_near(material: bpy.types.Material, near: float) -> None:
    """Make a material transparent to rays shorter than `near`."""
    tree = material.node_tree
    output = output_of(tree)
    assert output is not None  # `_copy` sees to it
    path, less, clear, mix = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("LightPath", "Math", "BsdfTransparent", "MixShader")
    )
    less.operation, less.inputs[1].default_value = "LESS_THAN", near
    tree.links.new(path.outputs["Ray Length"], less.inputs[0])
    tree.links.new(less.outputs[0], mix.inputs[0])
    for link in list(output.inputs["Surface"].links):
        tree.links.new(link.from_socket, mix.inputs[1])
    tree.links.new(clear.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
