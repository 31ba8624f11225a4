"""Warnings about material features that a bake drops: emission, displacement, coat and sheen.

Also warns about nodes that Blender's glTF exporter cannot follow.
"""

from __future__ import annotations

import bpy

from .node_links import Port, follow, number_at, output_of, shown_nodes, tangled_inputs, trees_of
from .surface import principled_of


def losses(material: bpy.types.Material) -> list[str]:
    """Return a sentence for each feature of a material that its billboards lack."""
    tree, said = material.node_tree, f"material {material.name!r}"
    if tree is None:
        return []
    found: list[str] = []
    if _emits(material):
        found.append(
            f"{said} emits light, but its billboards do not: they keep only its color and need other light; set the "
            f"Emission Strength to 0 if the leaves need not emit light, either"
        )
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
    source = follow(target)
    return source.kind in {"", "RGB"} and not any(source.socket.default_value[:3])
