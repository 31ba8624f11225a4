"""glTF through Blender's own exporter, and what is put into its files behind it or into materials meanwhile."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..build.baked_light import FRONT
from ..build.levels import BuiltLevel
from ..build.materials import TRANSLUCENCY_NODE
from ..scene.surface import read_surface
from .errors import ExportError, reason
from .tangents import add_tangents
from .translucency import add_translucency
from .unlit import COLOR_OPTIONS, add_unlit
from .waiting import WAITING_NODES, add_waiting

_OPTIONS = {
    "export_format": "GLB",
    "export_yup": True,
    "export_attributes": True,
    "export_extras": True,
    "export_morph": True,
    "export_morph_normal": False,  # Normals do not morph.
    "export_morph_tangent": False,
    "export_try_sparse_sk": False,  # Not every engine reads sparse accessors.
    "export_tangents": False,
    "export_animations": False,
    "export_skins": False,
    "export_apply": False,
    "export_current_frame": True,  # Else the exporter goes to frame 0.
}


@contextmanager
def masked_leaves(levels: Sequence[BuiltLevel], kept: Collection[str]) -> Iterator[None]:
    """Cuts blended leaf materials out at an alpha of ½ for the time of the export, but for those that are `kept`.

    Crossing cards that are blended have no depth order in engines, and would change their look where the first cloud,
    which is cut out, takes over. An alpha of one number above ½ is made full; below, it stays: else all would be gone.
    """
    materials = dict.fromkeys(material for material in levels[0].object.data.materials if material is not None)
    cut_out = [material for material in materials if is_blended(material) and material.name not in kept]
    cuts = [cut for material in cut_out for cut in _cut_out(material.node_tree)]
    filled = [alpha for material in cut_out for alpha in _even_alphas(material.node_tree)]
    values = [alpha.default_value for alpha in filled]
    try:
        for alpha in filled:
            alpha.default_value = 1.0
        yield
    finally:
        for alpha, value in zip(filled, values, strict=True):
            alpha.default_value = value
        for tree, threshold in cuts:
            source, target = threshold.inputs[0].links[0].from_socket, threshold.outputs[0].links[0].to_socket
            tree.nodes.remove(threshold)
            tree.links.new(source, target)


def is_blended(material: bpy.types.Material) -> bool:
    """Whether the material's alpha is read as coverage, or not understood, which exporters take for the same."""
    surface = read_surface(material)
    return surface.alpha_mode == "BLEND" or any(gap.startswith("its alpha ") for gap in surface.gaps)


def cut_message(material: bpy.types.Material) -> str:
    """What becomes of a blended leaf material in files where it is not kept."""
    alphas = _alphas(material.node_tree)
    if any(alpha.is_linked for alpha in alphas) or not alphas:
        way = "cut it out at an alpha of 0.5"
    elif _even_alphas(material.node_tree):
        way = f"show its even alpha of {alphas[0].default_value:.3g} as opaque"
    else:
        way = f"keep its even alpha of {alphas[0].default_value:.3g}, and do not say in which order to draw its leaves"
    return f"material {material.name!r} is blended: the glTF files {way}"


def _alphas(tree: bpy.types.NodeTree) -> list[bpy.types.NodeSocket]:
    return [node.inputs["Alpha"] for node in tree.nodes if node.type == "BSDF_PRINCIPLED"]


def _even_alphas(tree: bpy.types.NodeTree) -> list[bpy.types.NodeSocket]:
    """The alphas of one number above ½."""
    return [alpha for alpha in _alphas(tree) if not alpha.is_linked and alpha.default_value > 0.5]


def _cut_out(tree: bpy.types.NodeTree) -> list[tuple[bpy.types.NodeTree, bpy.types.Node]]:
    """Puts a threshold before the alpha of each Principled BSDF of a material's own tree; gives those nodes."""
    cuts = []
    for alpha in [alpha for alpha in _alphas(tree) if alpha.is_linked]:
        threshold = tree.nodes.new("ShaderNodeMath")
        threshold.operation = "GREATER_THAN"
        threshold.inputs[1].default_value = 0.5
        tree.links.new(alpha.links[0].from_socket, threshold.inputs[0])
        tree.links.new(threshold.outputs[0], alpha)
        cuts.append((tree, threshold))
    return cuts


def export_collection(collection: bpy.types.Collection, path: Path) -> None:
    """Writes all objects of `collection` and of those in it as a GLB file; it is in the current scene.

    Raises `ExportError` when the file could not be written whole.
    """
    lit = any(FRONT in obj.data.color_attributes for obj in collection.all_objects)
    try:
        bpy.ops.export_scene.gltf(
            filepath=str(path), collection=collection.name, **_OPTIONS, **(COLOR_OPTIONS if lit else {})
        )
    except RuntimeError as error:
        raise ExportError(f"{path.name}: {reason(error)}") from error
    if not _is_whole(path):
        raise ExportError(f"{path.name}: Blender's glTF exporter left no whole file")
    nodes = _node_names(collection)
    if nodes & set(WAITING_NODES):
        add_waiting(path, collection)
    if TRANSLUCENCY_NODE in nodes:
        add_translucency(path, collection)
    if lit:
        add_unlit(path, collection)
    add_tangents(path)


def _node_names(collection: bpy.types.Collection) -> set[str]:
    """Of all materials' nodes: what the exporter does not know is added after it, where there is any."""
    materials = {material for obj in collection.all_objects for material in obj.data.materials if material is not None}
    return {node.name for material in materials if material.node_tree for node in material.node_tree.nodes}


def export_level(level: BuiltLevel, path: Path) -> None:
    """Writes one level with its wood as a GLB file. Raises `ExportError` when the file could not be written whole."""
    export_objects([obj for obj in (level.object, level.wood) if obj is not None], path, level.object.name)


def export_objects(objects: Sequence[bpy.types.Object], path: Path, scene_name: str) -> None:
    """Writes these alone as a GLB file, whose scene has that name. Raises `ExportError` when the file could not be
    written whole."""
    collection = bpy.data.collections.new(scene_name)
    bpy.context.scene.collection.children.link(collection)
    try:
        for obj in objects:
            collection.objects.link(obj)
        export_collection(collection, path)
    finally:
        bpy.data.collections.remove(collection)


def y_up(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Vectors (…, 3) of Blender's Z-up coordinates in glTF's: (x, z, −y). The exporter turns only those it knows."""
    return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)


def _is_whole(path: Path) -> bool:
    """Whether `path` is a GLB file as long as its header says."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        header = file.read(12)
    return len(header) == 12 and struct.unpack("<4sII", header)[::2] == (b"glTF", path.stat().st_size)
