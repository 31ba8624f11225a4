"""Warnings about material features that a bake drops: emission, displacement, coat and sheen.

Also warns about nodes that Blender's glTF exporter cannot follow.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from ..errors import SceneError
from .images import is_missing, pixels_of
from .node_links import Port, number_at, output_of, shown_nodes, tangled_inputs, trees_of
from .surface import principled_of, product_of, read_surface
from .textures import NotUnderstoodError


def losses(material: bpy.types.Material) -> list[str]:
    """Return a sentence for each feature of a material that its billboards lack."""
    tree, said = material.node_tree, f"material {material.name!r}"
    if tree is None:
        return []
    found: list[str] = []
    if _emits(material) and not read_surface(material).unlit:
        found.append(
            f"{said} emits light, but its billboards do not: they keep only its color and need other light; set the "
            f"Emission Strength to 0 if the leaves need not emit light, either"
        )
    used = [node for each in trees_of(tree) for node in each.nodes if any(out.is_linked for out in node.outputs)]
    missing = [node.image for node in used if node.type == "TEX_IMAGE" and is_missing(node.image)]
    found += [
        f"{said}: the file {image.filepath!r} of its image {image.name!r} is missing, so the image is left out"
        for image in dict.fromkeys(missing)
    ]
    output = output_of(tree)
    if output is not None and output.inputs["Displacement"].is_linked:
        found.append(f"{said}: its billboards lack its displacement; connect a Bump node to the Normal of its shader")
    principled = principled_of(material)
    layers = [] if principled is None else [name for name in ("Coat", "Sheen") if _has(principled, f"{name} Weight")]
    if layers:
        found.append(
            f"{said}: its billboards have one specular layer, without {' and '.join(layers)}; set the weight to 0"
        )
    tangled = sorted({socket.name for each in trees_of(tree) for socket in tangled_inputs(each)})
    if tangled:
        found.append(
            f"{said}: the nodes behind {' and '.join(tangled)} have too many or too long paths for Blender's glTF "
            f"exporter: in glTF the material's own faces have the first image there, or a constant; bake them to an "
            f"image"
        )
    return found


def lit_with_others(materials: Sequence[bpy.types.Material | None]) -> list[str]:
    """Return a sentence for leaves that need no light beside others that do: their billboards share one material."""
    unlit = [material.name for material in materials if material is not None and read_surface(material).unlit]
    if not unlit or len(unlit) == len(materials):
        return []
    named = " and ".join(repr(name) for name in unlit)
    return [f"the leaf materials {named} show without light, others need it: all billboards need light"]


def _emits(material: bpy.types.Material) -> bool:
    if any(node.type == "EMISSION" for node in shown_nodes(material.node_tree)):
        return True
    principled = principled_of(material)
    return (
        principled is not None
        and _has(principled, "Emission Strength")
        and not _is_black(principled.input("Emission Color"))
    )


def _has(shader: Port, name: str) -> bool:
    """Return whether a value input is not the constant 0. An input that varies counts as not 0."""
    return number_at(shader.input(name)) != 0.0


def _is_black(target: Port) -> bool:
    try:
        product = product_of(target)
    except NotUnderstoodError:
        return False
    if not any(product.factor):
        return True
    image = None if product.texture is None else product.texture.image
    try:
        return image is not None and not is_missing(image) and not pixels_of(image, "")[..., :3].any()
    except SceneError:  # Lights show no image that cannot be read.
        return True
