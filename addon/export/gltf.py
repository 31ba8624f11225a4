"""glTF export by Blender's own exporter, with changes to materials before it and additions to its files after it."""

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
from .optional_textures import OPTIONAL_NODES, add_optional_textures
from .tangents import add_tangents
from .translucency import add_translucency
from .unlit import COLOR_OPTIONS, add_unlit

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
    "export_current_frame": True,  # Otherwise the exporter goes to frame 0.
}


@contextmanager
def masked_leaves(levels: Sequence[BuiltLevel], kept: Collection[str]) -> Iterator[None]:
    """Cut out blended leaf materials at an alpha of ½ while the block runs, except those named in `kept`.

    In engines, crossing cards that are blended have no depth order. They would also look different from the first
    cloud, which is cut out. A uniform alpha above ½ becomes 1. A lower one stays: a cutout would remove the leaves.
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
    """Return whether a material's alpha is blended, or unreadable: exporters treat unreadable alpha as blended."""
    surface = read_surface(material)
    return surface.alpha_mode == "BLEND" or any(gap.startswith("its alpha ") for gap in surface.gaps)


def cut_message(material: bpy.types.Material) -> str:
    """Return the message on a blended leaf material that files do not keep blended."""
    alphas = _alphas(material.node_tree)
    if any(alpha.is_linked for alpha in alphas) or not alphas:
        way = "cut it out at an alpha of 0.5"
    elif _even_alphas(material.node_tree):
        way = f"show its uniform alpha of {alphas[0].default_value:.3g} as opaque"
    else:
        way = f"keep its uniform alpha of {alphas[0].default_value:.3g}, without a draw order"
    return f"material {material.name!r} is blended: the glTF files {way}"


def _alphas(tree: bpy.types.NodeTree) -> list[bpy.types.NodeSocket]:
    return [node.inputs["Alpha"] for node in tree.nodes if node.type == "BSDF_PRINCIPLED"]


def _even_alphas(tree: bpy.types.NodeTree) -> list[bpy.types.NodeSocket]:
    """Return the inputs with a uniform alpha above ½."""
    return [alpha for alpha in _alphas(tree) if not alpha.is_linked and alpha.default_value > 0.5]


def _cut_out(tree: bpy.types.NodeTree) -> list[tuple[bpy.types.NodeTree, bpy.types.Node]]:
    """Insert a threshold before each linked alpha of a Principled BSDF, and return the tree and the node of each."""
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
    """Write all objects of `collection` and its children as a GLB file. The current scene must contain it.

    Raises `ExportError` if the complete file cannot be written.
    """
    lit = any(FRONT in obj.data.color_attributes for obj in collection.all_objects)
    try:
        bpy.ops.export_scene.gltf(
            filepath=str(path), collection=collection.name, **_OPTIONS, **(COLOR_OPTIONS if lit else {})
        )
    except RuntimeError as error:
        raise ExportError(f"{path.name}: {reason(error)}") from error
    if not _is_whole(path):
        raise ExportError(f"{path.name}: Blender's glTF exporter wrote no complete file")
    nodes = _node_names(collection)
    if nodes & set(OPTIONAL_NODES):
        add_optional_textures(path, collection)
    if TRANSLUCENCY_NODE in nodes:
        add_translucency(path, collection)
    if lit:
        add_unlit(path, collection)
    add_tangents(path)


def _node_names(collection: bpy.types.Collection) -> set[str]:
    """Return the names of all material nodes in `collection`. Some hold data that Blender's exporter does not write."""
    materials = {material for obj in collection.all_objects for material in obj.data.materials if material is not None}
    return {node.name for material in materials if material.node_tree for node in material.node_tree.nodes}


def export_level(level: BuiltLevel, path: Path) -> None:
    """Write one level with its trunk as a GLB file. Raises `ExportError` if the complete file cannot be written."""
    export_objects([obj for obj in (level.object, level.trunk) if obj is not None], path, level.object.name)


def export_objects(objects: Sequence[bpy.types.Object], path: Path, scene_name: str) -> None:
    """Write only these objects as a GLB file with a scene of the given name.

    Raises `ExportError` if the complete file cannot be written.
    """
    collection = bpy.data.collections.new(scene_name)
    bpy.context.scene.collection.children.link(collection)
    try:
        for obj in objects:
            collection.objects.link(obj)
        export_collection(collection, path)
    finally:
        bpy.data.collections.remove(collection)


def y_up(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Convert vectors (…, 3) from Blender's Z-up coordinates to glTF's: (x, z, −y).

    Blender's exporter converts known attributes only, not custom ones.
    """
    return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)


def _is_whole(path: Path) -> bool:
    """Return whether `path` is a GLB file of the length in its header."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        header = file.read(12)
    return len(header) == 12 and struct.unpack("<4sII", header)[::2] == (b"glTF", path.stat().st_size)
