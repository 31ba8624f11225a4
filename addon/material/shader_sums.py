"""Builder of nodes that compute base color and alpha of a shader tree, and of a node that emits them.

A Mix Shader mixes both, an Add Shader adds them, a Transparent BSDF has alpha 0. All other shaders give their color, or
its reflected or transmitted part. Groups get additional sockets to pass color and alpha.
"""

from __future__ import annotations

from typing import Any, Literal

import bpy

from .node_links import Links, folded, group_end, like

SHINE = "Leafcloud Shine"
"""Name of the Emission node."""

Light = Literal["all", "reflected", "transmitted"]
"""The part of the light to show. Transmitted light has the same alpha as all light: alpha is the leaf's coverage."""


def shining(builder: Builder, color: Any, alpha: Any, strength: float = 1.0) -> bpy.types.Node:
    """Add and return a shader that emits a premultiplied color and transmits 1 − alpha."""
    tree = builder.tree
    emission, clear, both = (tree.nodes.new(f"ShaderNode{k}") for k in ("Emission", "BsdfTransparent", "AddShader"))
    emission.name, emission.inputs["Strength"].default_value = SHINE, strength
    builder.connect(color, emission.inputs["Color"])
    builder.connect(builder.math("SUBTRACT", 1.0, alpha), clear.inputs["Color"])
    tree.links.new(emission.outputs[0], both.inputs[0])
    tree.links.new(clear.outputs[0], both.inputs[1])
    return both


_BLACK = (0.0, 0.0, 0.0, 1.0)
_NOTHING: tuple[Any, Any] = (_BLACK, 0.0)

_SHADERS = {"REROUTE": (0, 1), "MIX_SHADER": (1, 3), "ADD_SHADER": (0, 2)}
"""By node type: the slice of inputs with the shaders that a node passes on or mixes."""


class Builder:
    """Builder of nodes that compute each shader's premultiplied color and its alpha, as sockets or constants."""

    def __init__(
        self, tree: bpy.types.NodeTree, light: Light = "all", outside: tuple[Builder, bpy.types.Node] | None = None
    ) -> None:
        self.tree = tree
        self.light = light
        self.outside = outside
        """For a group's tree: the builder of the outer tree, and the group's node in it."""
        self._links = Links()  # Links of the original shaders; added nodes read from them.
        self._sums: dict[bpy.types.NodeSocket | None, tuple[Any, Any]] = {None: _NOTHING}

    def color_and_alpha(self, target: bpy.types.NodeSocket) -> tuple[Any, Any]:
        """Return color and alpha of the shader that feeds an input."""
        return folded(self._source(target), self._mixed_by, self._sum, self._sums)

    def _source(self, target: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
        link = self._links.to(target)
        return None if link is None else link.from_socket

    def _mixed_by(self, source: bpy.types.NodeSocket | None) -> list[bpy.types.NodeSocket | None]:
        """Return the outputs of the shaders, in this tree, that a shader's node passes on or mixes."""
        if source is None:
            return []
        node = source.node
        if node.mute:
            inputs = [link.from_socket for link in node.internal_links if link.to_socket == source]
        else:
            inputs = list(node.inputs[slice(*_SHADERS.get(node.type, (0, 0)))])
        return [self._source(target) for target in inputs]

    def _sum(self, source: bpy.types.NodeSocket, mixed: list[tuple[Any, Any]]) -> tuple[Any, Any]:
        """Return color and alpha of a node's output, from those of the shaders that it mixes."""
        node = source.node
        if node.mute or node.type == "REROUTE":
            return mixed[0] if mixed else _NOTHING
        match node.type:
            case "GROUP":
                return self._of_group(node, source)
            case "GROUP_INPUT":
                return self._from_outside(node, source)
            case "MIX_SHADER":
                return self._mixed(node, *mixed)
            case "ADD_SHADER":
                (c1, a1), (c2, a2) = mixed
                return self.vector("ADD", c1, c2), self.math("MINIMUM", self.math("ADD", a1, a2), 1.0)
            case "BSDF_TRANSPARENT" | "HOLDOUT":
                return _NOTHING
        return self._of_shader(node)

    def _mixed(self, node: bpy.types.Node, first: tuple[Any, Any], second: tuple[Any, Any]) -> tuple[Any, Any]:
        (c1, a1), (c2, a2) = first, second
        share = self.math("MINIMUM", self.math("MAXIMUM", self.read(node.inputs[0]), 0.0), 1.0)
        rest = self.math("SUBTRACT", 1.0, share)
        color = self.vector("ADD", self.scaled(c1, rest), self.scaled(c2, share))
        return color, self.math("ADD", self.math("MULTIPLY", a1, rest), self.math("MULTIPLY", a2, share))

    def _of_shader(self, node: bpy.types.Node) -> tuple[Any, Any]:
        color = next((node.inputs[name] for name in ("Base Color", "Color") if name in node.inputs), None)
        if color is None:
            return _BLACK, 1.0
        shown = self._part(node, self.read(color))
        if node.type != "BSDF_PRINCIPLED":
            return shown, 1.0
        alpha = self.read(node.inputs["Alpha"])
        return self.scaled(shown, alpha), alpha

    def _part(self, node: bpy.types.Node, color: Any) -> Any:
        """Return the part of a shader's color that belongs to `light`."""
        if self.light == "all":
            return color
        through = self._through(node)
        return self.scaled(color, through if self.light == "transmitted" else self.math("SUBTRACT", 1.0, through))

    def _through(self, node: bpy.types.Node) -> Any:
        """Return the share of a shader's light that is transmitted, as in `translucency`."""
        if node.type == "BSDF_PRINCIPLED":
            clear, inside = (self.read(node.inputs[f"{name} Weight"]) for name in ("Transmission", "Subsurface"))
            back = self.math("SUBTRACT", 1.0, self.math("MULTIPLY", 0.5, inside))
            return self.math("SUBTRACT", 1.0, self.math("MULTIPLY", self.math("SUBTRACT", 1.0, clear), back))
        return {"BSDF_TRANSLUCENT": 1.0, "SUBSURFACE_SCATTERING": 0.5}.get(node.type, 0.0)

    def _of_group(self, node: bpy.types.Node, source: bpy.types.NodeSocket) -> tuple[Any, Any]:
        """Return color and alpha from inside a group, by two additional outputs."""
        end = None if node.node_tree is None else group_end(node.node_tree)
        if end is None:
            return _NOTHING
        inside = Builder(node.node_tree, self.light, (self, node))
        color, alpha = inside.color_and_alpha(like(end.inputs, source))
        return inside.handed_out(node, color, "Color"), inside.handed_out(node, alpha, "Float")

    def handed_out(self, group: bpy.types.Node, value: Any, kind: str) -> bpy.types.NodeSocket:
        """Return an additional output of the node `group`, this tree's group node, for a value in this tree."""
        socket = self._new_socket("OUTPUT", kind)
        end = group_end(self.tree)
        assert end is not None  # a visible group has one
        self.connect(value, like(end.inputs, socket))
        return like(group.outputs, socket)

    def _from_outside(self, start: bpy.types.Node, source: bpy.types.NodeSocket) -> tuple[Any, Any]:
        """Return color and alpha of a shader outside this group, by two additional group inputs."""
        if self.outside is None:
            return _NOTHING
        outer, group = self.outside
        color, alpha = outer.color_and_alpha(like(group.inputs, source))
        sockets = self._new_socket("INPUT", "Color"), self._new_socket("INPUT", "Float")
        for value, socket in zip((color, alpha), sockets, strict=True):
            outer.connect(value, like(group.inputs, socket))
        return like(start.outputs, sockets[0]), like(start.outputs, sockets[1])

    def _new_socket(self, way: str, kind: str) -> bpy.types.NodeTreeInterfaceSocket:
        return self.tree.interface.new_socket("leafcloud", in_out=way, socket_type=f"NodeSocket{kind}")

    def read(self, target: bpy.types.NodeSocket) -> Any:
        """Return the socket that feeds an input, or the input's own value."""
        link = self._links.to(target)
        if link is not None:
            return link.from_socket
        value = target.default_value
        return value if isinstance(value, float) else tuple(value)

    def connect(self, value: Any, target: bpy.types.NodeSocket) -> None:
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, target)
        elif isinstance(target.default_value, float):
            target.default_value = value
        else:
            size = len(target.default_value)
            values = (value,) * 3 if isinstance(value, float) else value[:3]
            target.default_value = (*values, 1.0)[:size]

    def math(self, operation: str, first: Any, second: Any) -> bpy.types.NodeSocket:
        return self._operation("ShaderNodeMath", operation, first, second)

    def vector(self, operation: str, first: Any, second: Any) -> bpy.types.NodeSocket:
        return self._operation("ShaderNodeVectorMath", operation, first, second)

    def combined(self, *parts: Any) -> bpy.types.NodeSocket:
        """Return three values as one vector."""
        node = self.tree.nodes.new("ShaderNodeCombineXYZ")
        for target, part in zip(node.inputs, parts, strict=True):
            self.connect(part, target)
        return node.outputs[0]

    def scaled(self, color: Any, factor: Any) -> bpy.types.NodeSocket:
        node = self.tree.nodes.new("ShaderNodeVectorMath")
        node.operation = "SCALE"
        self.connect(color, node.inputs[0])
        self.connect(factor, node.inputs["Scale"])
        return node.outputs["Vector"]

    def _operation(self, kind: str, operation: str, first: Any, second: Any) -> bpy.types.NodeSocket:
        node = self.tree.nodes.new(kind)
        node.operation = operation
        self.connect(first, node.inputs[0])
        self.connect(second, node.inputs[1])
        return node.outputs[0]
