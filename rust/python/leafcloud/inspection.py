"""The contents of a GLB file of a tree, by any tool: levels, bytes, promises, and what engines lose."""

from __future__ import annotations

import itertools
import math
import re
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import LeafcloudError, decode_image, keep
from ._coverage import kept_by_mips
from ._glb import GlbFile, Picture, Unreadable

_LEAST_SHARE = 0.95
"""Least share of the corners of leaves that end on a plane of the next level."""

_KEPT = 0.5, 1.5
"""Least and most share of a texture's coverage that the first mip level keeps: its texels are a pixel large where the
level takes over."""

_MOST_TEXELS = 2**24
"""Most texels of a picture that is decoded."""

_MOST_PAIRS = 2**22
"""Most pairs of a point and a plane that are compared at once."""

_MOST_CORNERS = 20_000
"""Most corners of leaves that are compared with the planes of the next level, evenly chosen: it may have thousands."""


@dataclass(frozen=True)
class LevelRow:
    """A level of the file, or the whole scene of a file without levels.

    number: of the level; None for levels of another tool, and without levels. attributes: of all meshes.
    vertex_bytes: with indices and morph targets.
    """

    name: str
    number: int | None
    triangles: int
    vertices: int
    attributes: tuple[str, ...]
    vertex_bytes: int
    pictures: tuple[Picture, ...]

    @property
    def texture_bytes(self) -> int:
        """Bytes of all its textures on a graphics card."""
        return sum(picture.gpu_bytes for picture in self.pictures)


@dataclass(frozen=True)
class Check:
    """A promise of the file: its name, whether it holds, and the figure."""

    name: str
    holds: bool
    figure: str


@dataclass(frozen=True)
class Inspection:
    """All that is known of a file."""

    levels: tuple[LevelRow, ...]
    checks: tuple[Check, ...]
    engines: tuple[tuple[str, str], ...]


_LEVEL = re.compile(r"(?:^|[\W_])lod[\W_]*(\d{1,2})(?![a-z0-9])", re.IGNORECASE)
"""A name of a level of another tool, such as Oak_LOD2."""

_BROKEN = (
    *(KeyError, IndexError, TypeError, ValueError, AttributeError),
    *(RecursionError, OverflowError, MemoryError, struct.error),
)
"""Errors by which a document says that it is not as glTF asks."""


def inspect(path: Path) -> Inspection:
    """Read a GLB file. Raises `LeafcloudError` for a file that is none, or that is broken."""
    with reading(path):
        file = GlbFile(path)
        levels = tuple(_row(file, *each) for each in levels_of(file))
        return Inspection(levels, tuple(_checks(file)), tuple(_engines(file, levels)))


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Raise `LeafcloudError` in place of the errors by which a document says that it is not as glTF asks."""
    try:
        yield
    except _BROKEN as error:
        raise LeafcloudError(f"{path} is broken: {type(error).__name__} {error}; export it again") from error


def levels_of(file: GlbFile) -> list[tuple[str, int | None, list[int]]]:
    """Return name, number and nodes of each level: of a bake, else of another tool by names, else the whole scene.

    Another tool's file is taken for one tree: nodes with the same number are one level.
    """
    nodes = file.items("nodes")
    chains = _chains(file)
    if chains:
        return [(_name(file, node), _extras(nodes[node])["level"], [node]) for chain in chains for node in chain]
    numbers = {node: int(found[1]) for node in range(len(nodes)) if (found := _LEVEL.search(_name(file, node)))}
    if len({*numbers.values()}) < 2:
        return [(file.path.stem, None, _shown(file))]
    inner = {each for node in numbers for each in below(file, [node]) if each != node}
    tops = {
        number: [node for node in numbers if numbers[node] == number and node not in inner]
        for number in numbers.values()
    }
    return [(_name(file, tops[number][0]), None, tops[number]) for number in sorted(tops) if tops[number]]


def _shown(file: GlbFile) -> list[int]:
    """Return the nodes of the default scene; without scenes all nodes that are below no other."""
    scenes = file.items("scenes")
    if scenes:
        return list(scenes[file.document.get("scene", 0)].get("nodes", []))
    nodes = file.items("nodes")
    inner = {child for node in nodes for child in node.get("children", [])}
    return [number for number in range(len(nodes)) if number not in inner]


def _chains(file: GlbFile) -> list[list[int]]:
    """Return the nodes of all levels, one list a tree, by level. A tree's level 0 names the others."""
    nodes = file.items("nodes")
    baked = [number for number, node in enumerate(nodes) if "level" in _extras(node)]
    named = {number: nodes[number].get("extensions", {}).get("MSFT_lod", {}).get("ids", []) for number in baked}
    heads = [number for number in baked if named[number]]
    later = {number for head in heads for number in named[head]}
    chains = [[head, *named[head]] for head in heads]
    chains += [[number] for number in baked if number not in later and number not in heads]
    return [sorted(chain, key=lambda number: _extras(nodes[number])["level"]) for chain in chains]


def _name(file: GlbFile, node: int) -> str:
    """Return the name of a node, fit to be printed."""
    name = str(file.items("nodes")[node].get("name", f"node {node}"))
    return "".join(letter if letter.isprintable() else "?" for letter in name)


def _row(file: GlbFile, name: str, number: int | None, roots: list[int]) -> LevelRow:
    primitives = [each for node in below(file, roots) for each in _primitives(file, node)]
    accessors: dict[int, int] = {}
    images: dict[int, Picture] = {}
    triangles = vertices = 0
    for primitive in primitives:
        used = [*primitive["attributes"].values(), *(a for t in primitive.get("targets", []) for a in t.values())]
        position = file.items("accessors")[primitive["attributes"]["POSITION"]]["count"]
        if "indices" in primitive:
            used.append(primitive["indices"])
        corners = file.items("accessors")[primitive["indices"]]["count"] if "indices" in primitive else position
        vertices += position
        triangles += _triangles(primitive.get("mode", 4), corners)
        accessors |= {accessor: file.size_of(accessor) for accessor in used}
        for image in _images(file, primitive.get("material")):
            images[image] = file.picture(image)
    names = dict.fromkeys(name for primitive in primitives for name in primitive["attributes"])
    if any(primitive.get("targets") for primitive in primitives):
        names["morph target"] = None
    return LevelRow(name, number, triangles, vertices, tuple(names), sum(accessors.values()), tuple(images.values()))


def _triangles(mode: int, corners: int) -> int:
    """Return the number of triangles of a primitive: of a list, or of a strip or a fan; 0 of lines and points."""
    return corners // 3 if mode == 4 else max(corners - 2, 0) if mode > 4 else 0


def below(file: GlbFile, roots: list[int]) -> list[int]:
    """Return the nodes and all nodes below them, each once."""
    found: dict[int, None] = {}
    ahead = list(reversed(roots))
    while ahead:
        node = ahead.pop()
        if node not in found:
            found[node] = None
            ahead += reversed(file.items("nodes")[node].get("children", []))
    return list(found)


def _primitives(file: GlbFile, node: int) -> list[dict[str, Any]]:
    mesh = file.items("nodes")[node].get("mesh")
    return [] if mesh is None else list(file.items("meshes")[mesh]["primitives"])


def _leaves(file: GlbFile, node: int) -> list[dict[str, Any]]:
    """Return the primitives of a level without those of its trunk, which follow them."""
    return _primitives(file, node)[: _own(file, node).get("first_trunk_primitive")]


def _extras(thing: dict[str, Any]) -> dict[str, Any]:
    extras = thing.get("extras", {})
    found = extras.get("leafcloud", {}) if isinstance(extras, dict) else {}
    return found if isinstance(found, dict) else {}


def _images(file: GlbFile, material: int | None) -> list[int]:
    """Return the images of a material: the compressed one where a texture has both."""
    if material is None:
        return []
    textures = dict.fromkeys(_texture_numbers(file.items("materials")[material]))
    sources = [_source(file.items("textures")[number]) for number in textures]
    return [source for source in sources if source is not None]


def _texture_numbers(value: Any) -> Iterator[int]:
    """Yield the indices of all textures in a material's JSON."""
    for name, inner in value.items() if isinstance(value, dict) else []:
        if name.endswith("Texture") and isinstance(inner, dict) and "index" in inner:
            yield inner["index"]
        yield from _texture_numbers(inner)


def _source(texture: dict[str, Any]) -> int | None:
    for extension in ("KHR_texture_basisu", "EXT_texture_webp"):
        if extension in texture.get("extensions", {}):
            return int(texture["extensions"][extension]["source"])
    return None if "source" not in texture else int(texture["source"])


def _checks(file: GlbFile) -> Iterator[Check]:
    nodes, chains = file.items("nodes"), _chains(file)
    if not chains:
        return
    shown = sum("level" in _extras(nodes[number]) for number in _shown(file))
    yield Check("plain readers show one level of each tree", shown <= len(chains), f"{shown} of {len(chains)} trees")
    for chain in chains:
        name = _name(file, chain[0])
        distances = [_extras(nodes[node])["switch_distance"] for node in chain]
        yield Check(f"{name}: levels take over one after the other", distances == sorted(distances), _listed(distances))
        for node in chain:
            yield from _decoded(_rank_orders, file, node)
        for before, after in itertools.pairwise(chain):
            if "transition_end" in _extras(nodes[before]):
                yield from _decoded(_closure, file, before, after)
            yield from _decoded(_mips, file, after)


def _decoded(check: Callable[..., Iterator[Check]], file: GlbFile, *nodes: int) -> Iterator[Check]:
    """Yield the checks of a file that stores its numbers plainly; none for numbers that have to be decoded."""
    try:
        yield from check(file, *nodes)
    except Unreadable:
        return


def _listed(numbers: list[float]) -> str:
    return ", ".join(f"{number:.4g}" for number in numbers)


def _ranks(file: GlbFile, primitive: dict[str, Any], first: int | None) -> NDArray[Any] | None:
    """Return the rank of each vertex. `first`: the first set of texture coordinates that holds numbers, if any."""
    attributes = primitive["attributes"]
    name = "_LEAF_RANK" if first is None else f"TEXCOORD_{first}"
    return file.values(attributes[name])[:, 0] if name in attributes else None


def _own(file: GlbFile, node: int) -> dict[str, Any]:
    """Return the extras of a node's mesh."""
    mesh = file.items("nodes")[node].get("mesh")
    return {} if mesh is None else _extras(file.items("meshes")[mesh])


def _rank_orders(file: GlbFile, node: int) -> Iterator[Check]:
    """Triangles are in the order of their leaves' ranks, so that the first ones are a pruned mesh.

    Blended triangles are in the order in which they are drawn instead.
    """
    own = _own(file, node)
    for primitive in _leaves(file, node) if "blend_order" not in own and "prefixes" in own else []:
        ranks = _ranks(file, primitive, own.get("first_texcoord"))
        if ranks is not None:
            order = ranks[file.values(primitive["indices"])[::3, 0]] if "indices" in primitive else ranks[::3]
            holds = bool((np.diff(order) >= 0.0).all())
            yield Check(f"{_name(file, node)}: triangles in the order of ranks", holds, f"{len(order):,}")


def _closure(file: GlbFile, before: int, after: int) -> Iterator[Check]:
    """At the end of the morph the leaves that are drawn lie on the planes of the next level, within ε of their places.

    That level lacks billboards that show next to nothing and leaves that the crown hides: a few leaves end on no plane.
    """
    extras = _extras(file.items("nodes")[before])
    keep, first = _kept_share(extras), _own(file, before).get("first_texcoord")
    moves = [_moves(file, each, keep, first) for each in _leaves(file, before)]
    starts, targets = (np.concatenate(each) for each in zip(*moves, strict=True))
    planes = _planes(file, after)
    if not len(targets) or not len(planes):
        return
    step = math.ceil(len(targets) / _MOST_CORNERS)
    starts, targets = starts[::step], targets[::step]
    radius, name = float(extras["radius"]), _name(file, before)
    # Targets keep 1/4096 of their height over the plane, for the order of overlapping leaves.
    ends = _distances(targets, planes) < 1e-3 * radius
    figure = f"{ends.mean():.2%} of the corners within 0.001 R"
    yield Check(f"{name}: leaves end on the next level", bool(ends.mean() >= _LEAST_SHARE), figure)
    most = _extras(file.items("nodes")[after]).get("max_deviation")
    if most is not None and keep == 1.0 and ends.any():
        heights = _heights(starts[ends], targets[ends], planes, 1e-3 * radius) / radius
        within = float((heights <= 1.01 * most + 1e-3).mean())
        figure = f"{within:.2%} of the corners within ε = {most:.3g} R"
        yield Check(f"{name}: leaves move at most by the error bound", within >= _LEAST_SHARE, figure)


def _heights(
    starts: NDArray[np.float64], ends: NDArray[np.float64], planes: NDArray[np.float64], near: float
) -> NDArray[np.float64]:
    """Return the least distance of each start from the planes that its end lies on: those nearer than `near`."""
    parts = max(len(starts) * len(planes) // _MOST_PAIRS, 1)
    found = []
    for start, end in zip(np.array_split(starts, parts), np.array_split(ends, parts), strict=True):
        from_start, from_end = (np.abs(part @ planes[:, :3].T - planes[:, 3]) for part in (start, end))
        found.append(np.where(from_end < near, from_start, np.inf).min(axis=1))
    return np.concatenate(found)


def _mips(file: GlbFile, node: int) -> Iterator[Check]:
    """An atlas page, cut out, keeps its coverage in the first box-filtered mip level. KTX2 has levels of its own."""
    for primitive in _leaves(file, node):
        material = file.items("materials")[primitive["material"]] if "material" in primitive else {}
        reference = material.get("pbrMetallicRoughness", {}).get("baseColorTexture", {})
        source = file.items("textures")[reference["index"]].get("source") if "index" in reference else None
        if material.get("alphaMode") != "MASK" or source is None or "indices" not in primitive:
            continue
        image = file.items("images")[source]
        content = file.view(image["bufferView"]) if "bufferView" in image else b""
        picture = file.picture(source)
        alpha = _alpha(content) if 0 < picture.width * picture.height <= _MOST_TEXELS else None
        corners = file.values(primitive["attributes"][f"TEXCOORD_{reference.get('texCoord', 0)}"])
        if alpha is None or corners.dtype != np.float32 or "KHR_texture_transform" in reference.get("extensions", {}):
            continue
        triangles = corners.astype(np.float64)[file.values(primitive["indices"])[:, 0].reshape(-1, 3)]
        kept = kept_by_mips(alpha, triangles, float(material.get("alphaCutoff", 0.5)), 1)
        if kept is not None:
            holds = all(_KEPT[0] <= share <= _KEPT[1] for share in kept)
            figure = ", ".join(f"{share:.2f}" for share in kept)
            yield Check(f"{_name(file, node)}: the first plain mip level of the PNG keeps the coverage", holds, figure)


def _alpha(content: bytes) -> NDArray[np.float64] | None:
    """Return alpha (h, w) in [0, 1] of an image file; None for an opaque or a broken one, and for other formats."""
    try:
        alpha = decode_image(content)[..., 3]
    except LeafcloudError:
        return None
    return alpha / 255.0 if alpha.min() < 255 else None


def _kept_share(extras: dict[str, Any]) -> float:
    """Return the fraction of the leaves that pruning keeps at the end of a level's morph: λ of the laws."""
    if "prune_start" not in extras:
        return 1.0
    return keep(extras["transition_end"], extras["prune_start"], extras.get("prune_half", 0.5))


def _moves(
    file: GlbFile, primitive: dict[str, Any], keep: float, first: int | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the places of the kept leaves' corners before the morph and at its end.

    Without leaves that shrink to a point: they end on no plane, but are gone.
    """
    starts = file.values(primitive["attributes"]["POSITION"]).astype(np.float64)
    ends = starts.copy()
    for target in primitive.get("targets", []):
        ends += file.values(target["POSITION"])
    ranks = None if keep == 1.0 else _ranks(file, primitive, first)
    kept = np.ones(len(starts), bool) if ranks is None else ranks < keep
    if "indices" in primitive:
        corners = file.values(primitive["indices"])[:, 0].reshape(-1, 3)
        before, after = (_areas(places[corners]) for places in (starts, ends))
        gone = np.zeros(len(starts), bool)
        gone[corners[after < 1e-6 * before]] = True
        kept &= ~gone
    return starts[kept], ends[kept]


def _areas(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return twice the areas of triangles (t, 3, 3)."""
    return np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)


def _planes(file: GlbFile, node: int) -> NDArray[np.float64]:
    """Return the planes (p, 4) of a level's triangles, without repetition: unit normal and distance."""
    rows = []
    for primitive in _leaves(file, node):
        places = file.values(primitive["attributes"]["POSITION"]).astype(np.float64)
        corners = places[file.values(primitive["indices"])[:, 0].reshape(-1, 3)]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        normals = normals[lengths > 0.0] / lengths[lengths > 0.0, None]
        rows.append(np.column_stack([normals, np.einsum("ij,ij->i", normals, corners[lengths > 0.0, 0])]))
    planes = np.concatenate(rows)
    planes *= np.where(planes[:, :1] + 1e-3 * planes[:, 1:2] < 0.0, -1.0, 1.0)
    scale = max(float(np.abs(planes[:, 3]).max()), 1e-30)
    keys = np.round(np.column_stack([planes[:, :3], planes[:, 3:] / scale]), 4)
    return planes[np.unique(keys, axis=0, return_index=True)[1]]


def _distances(points: NDArray[np.float64], planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of each point from its nearest plane."""
    found = [
        np.abs(part @ planes[:, :3].T - planes[:, 3]).min(axis=1)
        for part in np.array_split(points, max(len(points) * len(planes) // _MOST_PAIRS, 1))
    ]
    return np.concatenate(found)


def _engines(file: GlbFile, levels: tuple[LevelRow, ...]) -> Iterator[tuple[str, str]]:
    """Yield each engine that drops a part of the file, with that part."""
    custom = sorted({name for level in levels for name in level.attributes if name.startswith("_")})
    if custom:
        yield "Babylon.js, Godot, Unity, Unreal", f"drop {', '.join(custom)}: bake with --engine for them"
    if any("morph target" in level.attributes for level in levels):
        yield "Unreal", "static meshes drop morph targets"
    if any(picture.kind == "KTX2" for level in levels for picture in level.pictures):
        yield "Bevy", "does not read KHR_texture_basisu; it draws the PNG textures"
        yield "Godot", "draws the KTX2 textures far too dark: bake with --engine godot"
    if {"EXT_meshopt_compression", "KHR_meshopt_compression"} & {*file.document.get("extensionsRequired", [])}:
        yield "Babylon.js, Blender, Godot, Unreal, Bevy", "cannot open compressed meshes"
    if "MSFT_lod" in file.document.get("extensionsUsed", []):
        yield (
            "glTFast, Unreal, Bevy",
            "show level 0 only by themselves: they do not read MSFT_lod; docs/engines.md has scripts and a package",
        )
