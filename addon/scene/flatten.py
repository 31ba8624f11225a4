"""What Cycles makes of a material whose nodes are no plain product: base colour and alpha as an image over its UV map.

The shaders are replaced by what they say of colour and alpha, on a copy of the material: a Mix Shader mixes both, a
Transparent BSDF has no alpha, all others have their colour, or the part of it that is reflected or shines through. A
square that lies on the whole of the UV map is rendered with it, flat, from above. So image textures, ramps, mixes,
curves and node groups count as they are, whatever they are.

What differs from leaf to leaf has one value on the square; `tints` says how the leaves differ from it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from . import SceneError
from .node_links import output_of, shown_nodes
from .shader_sums import Builder, Light, shining
from .textures import ACTIVE, Texture, uv_maps

LEAST, USUAL, LARGEST = 64, 512, 4096
"""Sides of the image in texels: of the largest image in the material within these limits, or the usual one."""

SAMPLES = 4
"""A texel is the mean of as many places; procedural textures have no pixels that would be enough by themselves."""

RANDOM = "leafcloud_random"
"""The attribute that stands for the Random of the Object Info node."""

SIDE = "leafcloud_side"
"""The attribute that stands for the Backfacing of the Geometry node: 0 in front, 1 on the back."""

WHITE = "leafcloud_white"
"""The colour attribute that stands for the one that renders."""


_RANDOM: dict[str, set[str] | None] = {"OBJECT_INFO": {"Random"}}

_PLACE: dict[str, set[str] | None] = {
    "NEW_GEOMETRY": {"Position", "Normal", "True Normal", "Random Per Island"},
    "TEX_COORD": {"Generated", "Normal", "Object"},
}
"""Outputs by which leaves differ, and which are known: by object, by place or island."""

_SIDES: dict[str, set[str] | None] = {"NEW_GEOMETRY": {"Backfacing"}}

_LOST = {
    "OBJECT_INFO": {"Location", "Color", "Alpha", "Object Index", "Material Index"},
    "NEW_GEOMETRY": {"Tangent", "Parametric", "Incoming", "Pointiness"},
    "TEX_COORD": {"Camera", "Window", "Reflection"},
    "PARTICLE_INFO": None,
    "HAIR_INFO": None,
    "VERTEX_COLOR": None,
    "ATTRIBUTE": {"Color", "Fac", "Alpha"},
}
"""Outputs of which one value stands for all leaves; `None`: all of them."""


@dataclass(frozen=True)
class Look:
    """One of the looks of a material: on an object with this random number, on at most so many texels a side.

    side: 0 for the front, 1 for the back, ½ for what lies between.
    """

    random: float = 0.5
    side: float = 0.0
    largest: int = LARGEST


USUAL_LOOK = Look()


@dataclass(frozen=True)
class Flattened:
    """(h, w, 4) linear base colour, premultiplied by alpha, row 0 on top."""

    pixels: NDArray[np.float32]
    by_random: bool
    """Whether leaves differ by the random number of their object."""
    by_place: bool
    """Whether they differ by where they are, or by the random number of their island."""
    by_side: bool
    """Whether their backs differ from their fronts."""
    lost: tuple[str, ...]
    """The nodes that tell leaves apart by what is not known here."""
    light: Light
    look: Look

    @property
    def varies(self) -> bool:
        """Whether leaves differ by anything that is known."""
        return self.by_random or self.by_place


def flatten(material: bpy.types.Material, light: Light = "all", look: Look = USUAL_LOOK) -> Flattened:
    """Renders a material that can be (see `can_render`). The scenes and materials of the file stay as they are.

    Raises `SceneError` when Cycles does not.
    """
    nodes = shown_nodes(material.node_tree)
    with cycles_errors(material), flat_material(material, light) as flat, scratch_scene() as scene:
        mesh = square(nodes, look=look)
        mesh.materials.append(flat)
        try:
            pixels = rendered(scene, mesh, min(side_of(nodes), look.largest))
        finally:
            bpy.data.meshes.remove(mesh)
    lost = sorted({node.bl_label for node in nodes if _gives(node, _LOST)})
    by_random = any(_gives(node, _RANDOM) for node in nodes)
    by_place = any(_gives(node, _PLACE) or _is_generated(node) for node in nodes)
    by_side = any(_gives(node, _SIDES) for node in nodes)
    return Flattened(pixels, by_random, by_place, by_side, tuple(lost), light, look)


def of_single_leaves(nodes: Iterable[bpy.types.Node]) -> list[str]:
    """What the nodes are called that tell leaves apart, each once."""
    known = (_LOST, _RANDOM, _PLACE)
    apart = (node for node in nodes if any(_gives(node, each) for each in known) or _is_generated(node))
    return sorted({node.bl_label for node in apart})


def _gives(node: bpy.types.Node, outputs: Mapping[str, set[str] | None]) -> bool:
    """Whether one of these outputs of a node is linked."""
    if node.type not in outputs:
        return False
    names = outputs[node.type]
    return any(output.is_linked for output in node.outputs if names is None or output.name in names)


def _is_generated(node: bpy.types.Node) -> bool:
    """Whether a procedural texture lies in the object's box, as it does without coordinates."""
    vector = node.inputs.get("Vector") if node.type.startswith("TEX_") else None
    return vector is not None and not vector.is_linked and node.type not in {"TEX_IMAGE", "TEX_ENVIRONMENT", "TEX_IES"}


@contextmanager
def cycles_errors(material: bpy.types.Material) -> Iterator[None]:
    """What Blender raises when it cannot render, as a `SceneError`."""
    try:
        yield
    except (RuntimeError, TypeError) as error:
        raise SceneError(
            f"material {material.name!r} is no plain product and could not be rendered ({error}); enable the add-on "
            f"Cycles Render Engine, wait for other renders to end, or connect an Image Texture to a Principled BSDF"
        ) from error


@contextmanager
def flat_material(
    material: bpy.types.Material, light: Light = "all", *, opaque: bool = False
) -> Iterator[bpy.types.Material]:
    """A copy that shines with its premultiplied colour, and lets through what alpha leaves.

    `opaque`: with its own colour, and lets through nothing.
    """
    with own_copy(material) as copy:
        _replace_shaders(copy.node_tree, light, opaque=opaque)
        yield copy


@contextmanager
def own_copy(material: bpy.types.Material) -> Iterator[bpy.types.Material]:
    """A copy that may be changed, groups included. Random numbers of objects come from the attribute `RANDOM` there."""
    copy = material.copy()
    groups: list[bpy.types.NodeTree] = []
    try:
        _own_groups(copy.node_tree, groups)
        for tree in (copy.node_tree, *groups):
            _read_randoms(tree)
            _read(tree, "NEW_GEOMETRY", "Backfacing", SIDE)
        yield copy
    finally:
        bpy.data.materials.remove(copy)
        for group in groups:
            bpy.data.node_groups.remove(group)


def asks_for_random(tree: bpy.types.NodeTree) -> bool:
    """Whether a tree, or a group in it, does anything with the random number of objects."""
    return any(
        _gives(node, _RANDOM)
        or (node.type == "GROUP" and node.node_tree is not None and asks_for_random(node.node_tree))
        for node in tree.nodes
    )


def copy_for_joined(material: bpy.types.Material) -> bpy.types.Material:
    """A copy for leaves that are one object: the random number of each comes from the attribute `RANDOM`."""
    copy = material.copy()
    copy.name = f"{material.name}_joined"
    groups: list[bpy.types.NodeTree] = []
    _own_groups(copy.node_tree, groups)
    for tree in (copy.node_tree, *groups):
        _read_randoms(tree)
    return copy


def shining_copy(
    material: bpy.types.Material, factor: Callable[[bpy.types.NodeTree], bpy.types.NodeSocket], strength: float
) -> bpy.types.Material:
    """A copy that shines with its colour times a factor, whose nodes are added by `factor`, times the strength.

    Cycles and EEVEE see that by outputs of their own. The one for all stays as it was, for exporters and other readers.
    """
    copy = material.copy()
    tree = copy.node_tree
    _own_groups(tree, [])
    output = output_of(tree)
    assert output is not None  # as of all materials that show anything
    for other in [node for node in tree.nodes if node.type == "OUTPUT_MATERIAL" and node != output]:
        tree.nodes.remove(other)
    builder = Builder(tree, "all")
    color, alpha = builder.color_and_alpha(output.inputs["Surface"])
    shader = shining(builder, builder.vector("MULTIPLY", color, factor(tree)), alpha, strength)
    for target in ("CYCLES", "EEVEE"):
        shown = tree.nodes.new("ShaderNodeOutputMaterial")
        shown.target = target
        tree.links.new(shader.outputs[0], shown.inputs["Surface"])
    output.target, output.is_active_output = "ALL", True
    return copy


@contextmanager
def scratch_scene() -> Iterator[bpy.types.Scene]:
    """A scene for Cycles that goes with its objects, and with what was rendered."""
    seen = {image.name for image in bpy.data.images if image.type == "RENDER_RESULT"}
    scene = bpy.data.scenes.new("leafcloud flatten")
    try:
        scene.render.engine = "CYCLES"
        scene.cycles.device = "CPU"
        scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
        yield scene
    finally:
        for image in [i for i in bpy.data.images if i.type == "RENDER_RESULT" and i.name not in seen]:
            bpy.data.images.remove(image)
        for obj in list(scene.collection.objects):
            data = obj.data
            bpy.data.objects.remove(obj)
            if isinstance(data, bpy.types.Camera):
                bpy.data.cameras.remove(data)
        bpy.data.scenes.remove(scene)


def _own_groups(tree: bpy.types.NodeTree, groups: list[bpy.types.NodeTree]) -> None:
    """Gives each group node of a tree a group of its own."""
    for node in tree.nodes:
        if node.type == "GROUP" and node.node_tree is not None:
            node.node_tree = node.node_tree.copy()
            groups.append(node.node_tree)
            _own_groups(node.node_tree, groups)


def _read_randoms(tree: bpy.types.NodeTree) -> None:
    """The random numbers of objects come from an attribute: all leaves are one object here."""
    _read(tree, "OBJECT_INFO", "Random", RANDOM)


def _read(tree: bpy.types.NodeTree, kind: str, output: str, name: str) -> None:
    """What comes from an output of nodes of a kind comes from the attribute instead."""
    for node in [node for node in tree.nodes if node.type == kind]:
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name = name
        for link in list(node.outputs[output].links):
            tree.links.new(attribute.outputs["Fac"], link.to_socket)


def side_of(nodes: list[bpy.types.Node]) -> int:
    """Of the image that these nodes are rendered to, in texels."""
    sides = [max(node.image.size) for node in nodes if node.type == "TEX_IMAGE"]
    return min(max([LEAST, *sides]), LARGEST) if sides else USUAL


def square(
    nodes: list[bpy.types.Node], transform: Sequence[float] = Texture.transform, look: Look = USUAL_LOOK
) -> bpy.types.Mesh:
    """[0, 1]² under all names of texture coordinates that the nodes ask for, or what a `Texture.transform` carries
    there."""
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    mesh = bpy.data.meshes.new("leafcloud flatten")
    mesh.from_pydata([(x, y, 0.0) for x, y in corners], [], [(0, 1, 2, 3)])
    linear, moved = np.split(np.reshape(transform, (2, 3)), [2], axis=1)
    places = np.linalg.solve(linear, np.transpose(corners) - moved).T
    add_layers(mesh, nodes, np.ascontiguousarray(places, np.float32))
    for name, value in ((RANDOM, look.random), (SIDE, look.side)):
        mesh.attributes.new(name, "FLOAT", "POINT").data.foreach_set("value", np.full(4, value, np.float32))
    return mesh


def add_layers(mesh: bpy.types.Mesh, nodes: Iterable[bpy.types.Node], places: NDArray[np.float32]) -> None:
    """Texture coordinates `places` (corners, 2), and white colours, under all names that nodes ask for."""
    nodes = list(nodes)
    names = uv_maps(nodes) | {node.uv_map for node in nodes if node.type in {"NORMAL_MAP", "TANGENT"}}
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
    """(side, side, 4) the square from above, row 0 on top; in the world it is `size` long."""
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
    scene.render.image_settings.exr_codec = "ZIP"  # The default loses a per cent.
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


def _replace_shaders(tree: bpy.types.NodeTree, light: Light, *, opaque: bool) -> None:
    builder = Builder(tree, light)
    output = output_of(tree)
    assert output is not None  # else it cannot be rendered
    color, alpha = builder.color_and_alpha(output.inputs["Surface"])
    if opaque:
        color, alpha = builder.scaled(color, builder.math("DIVIDE", 1.0, alpha)), 1.0
    show(tree, shining(builder, color, alpha))


def show(tree: bpy.types.NodeTree, shader: bpy.types.Node) -> None:
    """Makes the shader all that a material's tree shows."""
    output = output_of(tree)
    assert output is not None  # else it cannot be rendered
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    for other in ("Volume", "Displacement"):
        for link in list(output.inputs[other].links):
            tree.links.remove(link)
