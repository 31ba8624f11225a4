"""Builder of shaders that emit the colors of a material's shaders.

Mix Shaders, Add Shaders and groups are copied. Every other shader becomes an emission of its premultiplied color, or of
its reflected or transmitted part, and a Transparent BSDF of 1 − alpha. So renderers mix the colors as they mix the
shaders. The original shaders stay.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import bpy

from .node_links import Links, Output, folded, group_end, like

SHINE = "Leafcloud Shine"
"""Name of the Emission nodes."""

Light = Literal["all", "reflected", "transmitted", "coverage"]
"""The part of the light to emit; "coverage" is white light. All have the same alpha: it is the leaf's coverage."""

Socket: TypeAlias = bpy.types.NodeSocket

_BLACK, _WHITE = (0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 1.0, 1.0)


class Builder:
    """Builder of nodes in a tree. It reads the links that the tree has at the start."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree
        self.links = Links()

    def read(self, target: Socket) -> Any:
        """Return the socket that feeds an input, or the input's own value."""
        link = self.links.to(target)
        if link is not None:
            return link.from_socket
        value = target.default_value
        return value if isinstance(value, (float, int, str)) else tuple(value)

    def connect(self, value: Any, target: Socket) -> None:
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, target)
        elif isinstance(target.default_value, (float, int, str)):
            target.default_value = value
        else:
            size = len(target.default_value)
            values = (value,) * 3 if isinstance(value, float) else value[:3]
            target.default_value = (*values, 1.0)[:size]

    def node(self, kind: str, *values: Any, **settings: Any) -> bpy.types.Node:
        """Add a node with these inputs."""
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, setting in settings.items():
            setattr(node, name, setting)
        for value, target in zip(values, node.inputs, strict=False):
            self.connect(value, target)
        return node

    def math(self, operation: str, first: Any, second: Any) -> Socket:
        return self.node("Math", first, second, operation=operation).outputs[0]

    def vector(self, operation: str, first: Any, second: Any) -> Socket:
        return self.node("VectorMath", first, second, operation=operation).outputs[0]

    def scaled(self, color: Any, factor: Any) -> Socket:
        node = self.node("VectorMath", color, operation="SCALE")
        self.connect(factor, node.inputs["Scale"])
        return node.outputs["Vector"]

    def mixed(self, kind: str, *values: Any) -> Socket:
        """Add a Mix or Add Shader."""
        node = self.tree.nodes.new(f"ShaderNode{kind}Shader")
        for value, target in zip(values, node.inputs, strict=True):
            self.connect(value, target)
        return node.outputs[0]

    def clear(self, share: Any = 1.0) -> Socket:
        """Add a Transparent BSDF that transmits this share."""
        return self.node("BsdfTransparent", share).outputs[0]

    def emission(self, color: Any, alpha: Any = 1.0, strength: float = 1.0) -> Socket:
        """Add a shader that emits a premultiplied color and transmits 1 − alpha."""
        shown = self.node("Emission", color, strength, name=SHINE).outputs[0]
        return shown if alpha == 1.0 else self.mixed("Add", shown, self.clear(self.math("SUBTRACT", 1.0, alpha)))


class Emitter(Builder):
    """Builder of shaders that emit the colors of a tree's shaders, times a factor and a strength.

    `factor` adds the nodes of the factor to a tree.
    """

    def __init__(
        self,
        tree: bpy.types.NodeTree,
        light: Light = "all",
        factor: Callable[[bpy.types.NodeTree], Socket] | None = None,
        strength: float = 1.0,
    ) -> None:
        super().__init__(tree)
        self.light, self.factor, self.strength = light, factor, strength
        self._made: dict[Socket | None, Socket] = {}

    def emitting(self, target: Socket) -> Socket:
        """Return a shader that emits the color of the shader that feeds an input."""
        return folded(self._source(target), self._mixed_by, self._emitting, self._made)

    def _source(self, target: Socket) -> Socket | None:
        link = self.links.to(target)
        return None if link is None else link.from_socket

    def _mixed_by(self, source: Socket | None) -> list[Socket | None]:
        """Return the outputs of the shaders, in this tree, that a shader's node passes on or mixes."""
        if source is None:
            return []
        node = source.node
        if node.mute:
            targets = [link.from_socket for link in node.internal_links if link.to_socket == source]
        else:
            targets = [each for each in node.inputs if each.type == "SHADER" or node.type == "REROUTE"]
        return [self._source(target) for target in targets]

    def _emitting(self, source: Socket | None, mixed: list[Socket]) -> Socket:
        """Return the emitting shader for a node's output, from those of the shaders that it mixes."""
        if source is None:
            return self.clear()
        node = source.node
        if node.mute or node.type == "REROUTE":
            return mixed[0] if mixed else self.clear()
        match node.type:
            case "GROUP":
                return self._of_group(node, source, mixed)
            case "GROUP_INPUT":
                return source
            case "MIX_SHADER":
                return self.mixed("Mix", self.read(node.inputs[0]), *mixed)
            case "ADD_SHADER":
                return self.mixed("Add", *mixed)
            case "BSDF_TRANSPARENT" | "HOLDOUT":
                return self.clear()
        return self._of_shader(node)

    def _of_group(self, node: bpy.types.Node, source: Socket, mixed: list[Socket]) -> Socket:
        """Return the emitting shader from a copy of a group."""
        if node.node_tree is None or group_end(node.node_tree) is None:
            return self.clear()
        copy = self.node("Group", node_tree=node.node_tree.copy())
        end = group_end(copy.node_tree)
        assert end is not None  # the original has one
        target = like(end.inputs, source)
        inside = Emitter(copy.node_tree, self.light, self.factor, self.strength)
        inside.connect(inside.emitting(target), target)
        shaders = iter(mixed)
        for old, new in zip(node.inputs, copy.inputs, strict=True):
            self.connect(next(shaders) if old.type == "SHADER" else self.read(old), new)
        return like(copy.outputs, source)

    def _of_shader(self, node: bpy.types.Node) -> Socket:
        color = next((node.inputs[name] for name in ("Base Color", "Color") if name in node.inputs), None)
        shown = self._part(node, _BLACK if color is None else self.read(color))
        if self.factor is not None:
            shown = self.vector("MULTIPLY", shown, self.factor(self.tree))
        if node.type != "BSDF_PRINCIPLED":
            return self.emission(shown, 1.0, self.strength)
        alpha = self.read(node.inputs["Alpha"])
        return self.emission(self.scaled(shown, alpha), alpha, self.strength)

    def _part(self, node: bpy.types.Node, color: Any) -> Any:
        """Return the part of a shader's color that belongs to `light`."""
        if self.light in {"all", "coverage"}:
            return color if self.light == "all" else _WHITE
        through = self._through(node)
        return self.scaled(color, through if self.light == "transmitted" else self.math("SUBTRACT", 1.0, through))

    def _through(self, node: bpy.types.Node) -> Any:
        """Return the share of a shader's light that is transmitted, as in `translucency`."""
        if node.type == "BSDF_PRINCIPLED":
            clear, inside = (self.read(node.inputs[f"{name} Weight"]) for name in ("Transmission", "Subsurface"))
            back = self.math("SUBTRACT", 1.0, self.math("MULTIPLY", 0.5, inside))
            return self.math("SUBTRACT", 1.0, self.math("MULTIPLY", self.math("SUBTRACT", 1.0, clear), back))
        return {"BSDF_TRANSLUCENT": 1.0, "SUBSURFACE_SCATTERING": 0.5}.get(node.type, 0.0)


def outside_groups(shader: Output, instead: Socket) -> Socket:
    """Connect `instead`, in the tree of a shader inside groups, to the groups' outputs. Return the outermost output."""
    for group in reversed(shader.groups):
        end = group_end(group.node_tree)
        assert end is not None  # a visible group has one
        target = next(each for each in end.inputs if each.type == "SHADER")
        group.node_tree.links.new(instead, target)
        instead = like(group.outputs, target)
    return instead
