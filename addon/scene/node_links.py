"""Walking shader nodes against the flow: through reroutes, into and out of groups, past muted nodes.

Also past the node that a bake adds to the colors of leaves which it prunes: leaves that are not pruned have their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import bpy

MEAN_SHARE = "leaf_mean_share"
"""The point attribute with the share of the mean in a leaf's colours; 0, as where it is missing, leaves them alone."""


@dataclass(frozen=True)
class Input:
    """An input socket, and the groups that were entered to reach it, the innermost last."""

    socket: bpy.types.NodeSocket
    groups: tuple[bpy.types.Node, ...] = ()


@dataclass(frozen=True)
class Output:
    """An output socket of a node that is no group, reroute or muted node, and the groups entered to reach it."""

    socket: bpy.types.NodeSocket
    groups: tuple[bpy.types.Node, ...] = ()

    @property
    def node(self) -> bpy.types.Node:
        return self.socket.node

    def input(self, identifier: str) -> Input:
        """The node's input with this identifier (names may repeat)."""
        return next(self._at(socket) for socket in self.node.inputs if socket.identifier == identifier)

    def inputs(self) -> list[Input]:
        return [self._at(socket) for socket in self.node.inputs]

    def _at(self, socket: bpy.types.NodeSocket) -> Input:
        return Input(socket, self.groups)


def follow(target: Input) -> Output | Input:
    """What feeds an input: the output of a node, or the unlinked input whose own value counts."""
    while True:
        link = next((link for link in target.socket.links if not link.is_muted), None)
        if link is None:
            return target
        step = _enter(Output(link.from_socket, target.groups))
        if isinstance(step, Output):
            return step
        target = step


def _enter(source: Output) -> Output | Input:
    """The input that stands behind an output of a node which only passes values on, else the output itself."""
    node = source.node
    if node.mute:
        passed = next((link.from_socket for link in node.internal_links if link.to_socket == source.socket), None)
        return source if passed is None else Input(passed, source.groups)
    if node.type == "REROUTE":
        return Input(node.inputs[0], source.groups)
    if _pulls_to_mean(node):
        return source.input("A_Color")
    if node.type == "GROUP" and node.node_tree is not None:
        return _into_group(source)
    if node.type == "GROUP_INPUT" and source.groups:
        return Input(_with_identifier(source.groups[-1].inputs, source.socket.identifier), source.groups[:-1])
    return source


def _pulls_to_mean(node: bpy.types.Node) -> bool:
    """Whether a Mix node mixes the mean of the leaves' colors in by the attribute that a bake stores."""
    if node.type != "MIX" or node.data_type != "RGBA":
        return False
    shares = (link.from_node for socket in node.inputs if socket.identifier == "Factor_Float" for link in socket.links)
    return any(share.type == "ATTRIBUTE" and share.attribute_name == MEAN_SHARE for share in shares)


def _into_group(source: Output) -> Output | Input:
    outputs = [node for node in source.node.node_tree.nodes if node.type == "GROUP_OUTPUT" and node.is_active_output]
    if not outputs:
        return source
    inside = _with_identifier(outputs[0].inputs, source.socket.identifier)
    return Input(inside, (*source.groups, source.node))


def _with_identifier(sockets: bpy.types.bpy_prop_collection, identifier: str) -> bpy.types.NodeSocket:
    return next(socket for socket in sockets if socket.identifier == identifier)


def output_of(tree: bpy.types.NodeTree, renderer: str = "CYCLES") -> bpy.types.Node | None:
    """The material output that a renderer takes, or the one for `ALL`; another where there is none."""
    return next(filter(None, map(tree.get_output_node, (renderer, "CYCLES", "ALL", "EEVEE"))), None)


def shown_nodes(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """The nodes, those in groups too, on which colour and alpha of a material depend: not what nobody is linked to."""
    output = output_of(tree)
    return [] if output is None else list(_upstream([output.inputs["Surface"]], set()))


def nodes_behind(targets: Sequence[Input]) -> list[bpy.types.Node]:
    """The nodes, those in groups too, on which inputs depend."""
    found: dict[tuple[bpy.types.Node, tuple[bpy.types.Node, ...]], None] = {}
    waiting = list(targets)
    while waiting:
        source = follow(waiting.pop())
        if isinstance(source, Output) and (key := (source.node, source.groups)) not in found:
            found[key] = None
            waiting += source.inputs()
    return list(dict.fromkeys(node for node, _ in found))


def can_render(tree: bpy.types.NodeTree) -> bool:
    """Whether the nodes show anything, and none of them waits for an image."""
    nodes = shown_nodes(tree)
    return bool(nodes) and not any(node.type == "TEX_IMAGE" and node.image is None for node in nodes)


_OF_SHADERS = {"Base Color", "Color", "Alpha", "Transmission Weight", "Subsurface Weight"}
"""What colour and alpha depend on, of the inputs of a shader that mixes no others; and what shines through."""


def _upstream(targets: list[bpy.types.NodeSocket], seen: set[object]) -> Iterator[bpy.types.Node]:
    for link in [link for target in targets for link in target.links if not link.is_muted]:
        node = link.from_node
        if node in seen:
            continue
        seen.add(node)
        yield node
        inputs = list(node.inputs)
        if node.type not in {"MIX_SHADER", "ADD_SHADER", "GROUP", "REROUTE", "GROUP_INPUT"} and any(
            socket.type == "SHADER" for socket in node.outputs
        ):
            inputs = [socket for socket in inputs if socket.name in _OF_SHADERS]
        if node.type == "GROUP" and node.node_tree is not None:
            ends = [inner for inner in node.node_tree.nodes if inner.type == "GROUP_OUTPUT" and inner.is_active_output]
            yield from _upstream([socket for end in ends for socket in end.inputs], seen)
        yield from _upstream(inputs, seen)
