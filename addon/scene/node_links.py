"""Walking shader nodes against the flow: through reroutes, into and out of groups, past muted nodes.

Also past the node that a bake adds to the colors of leaves which it prunes: leaves that are not pruned have their own.

Nodes share what feeds them, so that the ways through n of them may be 2ⁿ: a walk looks at each node once. And a walk
may be as long as there are nodes, which is more than Python's stack has room for: none is recursive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import bpy

MEAN_SHARE = "leaf_mean_share"
"""The point attribute with the share of the mean in a leaf's colours; 0, as where it is missing, leaves them alone."""

_Part = TypeVar("_Part")
_Value = TypeVar("_Value")


class Links:
    """The links that feed inputs: not the muted ones, nor those of a cycle that Blender marks as not valid.

    Each tree's are looked up once, for Blender goes through all of them to find those of one socket.
    """

    def __init__(self) -> None:
        self._of_trees: dict[bpy.types.NodeTree, dict[bpy.types.NodeSocket, bpy.types.NodeLink]] = {}

    def to(self, socket: bpy.types.NodeSocket) -> bpy.types.NodeLink | None:
        tree = socket.id_data
        if tree not in self._of_trees:
            self._of_trees[tree] = {link.to_socket: link for link in tree.links if link.is_valid and not link.is_muted}
        return self._of_trees[tree].get(socket)


@dataclass(frozen=True)
class Input:
    """An input socket, and the groups that were entered to reach it, the innermost last."""

    socket: bpy.types.NodeSocket
    groups: tuple[bpy.types.Node, ...] = ()
    links: Links = field(default_factory=Links, repr=False, compare=False)
    """As they were when the walk began."""


@dataclass(frozen=True)
class Output:
    """An output socket of a node that is no group, reroute or muted node, and the groups entered to reach it."""

    socket: bpy.types.NodeSocket
    groups: tuple[bpy.types.Node, ...] = ()
    links: Links = field(default_factory=Links, repr=False, compare=False)

    @property
    def node(self) -> bpy.types.Node:
        return self.socket.node

    def input(self, identifier: str) -> Input:
        """The node's input with this identifier (names may repeat)."""
        return next(self._at(socket) for socket in self.node.inputs if socket.identifier == identifier)

    def inputs(self) -> list[Input]:
        return [self._at(socket) for socket in self.node.inputs]

    def _at(self, socket: bpy.types.NodeSocket) -> Input:
        return Input(socket, self.groups, self.links)


def folded(
    start: _Part, parts: Callable[[_Part], Sequence[_Part]], value: Callable[[_Part, list[_Value]], _Value]
) -> _Value:
    """What `value` makes of `start` and of the values of its parts, and so on; of each part once."""
    known: dict[_Part, _Value] = {}
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


def follow(target: Input) -> Output | Input:
    """What feeds an input: the output of a node, or the unlinked input whose own value counts."""
    while True:
        link = target.links.to(target.socket)
        if link is None:
            return target
        step = _enter(Output(link.from_socket, target.groups, target.links))
        if isinstance(step, Output):
            return step
        target = step


def number_at(target: Input) -> float | None:
    """The number at an input of type value, `None` where it varies."""
    source = follow(target)
    if isinstance(source, Input) and source.socket.type == "VALUE":
        return float(source.socket.default_value)
    if isinstance(source, Output) and source.node.type == "VALUE":
        return float(source.socket.default_value)
    return None


def _enter(source: Output) -> Output | Input:
    """The input that stands behind an output of a node which only passes values on, else the output itself."""
    node = source.node
    if node.mute:
        passed = next((link.from_socket for link in node.internal_links if link.to_socket == source.socket), None)
        return source if passed is None else Input(passed, source.groups, source.links)
    if node.type == "REROUTE":
        return Input(node.inputs[0], source.groups, source.links)
    if _pulls_to_mean(source):
        return source.input("A_Color")
    if node.type == "GROUP" and node.node_tree is not None:
        return _into_group(source)
    if node.type == "GROUP_INPUT" and source.groups:
        entry = _with_identifier(source.groups[-1].inputs, source.socket.identifier)
        return Input(entry, source.groups[:-1], source.links)
    return source


def _pulls_to_mean(source: Output) -> bool:
    """Whether a Mix node mixes the mean of the leaves' colors in by the attribute that a bake stores."""
    if source.node.type != "MIX" or source.node.data_type != "RGBA":
        return False
    link = source.links.to(source.input("Factor_Float").socket)
    return link is not None and getattr(link.from_node, "attribute_name", None) == MEAN_SHARE


def _into_group(source: Output) -> Output | Input:
    end = group_end(source.node.node_tree)
    if end is None:
        return source
    inside = _with_identifier(end.inputs, source.socket.identifier)
    return Input(inside, (*source.groups, source.node), source.links)


def _with_identifier(sockets: bpy.types.bpy_prop_collection, identifier: str) -> bpy.types.NodeSocket:
    return next(socket for socket in sockets if socket.identifier == identifier)


def group_end(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    """The node of a group's tree that hands out what the group gives."""
    return next((node for node in tree.nodes if node.type == "GROUP_OUTPUT" and node.is_active_output), None)


def node_count(tree: bpy.types.NodeTree) -> int:
    """The nodes that a renderer makes of a tree: a group's count wherever it is used, also within other groups."""
    return folded(tree, _groups_in, lambda each, inside: len(each.nodes) + sum(inside))


def _groups_in(tree: bpy.types.NodeTree) -> list[bpy.types.NodeTree]:
    return [node.node_tree for node in tree.nodes if node.type == "GROUP" and node.node_tree is not None]


def trees_of(tree: bpy.types.NodeTree) -> list[bpy.types.NodeTree]:
    """The tree, and those of the groups in it and in these; each once."""
    found = {tree: None}
    waiting = [tree]
    while waiting:
        new = [each for each in _groups_in(waiting.pop()) if each not in found]
        found |= dict.fromkeys(new)
        waiting += new
    return list(found)


MOST_WAYS, LONGEST_WAY = 10_000, 200
"""Counted in inputs: the glTF exporter takes up to a millisecond and a frame of the stack for each."""


def tangled_inputs(tree: bpy.types.NodeTree) -> list[bpy.types.NodeSocket]:
    """The inputs of a tree's shaders and groups behind which whoever goes all ways, as Blender's glTF exporter does,
    is lost for minutes, or deeper than Python's stack."""
    links = Links()
    nodes = (node for node in tree.nodes if node.type == "GROUP" or any(each.type == "SHADER" for each in node.outputs))
    inputs = [socket for node in nodes for socket in node.inputs if socket.type != "SHADER" and links.to(socket)]
    ways = ((socket, folded(Input(socket, links=links), _inputs_behind, _longer)) for socket in inputs)
    return [socket for socket, (count, length) in ways if count > MOST_WAYS or length > LONGEST_WAY]


def _inputs_behind(target: Input) -> list[Input]:
    source = follow(target)
    return source.inputs() if isinstance(source, Output) else []


def _longer(_: Input, ways: list[tuple[int, int]]) -> tuple[int, int]:
    """How many ways there are from an input, and how long the longest is, by those of the inputs behind it."""
    return 1 + sum(count for count, _ in ways), 1 + max((length for _, length in ways), default=0)


def output_of(tree: bpy.types.NodeTree, renderer: str = "CYCLES") -> bpy.types.Node | None:
    """The material output that a renderer takes, or the one for `ALL`; another where there is none."""
    return next(filter(None, map(tree.get_output_node, (renderer, "CYCLES", "ALL", "EEVEE"))), None)


def shown_nodes(tree: bpy.types.NodeTree) -> list[bpy.types.Node]:
    """The nodes, those in groups too, on which colour and alpha of a material depend: not what nobody is linked to."""
    output = output_of(tree)
    return [] if output is None else _upstream(output.inputs["Surface"])


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


def _upstream(target: bpy.types.NodeSocket) -> list[bpy.types.Node]:
    """What feeds an input before what feeds that, and so on."""
    links, found, waiting = Links(), dict[bpy.types.Node, None](), [target]
    while waiting:
        link = links.to(waiting.pop())
        if link is None or link.from_node in found:
            continue
        node = link.from_node
        found[node] = None
        end = group_end(node.node_tree) if node.type == "GROUP" and node.node_tree is not None else None
        inside = [] if end is None else list(end.inputs)
        waiting += reversed([*inside, *_inputs_shown(node)])
    return list(found)


def _inputs_shown(node: bpy.types.Node) -> list[bpy.types.NodeSocket]:
    """The inputs on which colour and alpha depend."""
    mixes = node.type in {"MIX_SHADER", "ADD_SHADER", "GROUP", "REROUTE", "GROUP_INPUT"}
    if mixes or all(socket.type != "SHADER" for socket in node.outputs):
        return list(node.inputs)
    return [socket for socket in node.inputs if socket.name in _OF_SHADERS]
