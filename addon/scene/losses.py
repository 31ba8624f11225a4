"""Whether leaves shine by themselves, which billboards do not: no channel keeps it, so it is said."""

from __future__ import annotations

import bpy

from .node_links import Input, Output, follow
from .surface import number_at, principled_of


def emission_warnings(material: bpy.types.Material) -> list[str]:
    """A sentence for a material whose Principled BSDF emits light."""
    principled = principled_of(material)
    if principled is None or number_at(principled.input("Emission Strength")) == 0.0:
        return []
    if _is_black(principled.input("Emission Color")):
        return []
    return [
        f"material {material.name!r} emits light, which its billboards do not: they have its base colour only; set the "
        f"Emission Strength to 0 if the leaves need not shine from near by, either"
    ]


def _is_black(target: Input) -> bool:
    source = follow(target)
    if isinstance(source, Output) and source.node.type != "RGB":
        return False
    return not any(source.socket.default_value[:3])
