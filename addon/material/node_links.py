"""Upstream traversal of shader nodes: through reroutes, into and out of groups, past muted nodes.

The traversal also skips the node by which a bake mixes the mean color into pruned leaves: unpruned leaves have their
own color.

Nodes share inputs, so n nodes can have 2ⁿ paths. Each traversal therefore visits a node once. A path can be longer than
Python's stack allows, so no traversal is recursive.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import bpy

MEAN_SHARE = "leaf_mean_share"
"""Point attribute with the share of the mean color in a leaf's color. Default 0: the leaf's own color."""

_Part = TypeVar("_Part")
_Value = TypeVar("_Value")


class Links:
    """Links by the input that they feed, without muted links and links that Blender marks as invalid (cycles).

    The links of a tree are indexed once, because Blender scans all of them to find those of one socket.
    """

    def __init__(self) -> None:
        self._of_trees: dict[bpy.types.NodeTree, dict[bpy.types.NodeSocket, bpy.types.NodeLink]] = {}

    def to(self, socket: bpy.types.NodeSocket) -> bpy.types.NodeLink | None:
        tree = socket.id_data
        if tree not in self._of_trees:
            self._of_trees[tree] = {link.to_socket: link for link in tree.links if link.is_valid and not link.is_muted}
        return self._of_trees[tree].get(socket)


@dataclass(frozen=True)
class Port:
    """An input or output socket, and the group nodes entered to reach it, innermost last."""

    socket: bpy.types.NodeSocket
    groups: tuple[bpy.types.Node, ...] = ()
    links: Links = field(default_factory=Links, repr=False, compare=False)
    """The links at the start of the traversal."""

    @property
    def node(self) -> bpy.types.Node:
        return self.socket.node

    @property
    def kind(self) -> str:
        """The type of an output's node; empty for an input."""
        return str(self.node.type) if self.socket.is_output else ""

    def inputs(self) -> list[Port]:
        """Return the inputs of an output's node; none for an input."""
        return [self._at(socket) for socket in self.node.inputs] if self.socket.is_output else []

    def input(self, identifier: str) -> Port:
        """Return the node's input with this identifier. Names may repeat."""
        return next(self._at(socket) for socket in self.node.inputs if socket.identifier == identifier)

    def _at(self, socket: bpy.types.NodeSocket) -> Port:
        return Port(socket, self.groups, self.links)


def folded(
    start: _Part,
    parts: Callable[[_Part], Sequence[_Part]],
    value: Callable[[_Part, list[_Value]], _Value],
    known: dict[_Part, _Value] | None = None,
) -> _Value:
    """Return `value` of `start` and of the values of its parts, computed bottom-up, once for each part.

    `known`: values from earlier calls; new ones are added.
    """
    known = {} if known is None else known
    waiting = [start]
    while waiting:
        current = waiting[-1]
        own = [] if current in known else parts(current)
        missing = [part for part in own if part not in known]
        if missing:
            waiting += reversed(missing)
            continue
        if current not in known:
            known[current] = value(current, [known[part] for part in own])
        waiting.pop()
    return known[start]


def follow(target: Port) -> Port:
    """Return the source of an input: the output of a node, or an unlinked input with its own value."""
    while True:
        link = target.links.to(target.socket)
        if link is None:
            return target
        target = _enter(Port(link.from_socket, target.groups, target.links))
        if target.kind:
            return target


def number_at(target: Port) -> float | None:
    """Return the number at a value input; `None` if it varies."""
    source = follow(target)
    return float(source.socket.default_value) if (source.kind or source.socket.type) == "VALUE" else None


def share_at(target: Port) -> float | None:
    """Return the number at a value input, clamped to [0, 1] as in Blender; `None` if it varies."""
    number = number_at(target)
    return None if number is None else min(max(number, 0.0), 1.0)


def _enter(source: Port) -> Port:
    """Return the input behind an output of a node that only passes values on; else the output itself."""
    node = source.node
    if node.mute:
        passed = next((link.from_socket for link in node.internal_links if link.to_socket == source.socket), None)
        return source if passed is None else Port(passed, source.groups, source.links)
    if node.type == "REROUTE":
        return Port(node.inputs[0], source.groups, source.links)
    if _pulls_to_mean(source):
        return source.input("A_Color")
    end = group_end(node.node_tree) if node.type == "GROUP" and node.node_tree is not None else None
    if end is not None:
        return Port(like(end.inputs, source.socket), (*source.groups, node), source.links)
    if node.type == "GROUP_INPUT" and source.groups:
        return Port(like(source.groups[-1].inputs, source.socket), source.groups[:-1], source.links)
    return source


def _pulls_to_mean(source: Port) -> bool:
    """Return whether a Mix node mixes in the leaves' mean color by the attribute `MEAN_SHARE` of a bake."""
    if source.node.type != "MIX" or source.node.data_type != "RGBA":
        return False
    link = source.links.to(source.input("Factor_Float").socket)
    return link is not None and getattr(link.from_node, "attribute_name", None) == MEAN_SHARE


def like(sockets: Iterable[bpy.types.NodeSocket], other: Any) -> bpy.types.NodeSocket:
    """Return the socket with the same identifier as another one, or as an item of a group's interface."""
    return next(socket for socket in sockets if socket.identifier == other.identifier)


def group_end(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    """Return the active Group Port node of a group's tree; None without one."""
    return next((node for node in tree.nodes if node.type == "GROUP_OUTPUT" and node.is_active_output), None)


def node_count(tree: bpy.types.NodeTree) -> int:
    """Return the number of nodes of a tree, with those of a group counted for each use, also inside other groups."""
    return folded(tree, _groups_in, lambda each, inside: len(each.nodes) + sum(inside))


def _groups_in(tree: bpy.types.NodeTree) -> list[bpy.types.NodeTree]:
    return [node.node_tree for node in tree.nodes if node.type == "GROUP" and node.node_tree is not None]


def trees_of(tree: bpy.types.NodeTree) -> list[bpy.types.NodeTree]:
    """Return the tree and those of all nested groups, each once."""
    found = {tree: None}
    waiting = [tree]
    while waiting:
        new = [each for each in _groups_in(waiting.pop()) if each not in found]
        found |= dict.fromkeys(new)
        waiting += new
    return list(found)


MOST_WAYS, LONGEST_WAY = 10_000, 200
"""Limits on the inputs on all paths and on the longest path.

The glTF exporter takes up to a millisecond for each, and a stack frame for each on a path.
"""


def tangled_inputs(tree: bpy.types.NodeTree) -> list[bpy.types.NodeSocket]:
    """Return the inputs of a tree's shaders and groups that have too many or too long paths behind them.

    Blender's glTF exporter follows every path, recursively. There it would take minutes or overflow Python's stack.
    """
    links = Links()
    nodes = (node for node in tree.nodes if node.type == "GROUP" or any(each.type == "SHADER" for each in node.outputs))
    inputs = [socket for node in nodes for socket in node.inputs if socket.type != "SHADER" and links.to(socket)]
    ways = ((socket, folded(Port(socket, links=links), _inputs_behind, _longer)) for socket in inputs)
    return [socket for socket, (count, length) in ways if count > MOST_WAYS or length > LONGEST_WAY]


def _inputs_behind(target: Port) -> list[Port]:
    return follow(target).inputs()


def _longer(_: Port, ways: list[tuple[int, int]]) -> tuple[int, int]:
    """Return the number of inputs on all paths from an input, and on the longest, given those of the next inputs."""
    return 1 + sum(count for count, _ in ways), 1 + max((length for _, length in ways), default=0)


def output_of(tree: bpy.types.NodeTree, renderer: str = "CYCLES") -> bpy.types.Node | None:
    """Return the material output for a renderer, else for Cycles, all renderers or EEVEE; None without any."""
    return next(filter(None, map(tree.get_output_node, (renderer, "CYCLES", "ALL", "EEVEE"))), None)


def shown_nodes(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """Return the nodes on which color, alpha and translucency of a material depend, including nodes in groups."""
    output = output_of(tree)
    return [] if output is None else nodes_behind([Port(output.inputs["Surface"])])


def nodes_behind(targets: Sequence[Port]) -> list[bpy.types.Node]:
    """Return the nodes on which inputs depend, including nodes in groups, each once."""
    return list(dict.fromkeys(source.node for source in sources_behind(targets)))


def sources_behind(targets: Sequence[Port]) -> list[Port]:
    """Return an output of each node on which inputs depend, depth first. Groups, reroutes and muted nodes are skipped.

    A node in a group comes once for each use of the group. Of shaders only `_OF_SHADERS` count.
    """
    found: dict[tuple[bpy.types.Node, tuple[bpy.types.Node, ...]], Port] = {}
    waiting = list(reversed(targets))
    while waiting:
        source = follow(waiting.pop())
        if source.kind and (key := (source.node, source.groups)) not in found:
            found[key] = source
            waiting += reversed(_inputs_shown(source))
    return list(found.values())


_OF_SHADERS = {"Base Color", "Color", "Alpha", "Transmission Weight", "Subsurface Weight"}
"""Inputs of a shader, other than mixes, that determine its color, alpha and translucency."""


def _inputs_shown(source: Port) -> list[Port]:
    """Return the linked inputs of a node that count."""
    node, linked = source.node, [target for target in source.inputs() if target.socket.is_linked]
    if node.type in {"MIX_SHADER", "ADD_SHADER"} or all(socket.type != "SHADER" for socket in node.outputs):
        return linked
    return [target for target in linked if target.socket.name in _OF_SHADERS]


def can_render(tree: bpy.types.NodeTree) -> bool:
    """Return whether a tree has a surface, and all its image nodes have an image."""
    nodes = shown_nodes(tree)
    return bool(nodes) and not any(node.type == "TEX_IMAGE" and node.image is None for node in nodes)
