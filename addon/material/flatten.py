"""Renderer of a material over its UV map, for what cannot be read from its nodes.

On a copy of the material, emissions replace the shaders: of base color and alpha (see `emission`), of roughness and
metallic, or of normals (see `shading`). Cycles renders a flat square that covers the whole UV map, from above. So
image textures, ramps, mixes, curves and node groups look as they do in Cycles.

Inputs that vary per leaf have one value on the square; `tints` measures how the leaves differ from it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from .emission import Emitter, Light, Socket
from .node_links import output_of, shown_nodes, trees_of
from .textures import ACTIVE, Texture, uv_maps

Shader = Callable[[bpy.types.Material], Socket]
"""Adds an emitting shader to a material, and returns its output in the material's own tree."""

LEAST, USUAL, LARGEST = 64, 512, 4096
"""Side of the rendering in texels: that of the material's largest image, within these limits; else `USUAL`."""

SAMPLES = 4
"""Samples per texel. Procedural textures need several, because they have detail finer than texels."""

RANDOM = "leafcloud_random"
"""The attribute that replaces the output Random of Object Info nodes."""

SIDE = "leafcloud_side"
"""The attribute that replaces the output Backfacing of Geometry nodes: 0 on the front, 1 on the back."""

WHITE = "leafcloud_white"
"""The white color attribute that replaces the render-active one."""


_VARYING: dict[str, dict[str, set[str] | None]] = {
    "random": {"OBJECT_INFO": {"Random"}},
    "place": {
        "NEW_GEOMETRY": {"Position", "Normal", "True Normal", "Random Per Island"},
        "TEX_COORD": {"Generated", "Normal", "Object"},
    },
    "side": {"NEW_GEOMETRY": {"Backfacing"}},
    "lost": {
        "OBJECT_INFO": {"Location", "Color", "Alpha", "Object Index", "Material Index"},
        "NEW_GEOMETRY": {"Tangent", "Parametric", "Incoming", "Pointiness"},
        "TEX_COORD": {"Camera", "Window", "Reflection"},
        "PARTICLE_INFO": None,
        "HAIR_INFO": None,
        "VERTEX_COLOR": None,
        "ATTRIBUTE": {"Color", "Fac", "Alpha"},
    },
}
"""Outputs by node type that vary with the object's random number, the position or island, or the side of a leaf.

`tints` measures their effect. Those that are lost vary per leaf but get one value for all. `None`: all outputs.
"""


@dataclass(frozen=True)
class RenderSettings:
    """Parameters of a rendering.

    random: the object's random number, in [0, 1]. side: 0 for the front, 1 for the back, ½ for halfway between.
    largest: the greatest side of the image in texels.
    """

    random: float = 0.5
    side: float = 0.0
    largest: int = LARGEST


USUAL_SETTINGS = RenderSettings()


@dataclass(frozen=True)
class Flattened:
    """A rendering of a material. pixels: (h, w, 4) linear base color, premultiplied by alpha, row 0 on top."""

    material: bpy.types.Material
    pixels: NDArray[np.float32]
    by_random: bool
    """Whether leaves vary with the random number of their object."""
    by_place: bool
    """Whether leaves vary with their position, or with the random number of their island."""
    by_side: bool
    """Whether the backs of leaves differ from the fronts."""
    lost: tuple[str, ...]
    """Labels of nodes whose per-leaf variation is dropped."""
    light: Light
    settings: RenderSettings

    @property
    def varies(self) -> bool:
        """Whether leaves vary by anything that `tints` can measure."""
        return self.by_random or self.by_place


def flatten(material: bpy.types.Material, light: Light = "all", settings: RenderSettings = USUAL_SETTINGS) -> Flattened:
    """Render a material, for which `can_render` must hold. Scenes and materials of the file stay unchanged.

    Raises `SceneError` if Cycles fails.
    """
    nodes = shown_nodes(material.node_tree)
    pixels = render(material, nodes, lambda copy: color_shader(copy, light), settings=settings)
    random, place, side, lost = (_labels(nodes, kind) for kind in ("random", "place", "side", "lost"))
    return Flattened(material, pixels, bool(random), bool(place), bool(side), tuple(lost), light, settings)


def color_shader(copy: bpy.types.Material, light: Light = "all") -> Socket:
    """Add a shader that emits a material's color, or a part of its light."""
    output = output_of(copy.node_tree)
    assert output is not None  # `can_render` holds
    return Emitter(copy.node_tree, light).emitting(output.inputs["Surface"])


def render(
    material: bpy.types.Material,
    nodes: Sequence[bpy.types.Node],
    shader: Shader,
    *,
    transform: Sequence[float] = Texture.transform,
    size: float = 1.0,
    settings: RenderSettings = USUAL_SETTINGS,
) -> NDArray[np.float32]:
    """Render the shader that `shader` adds to a copy of a material. Return (h, w, 4), premultiplied, row 0 on top.

    `nodes`: those that the result depends on. `transform`: see `Texture`; the rendering covers [0, 1]² of the image.
    `size`: the side of the square in the world. Raises `SceneError` if Cycles fails.
    """
    with emitting(material, shader) as shown, cycles_scene(material) as scene:
        mesh = _square(nodes, transform, settings)
        mesh.materials.append(shown)
        return rendered(scene, mesh, min(_side_of(nodes), settings.largest), size)


def of_single_leaves(nodes: Iterable[bpy.types.Node]) -> list[str]:
    """Return the labels of nodes with per-leaf variation, sorted and without repeats."""
    return _labels(nodes, "lost", "random", "place")


def _labels(nodes: Iterable[bpy.types.Node], *kinds: str) -> list[str]:
    return sorted({node.bl_label for node in nodes for kind in kinds if _varies(node, kind)})


def _varies(node: bpy.types.Node, kind: str) -> bool:
    """Return whether a node has a linked output of this kind of variation."""
    if kind == "place" and _is_generated(node):
        return True
    names = _VARYING[kind].get(node.type, set())
    return any(output.is_linked for output in node.outputs if names is None or output.name in names)


def _is_generated(node: bpy.types.Node) -> bool:
    """Return whether a procedural texture uses Generated coordinates, its default without a linked vector."""
    vector = node.inputs.get("Vector") if node.type.startswith("TEX_") else None
    return vector is not None and not vector.is_linked and node.type not in {"TEX_IMAGE", "TEX_ENVIRONMENT", "TEX_IES"}


@contextmanager
def emitting(material: bpy.types.Material, shader: Shader = color_shader) -> Iterator[bpy.types.Material]:
    """Yield a copy of a material with the surface that `shader` adds to it, without volume and displacement.

    Attributes `RANDOM` and `SIDE` replace node outputs.
    """
    copy = _copied(material)
    tree = copy.node_tree
    try:
        for each in trees_of(tree):
            _read(each, "OBJECT_INFO", "Random", RANDOM)
            _read(each, "NEW_GEOMETRY", "Backfacing", SIDE)
        output = output_of(tree)
        assert output is not None  # `can_render` holds
        tree.links.new(shader(copy), output.inputs["Surface"])
        for name in ("Volume", "Displacement"):
            for link in list(output.inputs[name].links):
                tree.links.remove(link)
        yield copy
    finally:
        bpy.data.batch_remove([copy, *trees_of(tree)[1:]])


def asks_for_random(tree: bpy.types.NodeTree) -> bool:
    """Return whether a tree, or a group in it, uses the random number of objects."""
    return any(_varies(node, "random") for each in trees_of(tree) for node in each.nodes)


def copy_for_joined(material: bpy.types.Material) -> bpy.types.Material:
    """Return a copy for leaves joined to one object. It reads each leaf's random number from the attribute `RANDOM`."""
    copy = _copied(material)
    copy.name = f"{material.name}_joined"
    for tree in trees_of(copy.node_tree):
        _read(tree, "OBJECT_INFO", "Random", RANDOM)
    return copy


def shining_copy(
    material: bpy.types.Material, factor: Callable[[bpy.types.NodeTree], Socket], strength: float
) -> bpy.types.Material:
    """Return a copy that emits its color times a factor times `strength`. `factor` adds the factor's nodes to a tree.

    Cycles and EEVEE each get an output of their own. The output for all renderers stays unchanged, for exporters and
    other readers.
    """
    copy = _copied(material)
    tree = copy.node_tree
    output = output_of(tree)
    assert output is not None  # materials that show anything have one
    for other in [node for node in tree.nodes if node.type == "OUTPUT_MATERIAL" and node != output]:
        tree.nodes.remove(other)
    shader = Emitter(tree, "all", factor, strength).emitting(output.inputs["Surface"])
    for target in ("CYCLES", "EEVEE"):
        shown = tree.nodes.new("ShaderNodeOutputMaterial")
        shown.target = target
        tree.links.new(shader, shown.inputs["Surface"])
    output.target, output.is_active_output = "ALL", True
    return copy


@contextmanager
def cycles_scene(material: bpy.types.Material) -> Iterator[bpy.types.Scene]:
    """Yield a scene for Cycles. Remove it at the end, with its objects, their data and render results.

    Raises `SceneError` for errors of Blender in rendering the material.
    """
    seen = {image.name for image in bpy.data.images if image.type == "RENDER_RESULT"}
    scene = bpy.data.scenes.new("leafcloud flatten")
    try:
        scene.render.engine = "CYCLES"
        scene.cycles.device = "CPU"
        scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
        yield scene
    except (RuntimeError, TypeError) as error:
        raise SceneError(
            f"material {material.name!r} has to be rendered, but Cycles failed ({error}); enable the add-on Cycles "
            f"Render Engine, wait for other renders to end, or connect an Image Texture to a Principled BSDF"
        ) from error
    finally:
        results = [image for image in bpy.data.images if image.type == "RENDER_RESULT" and image.name not in seen]
        objects = list(scene.collection.objects)
        bpy.data.batch_remove([*results, *(obj.data for obj in objects), *objects, scene])


def _copied(material: bpy.types.Material) -> bpy.types.Material:
    """Return a copy of a material in which each group node has a copy of its group of its own."""
    copy = material.copy()
    waiting = [copy.node_tree]
    while waiting:
        for node in waiting.pop().nodes:
            if node.type == "GROUP" and node.node_tree is not None:
                node.node_tree = node.node_tree.copy()
                waiting.append(node.node_tree)
    return copy


def _read(tree: bpy.types.NodeTree, kind: str, output: str, name: str) -> None:
    """Replace the links of an output of all nodes of type `kind` by an Attribute node for `name`."""
    for node in [node for node in tree.nodes if node.type == kind]:
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name = name
        for link in list(node.outputs[output].links):
            tree.links.new(attribute.outputs["Fac"], link.to_socket)


def _side_of(nodes: Sequence[bpy.types.Node]) -> int:
    """Return the side in texels of a rendering of these nodes."""
    sides = [max(node.image.size) for node in nodes if node.type == "TEX_IMAGE"]
    return min(max([LEAST, *sides]), LARGEST) if sides else USUAL


def _square(nodes: Sequence[bpy.types.Node], transform: Sequence[float], settings: RenderSettings) -> bpy.types.Mesh:
    """Return a square with the UVs that the transform maps to [0, 1]², under all names that the nodes use."""
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    mesh = bpy.data.meshes.new("leafcloud flatten")
    mesh.from_pydata([(x, y, 0.0) for x, y in corners], [], [(0, 1, 2, 3)])
    linear, moved = np.split(np.reshape(transform, (2, 3)), [2], axis=1)
    places = np.linalg.solve(linear, np.transpose(corners) - moved).T
    add_layers(mesh, nodes, np.ascontiguousarray(places, np.float32))
    for name, value in ((RANDOM, settings.random), (SIDE, settings.side)):
        mesh.attributes.new(name, "FLOAT", "POINT").data.foreach_set("value", np.full(4, value, np.float32))
    return mesh


def add_layers(mesh: bpy.types.Mesh, nodes: Sequence[bpy.types.Node], places: NDArray[np.float32]) -> None:
    """Add UV maps with `places` (corners, 2), and white color attributes, under all names that the nodes use."""
    names = {*uv_maps(nodes)} | {node.uv_map for node in nodes if node.type in {"NORMAL_MAP", "TANGENT"}}
    names -= {ACTIVE}
    for name in sorted(names) or ["UVMap"]:
        mesh.uv_layers.new(name=name).uv.foreach_set("vector", places.ravel())
    colors = {node.layer_name for node in nodes if node.type == "VERTEX_COLOR"}
    colors |= {node.attribute_name for node in nodes if node.type == "ATTRIBUTE"}
    for name in sorted({color or WHITE for color in colors} - {*names}) or [WHITE]:
        layer = mesh.color_attributes.new(name, "FLOAT_COLOR", "POINT")
        layer.data.foreach_set("color", np.ones(4 * len(mesh.vertices), np.float32))
    mesh.color_attributes.render_color_index = 0


def rendered(scene: bpy.types.Scene, mesh: bpy.types.Mesh, side: int, size: float = 1.0) -> NDArray[np.float32]:
    """Return (side, side, 4) the square rendered from above, row 0 on top. `size`: the square's side in the world."""
    camera = bpy.data.objects.new("leafcloud camera", bpy.data.cameras.new("leafcloud camera"))
    shown = bpy.data.objects.new("leafcloud square", mesh)
    for obj in (camera, shown):
        scene.collection.objects.link(obj)
    shown.scale = (size, size, size)
    camera.location, camera.data.type, camera.data.ortho_scale = (0.5 * size, 0.5 * size, 1.0), "ORTHO", size
    scene.camera = camera
    scene.cycles.samples = SAMPLES
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 1.0
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = side
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.exr_codec = "ZIP"  # The default codec has errors of a percent.
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flat.exr"
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True, scene=scene.name)
        image = bpy.data.images.load(str(path))
        image.alpha_mode = "PREMUL"
        values = np.empty(side * side * 4, np.float32)
        image.pixels.foreach_get(values)
        bpy.data.images.remove(image)
    return values.reshape(side, side, 4)[::-1]
