"""Reader of colors and alphas that are products of constants, one image and one color attribute."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy

from .node_links import Input, Output, folded, follow, number_at
from .textures import NotUnderstoodError, Texture, texture_of

Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Product:
    """Product of a factor (three equal numbers for alpha), a channel of an image and a color attribute."""

    factor: Rgb = (1.0, 1.0, 1.0)
    texture: Texture | None = None
    channel: str = "Color"
    attribute: str | None = None

    @property
    def constant(self) -> bool:
        return self.texture is None and self.attribute is None

    def times(self, other: Product) -> Product:
        if (self.texture and other.texture) or (self.attribute is not None and other.attribute is not None):
            raise NotUnderstoodError("multiplies two images or two color attributes")
        textured = self if self.texture else other
        red, green, blue = (a * b for a, b in zip(self.factor, other.factor, strict=True))
        attribute = other.attribute if self.attribute is None else self.attribute
        return Product((red, green, blue), textured.texture, textured.channel, attribute)


def color_product(target: Input) -> Product:
    """Return the product behind a color input. Raises `NotUnderstoodError`."""
    return folded(target, _color_factors, _color_of)


def _color_factors(target: Input) -> list[Input]:
    """Return the inputs multiplied by the node behind an input; none for other nodes."""
    source = follow(target)
    if isinstance(source, Input) or not _multiplies_colors(source.node):
        return []
    if number_at(source.input("Factor_Float")) != 1.0:
        raise NotUnderstoodError(f"is multiplied by the node {source.node.name!r}, whose Factor is not 1")
    return [source.input("A_Color"), source.input("B_Color")]


def _multiplies_colors(node: bpy.types.Node) -> bool:
    return node.type == "MIX" and node.data_type == "RGBA" and node.blend_type == "MULTIPLY"


def _color_of(target: Input, factors: list[Product]) -> Product:
    if factors:
        return factors[0].times(factors[1])
    grey = number_at(target)
    if grey is not None:
        return Product((grey, grey, grey))
    source = follow(target)
    node = source.socket.node
    if isinstance(source, Input) or node.type == "RGB":
        red, green, blue, _ = source.socket.default_value
        return Product((red, green, blue))
    if source.socket.name == "Color":
        return _leaf_product(source)
    raise NotUnderstoodError(f"comes from the output {source.socket.name!r} of the node {node.name!r}")


def alpha_product(targets: list[Input]) -> tuple[Product, float | None]:
    """Return the product behind the alpha inputs, and its cutoff (`None` without one). Raises `NotUnderstoodError`."""
    constants = [number_at(target) for target in targets]
    varying = [target for target, constant in zip(targets, constants, strict=True) if constant is None]
    scale = math.prod(constant for constant in constants if constant is not None)
    product = Product((scale, scale, scale))
    if not varying:
        return product, None
    if len(varying) > 1:
        raise NotUnderstoodError("comes from a Mix Shader and from the Principled BSDF")
    behind, cutoff = _cut(varying[0])
    if cutoff is not None and scale != 1.0:
        raise NotUnderstoodError("is multiplied by a constant after the cutoff")
    return product.times(_value_product(behind)), cutoff


def _value_product(target: Input) -> Product:
    """Return the product behind a value input."""
    return folded(target, _value_factors, _value_of)


def _value_factors(target: Input) -> list[Input]:
    """Return the inputs multiplied by the node behind a value input; none for other nodes."""
    source = follow(target)
    if isinstance(source, Input) or (source.node.type, getattr(source.node, "operation", "")) != ("MATH", "MULTIPLY"):
        return []
    return source.inputs()[:2]


def _value_of(target: Input, factors: list[Product]) -> Product:
    if factors:
        return factors[0].times(factors[1])
    constant = number_at(target)
    if constant is not None:
        return Product((constant, constant, constant))
    source = follow(target)
    if isinstance(source, Input):
        raise NotUnderstoodError(f"is a color at the input {source.socket.name!r} of {source.socket.node.name!r}")
    node = source.node
    if source.socket.name == "Alpha" or (node.type == "TEX_IMAGE" and source.socket.name == "Color"):
        return _leaf_product(source)
    raise NotUnderstoodError(f"comes from the output {source.socket.name!r} of the node {node.name!r}")


def _leaf_product(source: Output) -> Product:
    """Return the product of an image or a color attribute alone, from the output Color or Alpha."""
    node = source.node
    if node.type == "TEX_IMAGE":
        return Product(texture=texture_of(source), channel=source.socket.name)
    if node.type == "VERTEX_COLOR":
        return Product(attribute=node.layer_name)
    if node.type == "ATTRIBUTE" and node.attribute_type == "GEOMETRY":
        return Product(attribute=node.attribute_name)
    raise NotUnderstoodError(f"comes from the node {node.name!r}")


def _cut(target: Input) -> tuple[Input, float | None]:
    """Return the input before a cutoff node, and the cutoff. Alpha is 1 from the cutoff up, 0 below it."""
    source = follow(target)
    if isinstance(source, Input) or source.node.type != "MATH":
        return target, None
    first, second, *_ = source.inputs()
    a, b = number_at(first), number_at(second)
    match source.node.operation:
        case "ROUND":
            return first, 0.5
        case "GREATER_THAN" if b is not None:
            return first, _above(b)
        case "LESS_THAN" if a is not None:
            return second, _above(a)
        case "SUBTRACT" if a == 1.0:
            return _cut_below(second) or (target, None)
    return target, None


def _above(limit: float) -> float:
    """Return the cutoff of a test for greater than `limit`: at least half an 8-bit step, so 0 stays transparent."""
    return max(limit, 0.5 / 255.0)


def _cut_below(target: Input) -> tuple[Input, float] | None:
    """Return the same as `_cut` for a value that is 1 below the cutoff and 0 from there up."""
    source = follow(target)
    if isinstance(source, Input) or source.node.type != "MATH":
        return None
    first, second, *_ = source.inputs()
    a, b = number_at(first), number_at(second)
    if source.node.operation == "LESS_THAN" and b is not None:
        return first, b
    if source.node.operation == "GREATER_THAN" and a is not None:
        return second, a
    return None
