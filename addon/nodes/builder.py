"""A node builder: node trees written like formulas, with an automatic layout."""

from __future__ import annotations

from typing import Any, TypeAlias

import bpy

Operand: TypeAlias = bpy.types.NodeSocket | float | str | tuple[float, ...] | None
"""The operand of a node's input: a socket to link, a constant, or None to keep the default."""


class Section:
    """A labeled frame of a node tree. It places each new node to the right of its operands, below other nodes.

    The methods that add nodes take sockets and constants and return the result's socket, so calls nest like a formula.
    """

    _COLUMN_WIDTH = 220.0
    _ROW_GAP = 40.0

    def __init__(self, tree: bpy.types.NodeTree, label: str, origin: tuple[float, float]) -> None:
        self._tree = tree
        self._columns: dict[str, int] = {}
        self._bottoms: dict[int, float] = {}
        self._frame = tree.nodes.new("NodeFrame")
        self._frame.label = label
        self._frame.location = origin

    @property
    def frame(self) -> bpy.types.Node:
        """The frame, for nodes that the section does not place."""
        return self._frame

    def node(self, kind: str, *operands: Operand, label: str = "", **properties: Any) -> bpy.types.Node:
        """Add a node with `operands` on its enabled inputs, in order. `None` keeps an input's default.

        properties: attributes of the node.
        """
        node = self._tree.nodes.new(kind)
        node.label = label
        for key, value in properties.items():
            setattr(node, key, value)
        inputs = [socket for socket in node.inputs if socket.enabled]
        for socket, operand in zip(inputs, operands, strict=False):
            if isinstance(operand, bpy.types.NodeSocket):
                self._tree.links.new(operand, socket)
            elif operand is not None:
                socket.default_value = operand
        self._place(node, operands)
        return node

    def result(self, kind: str, *operands: Operand, label: str = "", **properties: Any) -> bpy.types.NodeSocket:
        """Add a node as `node` does. Return its first enabled output."""
        node = self.node(kind, *operands, label=label, **properties)
        return next(socket for socket in node.outputs if socket.enabled)

    def group_input(self, name: str) -> bpy.types.NodeSocket:
        """Return the group's input `name`, on a new Group Input node that hides the other inputs."""
        node = self._tree.nodes.new("NodeGroupInput")
        for socket in node.outputs:
            socket.hide = socket.name != name
        self._place(node, ())
        return node.outputs[name]

    def math(self, operation: str, *operands: Operand, label: str = "", clamp: bool = False) -> bpy.types.NodeSocket:
        return self.result("ShaderNodeMath", *operands, label=label, operation=operation, use_clamp=clamp)

    def vector(self, operation: str, *operands: Operand, label: str = "") -> bpy.types.NodeSocket:
        return self.result("ShaderNodeVectorMath", *operands, label=label, operation=operation)

    def mix(self, factor: Operand, a: Operand, b: Operand, label: str) -> bpy.types.NodeSocket:
        """Return the vector (1 − factor)·a + factor·b."""
        return self.result("ShaderNodeMix", factor, a, b, label=label, data_type="VECTOR")

    def compare(self, a: Operand, operation: str, b: Operand, label: str = "") -> bpy.types.NodeSocket:
        return self.result("FunctionNodeCompare", a, b, label=label, operation=operation)

    def compare_integers(self, a: Operand, operation: str, b: Operand, label: str = "") -> bpy.types.NodeSocket:
        return self.result("FunctionNodeCompare", a, b, label=label, operation=operation, data_type="INT")

    def logic(self, a: Operand, operation: str, b: Operand, label: str = "") -> bpy.types.NodeSocket:
        return self.result("FunctionNodeBooleanMath", a, b, label=label, operation=operation)

    def switch(
        self, kind: str, condition: Operand, otherwise: Operand, then: Operand, label: str
    ) -> bpy.types.NodeSocket:
        """Return `then` where `condition` is true, else `otherwise`. The other branch is not evaluated."""
        return self.result("GeometryNodeSwitch", condition, otherwise, then, label=label, input_type=kind)

    def attribute(self, kind: str, name: str) -> bpy.types.NodeSocket:
        """Return the point attribute `name`; 0 on a mesh without it."""
        return self.result("GeometryNodeInputNamedAttribute", name, label=name, data_type=kind)

    def integer_attribute(self, name: str) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
        """Return the integer point attribute `name`, and whether the mesh has it."""
        node = self.node("GeometryNodeInputNamedAttribute", name, label=name, data_type="INT")
        return next(socket for socket in node.outputs if socket.enabled), node.outputs["Exists"]

    def vector_attribute(self, name: str, missing: Operand) -> bpy.types.NodeSocket:
        """Return the vector point attribute `name`; `missing` on a mesh without it."""
        node = self.node("GeometryNodeInputNamedAttribute", name, label=name, data_type="FLOAT_VECTOR")
        value, exists = node.outputs["Attribute"], node.outputs["Exists"]
        return self.switch("VECTOR", exists, missing, value, label=f"{name} or default")

    def at_index(
        self, value: bpy.types.NodeSocket, index: bpy.types.NodeSocket, label: str, **properties: Any
    ) -> bpy.types.NodeSocket:
        """Return the field `value` at another `index` of a domain; 0 outside.

        It links inputs by name, because Blender versions order them differently.
        """
        node = self._tree.nodes.new("GeometryNodeFieldAtIndex")
        node.label = label
        for key, setting in properties.items():
            setattr(node, key, setting)
        for socket in node.inputs:
            if socket.enabled:
                self._tree.links.new(index if socket.name == "Index" else value, socket)
        self._place(node, (value, index))
        return next(socket for socket in node.outputs if socket.enabled)

    def capture(
        self, geometry: bpy.types.NodeSocket, domain: str, label: str, **values: tuple[str, bpy.types.NodeSocket]
    ) -> tuple[bpy.types.NodeSocket, ...]:
        """Capture fields on a `domain` of the geometry. Return the geometry, then a field per captured value.

        values: a type, such as FLOAT, and a field for each name. On instances each instanced geometry is evaluated
        separately, unless the domain is INSTANCE.
        """
        node = self._tree.nodes.new("GeometryNodeCaptureAttribute")
        node.label, node.domain = label, domain
        self._tree.links.new(geometry, node.inputs["Geometry"])
        for name, (kind, value) in values.items():
            node.capture_items.new(kind, name)
            self._tree.links.new(value, node.inputs[name])
        self._place(node, (geometry, *(value for _, value in values.values())))
        return (node.outputs["Geometry"], *(node.outputs[name] for name in values))

    def _place(self, node: bpy.types.Node, operands: tuple[Operand, ...]) -> None:
        used = [operand.node.name for operand in operands if isinstance(operand, bpy.types.NodeSocket)]
        column = max((self._columns[name] + 1 for name in used if name in self._columns), default=0)
        top = self._bottoms.get(column, 0.0)
        self._columns[node.name] = column
        self._bottoms[column] = top - _drawn_height(node) - self._ROW_GAP
        node.parent = self._frame
        node.location = (column * self._COLUMN_WIDTH, top)


def _drawn_height(node: bpy.types.Node) -> float:
    """Return the estimated height of the node. Blender knows the height only after it has drawn the node."""
    rows = 2.0  # header and one menu
    for socket in (*node.inputs, *node.outputs):
        if socket.enabled and not socket.hide:
            rows += 3.0 if socket.type == "VECTOR" and not socket.is_output and not socket.is_linked else 1.0
    return rows * 24.0
