"""Builder of shaders that emit the colors of a material's shaders.

Mix Shaders, Add Shaders and groups are copied. Every other shader becomes an emission of its premultiplied color, or of
its reflected or transmitted part, and a Transparent BSDF of 1 − alpha. So renderers mix the colors as they mix the
shaders. The original shaders stay.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

import bpy

from ..nodes.builder import Section
from .node_links import Links, Port, folded, group_end, like

Light = Literal["all", "reflected", "transmitted", "coverage"]
"""The part of the light to emit; "coverage" is white light. All have the same alpha: it is the leaf's coverage."""

Socket: TypeAlias = bpy.types.NodeSocket

_BLACK, _WHITE = (0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 1.0, 1.0)


class Builder(Section):
    """Builder of nodes that read the links of a tree at the start."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        super().__init__(tree, "Emitted color", (0.0, 1000.0))
        self.links = Links()

    def source(self, target: Socket) -> Socket | None:
        link = self.links.to(target)
        return None if link is None else link.from_socket

    def read(self, target: Socket) -> Socket:
        """Return the socket that feeds an input, or a new node with the input's own value."""
        source = self.source(target)
        if source is None:
            return self.constant(target.default_value, "Value" if target.type == "VALUE" else "RGB")
        return source

    def constant(self, value: float | Sequence[float], kind: str = "RGB") -> Socket:
        socket = self.result(f"ShaderNode{kind}")
        socket.default_value = value
        return socket

    def clear(self, share: Socket | None = None) -> Socket:
        """Add a Transparent BSDF that transmits this share, or all light."""
        return self.result("ShaderNodeBsdfTransparent", share)

    def emission(self, color: Socket, alpha: Socket | None = None, strength: float = 1.0) -> Socket:
        """Add a shader that emits a premultiplied color and transmits 1 − alpha. `None`: it is opaque."""
        shown = self.result("ShaderNodeEmission", color, strength)
        clear = None if alpha is None else self.clear(self.math("SUBTRACT", 1.0, alpha))
        return shown if clear is None else self.result("ShaderNodeAddShader", shown, clear)


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
        self._light, self._factor, self._strength = light, factor, strength
        self._made: dict[Socket | None, Socket] = {}

    def emitting(self, target: Socket) -> Socket:
        """Return a shader that emits the color of the shader that feeds an input."""
        return folded(self.source(target), self._mixed_by, self._emitting, self._made)

    def _mixed_by(self, source: Socket | None) -> list[Socket | None]:
        """Return the outputs of the shaders, in this tree, that a shader's node passes on or mixes."""
        if source is None:
            return []
        node = source.node
        if node.mute:
            targets = [link.from_socket for link in node.internal_links if link.to_socket == source]
        else:
            targets = [each for each in node.inputs if each.type == "SHADER" or node.type == "REROUTE"]
        return [self.source(target) for target in targets]

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
                return self.result("ShaderNodeMixShader", self.read(node.inputs[0]), *mixed)
            case "ADD_SHADER":
                return self.result("ShaderNodeAddShader", *mixed)
            case "BSDF_TRANSPARENT" | "HOLDOUT":
                return self.clear()
        return self._of_shader(node)

    def _of_group(self, node: bpy.types.Node, source: Socket, mixed: list[Socket]) -> Socket:
        """Return the emitting shader from a copy of a group."""
        if node.node_tree is None or group_end(node.node_tree) is None:
            return self.clear()
        copy = self.node("ShaderNodeGroup", node_tree=node.node_tree.copy())
        end = group_end(copy.node_tree)
        assert end is not None  # the original has one
        target = like(end.inputs, source)
        inside = Emitter(copy.node_tree, self._light, self._factor, self._strength)
        copy.node_tree.links.new(inside.emitting(target), target)
        shaders = iter(mixed)
        for old, new in zip(node.inputs, copy.inputs, strict=True):
            fed = next(shaders) if old.type == "SHADER" else self.source(old)
            if fed is not None:
                self._tree.links.new(fed, new)
            elif hasattr(old, "default_value"):
                new.default_value = old.default_value
        return like(copy.outputs, source)

    def _of_shader(self, node: bpy.types.Node) -> Socket:
        shown = self._shown(node)
        if self._factor is not None:
            shown = self.vector("MULTIPLY", shown, self._factor(self._tree))
        if node.type != "BSDF_PRINCIPLED":
            return self.emission(shown, None, self._strength)
        alpha = self.read(node.inputs["Alpha"])
        return self.emission(self.vector("SCALE", shown, alpha), alpha, self._strength)

    def _shown(self, node: bpy.types.Node) -> Socket:
        """Return the part of a shader's color that belongs to the light."""
        if self._light == "coverage":
            return self.constant(_WHITE)
        target = next((node.inputs[name] for name in ("Base Color", "Color") if name in node.inputs), None)
        color = self.constant(_BLACK) if target is None else self.read(target)
        if self._light == "all":
            return color
        through = self._through(node)
        return self.vector("SCALE", color, through if self._light == "transmitted" else self._rest(through))

    def _through(self, node: bpy.types.Node) -> Socket | float:
        """Return the share of a shader's light that is transmitted, as in `translucency`."""
        if node.type == "BSDF_PRINCIPLED":
            clear, inside = (self.read(node.inputs[f"{name} Weight"]) for name in ("Transmission", "Subsurface"))
            return self._rest(self.math("MULTIPLY", self._rest(clear), self._rest(self.math("MULTIPLY", 0.5, inside))))
        return {"BSDF_TRANSLUCENT": 1.0, "SUBSURFACE_SCATTERING": 0.5}.get(node.type, 0.0)

    def _rest(self, share: Socket | float) -> Socket:
        return self.math("SUBTRACT", 1.0, share)


def outside_groups(shader: Port, instead: Socket) -> Socket:
    """Connect `instead`, in the tree of a shader inside groups, to the groups' outputs. Return the outermost output."""
    for group in reversed(shader.groups):
        end = group_end(group.node_tree)
        assert end is not None  # a visible group has one
        target = next(each for each in end.inputs if each.type == "SHADER")
        group.node_tree.links.new(instead, target)
        instead = like(group.outputs, target)
    return instead
