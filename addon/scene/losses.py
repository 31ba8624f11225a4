"""What no channel keeps of materials, so that it is said: emission, displacement, coats and sheen.

And the nodes that Blender's glTF exporter cannot follow.
"""

from __future__ import annotations

import bpy

from .node_links import Input, Output, follow, number_at, output_of, shown_nodes, tangled_inputs, trees_of
from .surface import principled_of


def losses(material: bpy.types.Material) -> list[str]:
    """A sentence for each thing that billboards do not have of a material."""
    tree, said = material.node_tree, f"material {material.name!r}"
    if tree is None:
        return []
    found: list[str] = []
    if _emits(material):
        found.append(
            f"{said} emits light, which its billboards do not: they have its colour only, which has to be lit; set the "
            f"Emission Strength to 0 if the leaves need not shine from near by, either"
        )
    output = output_of(tree)
    if output is not None and output.inputs["Displacement"].is_linked:
        found.append(f"{said}: its displacement is not in the clouds; put a Bump node into the Normal of its shader")
    principled = principled_of(material)
    layers = [] if principled is None else [name for name in ("Coat", "Sheen") if _has(principled, f"{name} Weight")]
    if layers:
        found.append(
            f"{said}: no {' and no '.join(layers)} is in the clouds, which have one gloss; set the weight to 0"
        )
    tangled = sorted({socket.name for each in trees_of(tree) for socket in tangled_inputs(each)})
    if tangled:
        found.append(
            f"{said}: its nodes share so much of what feeds {' and '.join(tangled)} that Blender's glTF exporter cannot"
            f" follow them: in glTF its own faces have the first image there, or a constant; bake it to an image"
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


def _has(shader: Output, name: str) -> bool:
    """Whether an input of type value is more than 0, as far as one number says it."""
    return number_at(shader.input(name)) != 0.0


def _is_black(target: Input) -> bool:
    source = follow(target)
    if isinstance(source, Output) and source.node.type != "RGB":
        return False
    return not any(source.socket.default_value[:3])
