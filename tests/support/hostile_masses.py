"""Hostile .blend files that say much with few bytes: modifiers, instances, geometry nodes, curves, particles, volumes.

Blender fills the memory, computes for ever, or reads and writes files elsewhere while it evaluates them.
`make bench-hostile` bakes them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import bpy
from hostile_blends import leaves, saved
from hostile_files import Case

_MOST = 2**31 - 1

Make = Callable[[Path], object]


def mass_cases() -> Iterator[Case]:
    for name, make in {**_MODIFIERS, **_INSTANCES, **_NODES, **_SHAPES, **_FILES}.items():
        yield Case(f"blend mass {name}", saved(make))


def _modified(kind: str, times: int = 1, **values: Any) -> Make:
    """Return a builder of leaves with modifiers of one kind."""

    def make(_: Path) -> None:
        obj = leaves()
        for _number in range(times):
            _set(obj.modifiers.new("mass", kind), values)

    return make


def _set(owner: Any, values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        setattr(owner, name, value)


_MODIFIERS: dict[str, Make] = {
    "array of 2³¹": _modified("ARRAY", count=_MOST),
    "array of 10⁷": _modified("ARRAY", count=10**7),
    "6 arrays of 100": _modified("ARRAY", 6, count=100),
    "6 merging arrays of 50": _modified("ARRAY", 6, count=50, use_merge_vertices=True),
    "array of a length": _modified("ARRAY", fit_type="FIT_LENGTH", fit_length=1e30),
    "subdivision 11": _modified("SUBSURF", levels=11, render_levels=11),
    "simple subdivision 11": _modified("SUBSURF", levels=11, subdivision_type="SIMPLE"),
    "4 subdivisions 4": _modified("SUBSURF", 4, levels=4),
    "screw": _modified("SCREW", steps=10_000, iterations=10_000, screw_offset=1.0),
    "bevel": _modified("BEVEL", segments=1000, affect="VERTICES", width=0.01),
    "3 bevels": _modified("BEVEL", 3, segments=60, width=0.01),
    "ocean": _modified("OCEAN", viewport_resolution=1024, resolution=1024, repeat_x=1000, repeat_y=1000),
    "displacing ocean": _modified("OCEAN", viewport_resolution=1024, geometry_mode="DISPLACE", use_normals=True),
    "remesh of voxels": _modified("REMESH", mode="VOXEL", voxel_size=1e-5),
    "remesh of octree 24": _modified("REMESH", mode="SMOOTH", octree_depth=24),
    "remesh of blocks 12": _modified("REMESH", mode="BLOCKS", octree_depth=12),
    "solidify and subdivision": lambda _: _solid_skins(leaves()),
    "wireframes": _modified("WIREFRAME", 10, thickness=0.001),
    "unsubdivide": _modified("DECIMATE", 3, decimate_type="UNSUBDIV", iterations=30_000),
    "smooth of 30000": _modified("SMOOTH", iterations=30_000),
    "corrective smooth": _modified("CORRECTIVE_SMOOTH", iterations=30_000),
    "Laplacian smooth": _modified("LAPLACIANSMOOTH", iterations=30_000),
    "build": _modified("BUILD", frame_duration=1.0),
    "array of itself": lambda _: _arrays_in_a_ring(),
}


def _solid_skins(obj: bpy.types.Object) -> None:
    for _ in range(4):
        obj.modifiers.new("skin", "SOLIDIFY").thickness = 0.1
        obj.modifiers.new("edges", "EDGE_SPLIT").split_angle = 0.0
        obj.modifiers.new("finer", "SUBSURF").levels = 3


def _arrays_in_a_ring() -> None:
    """Two objects: each is the end cap of the array of the other."""
    first, second = leaves("leaves a"), leaves("leaves b")
    for obj, cap in ((first, second), (second, first)):
        _set(obj.modifiers.new("mass", "ARRAY"), {"count": 1000, "end_cap": cap, "start_cap": cap})


def _empty(name: str, collection: bpy.types.Collection) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, None)
    collection.objects.link(obj)
    return obj


def _collections(depth: int, width: int) -> Make:
    """Return a builder of collections: each has instances of the one before."""

    def make(_: Path) -> None:
        scene = bpy.context.scene.collection
        inner = bpy.data.collections.new("leaves")
        obj = leaves()
        inner.objects.link(obj)
        scene.objects.unlink(obj)
        for level in range(depth):
            outer = bpy.data.collections.new(f"level {level}") if level < depth - 1 else scene
            for number in range(width):
                _set(_empty(f"{level} {number}", outer), {"instance_type": "COLLECTION", "instance_collection": inner})
            inner = outer

    return make


def _faces(depth: int) -> Make:
    """Return a builder of leaves on the faces of leaves, again and again."""

    def make(_: Path) -> None:
        child = leaves()
        for _number in range(depth):
            ground = leaves("ground")
            _set(ground, {"instance_type": "FACES", "use_instance_faces_scale": True})
            child.parent = ground
            child = ground

    return make


def _particles(**values: Any) -> Make:
    def make(_: Path) -> None:
        obj = leaves()
        system = obj.modifiers.new("mass", "PARTICLE_SYSTEM").particle_system
        _set(system.settings, {"frame_start": 0, "frame_end": 0, "lifetime": 1000, **values})
        if values.get("render_type") == "OBJECT":
            system.settings.instance_object = leaves("leaf")

    return make


_INSTANCES: dict[str, Make] = {
    "collections 2³⁰": _collections(30, 2),
    "collections 10⁷": _collections(7, 10),
    "collections 30⁵": _collections(5, 30),
    "faces 24⁶": _faces(6),
    "faces 24²⁰": _faces(20),
    "10⁷ particles": _particles(count=10**7, render_type="OBJECT"),
    "2³¹ particles": _particles(count=_MOST, render_type="OBJECT"),
    "10⁶ hairs": _particles(count=10**6, type="HAIR", render_type="OBJECT", hair_step=50),
    "10⁹ children": _particles(
        count=10**4, type="HAIR", child_type="SIMPLE", child_percent=10**5, render_type="OBJECT"
    ),
    "interpolated children": _particles(
        count=10**4, type="HAIR", child_type="INTERPOLATED", child_percent=10**5, render_type="OBJECT"
    ),
}


def _nodes(build: Callable[[bpy.types.NodeTree], bpy.types.NodeSocket]) -> Make:
    """Return a builder of leaves with geometry nodes. `build` returns the socket of the result."""

    def make(_: Path) -> None:
        tree = bpy.data.node_groups.new("mass", "GeometryNodeTree")
        tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
        tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        tree.links.new(tree.nodes.new("NodeGroupOutput").inputs[0], build(tree))
        leaves().modifiers.new("mass", "NODES").node_group = tree

    return make


def _add(tree: bpy.types.NodeTree, kind: str, **inputs: Any) -> bpy.types.Node:
    """Add a node. Inputs are values or sockets."""
    node = tree.nodes.new(kind)
    for name, value in inputs.items():
        socket = next(each for each in node.inputs if each.name.replace(" ", "_") == name and each.enabled)
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(socket, value)
        else:
            socket.default_value = value
    return node


def _grid(tree: bpy.types.NodeTree, x: int, y: int) -> bpy.types.NodeSocket:
    return _add(tree, "GeometryNodeMeshGrid", Vertices_X=x, Vertices_Y=y).outputs["Mesh"]


def _subdivided(tree: bpy.types.NodeTree, kind: str, level: int) -> bpy.types.NodeSocket:
    given = tree.nodes.new("NodeGroupInput").outputs[0]
    return _add(tree, kind, Mesh=given, Level=level).outputs["Mesh"]


def _points(tree: bpy.types.NodeTree, count: int, depth: int, *, realize: bool) -> bpy.types.NodeSocket:
    """Put the leaves on points, and the result on points, again and again."""
    geometry = tree.nodes.new("NodeGroupInput").outputs[0]
    for _ in range(depth):
        points = _add(tree, "GeometryNodePoints", Count=count).outputs[0]
        geometry = _add(tree, "GeometryNodeInstanceOnPoints", Points=points, Instance=geometry).outputs[0]
    return _add(tree, "GeometryNodeRealizeInstances", Geometry=geometry).outputs[0] if realize else geometry


def _repeated(tree: bpy.types.NodeTree, iterations: int, *, grow: bool) -> bpy.types.NodeSocket:
    """Repeat nothing, or double the geometry."""
    start, end = tree.nodes.new("GeometryNodeRepeatInput"), tree.nodes.new("GeometryNodeRepeatOutput")
    start.pair_with_output(end)
    start.inputs["Iterations"].default_value = iterations
    tree.links.new(start.inputs["Geometry"], tree.nodes.new("NodeGroupInput").outputs[0])
    inner = start.outputs["Geometry"]
    if grow:
        join = tree.nodes.new("GeometryNodeJoinGeometry")
        for _ in range(2):
            tree.links.new(join.inputs[0], _add(tree, "GeometryNodeSetPosition", Geometry=inner).outputs[0])
        inner = join.outputs[0]
    tree.links.new(end.inputs["Geometry"], inner)
    return end.outputs["Geometry"]


def _nested_groups(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """Eighteen node groups. Each uses the one before twice, one after the other."""
    inner = None
    for depth in range(18):
        group = bpy.data.node_groups.new(f"group {depth}", "GeometryNodeTree")
        group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
        group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        socket = group.nodes.new("NodeGroupInput").outputs[0]
        for _ in range(2):
            node = group.nodes.new("GeometryNodeGroup" if inner else "GeometryNodeSetPosition")
            if inner:
                node.node_tree = inner
            group.links.new(node.inputs[0], socket)
            socket = node.outputs[0]
        group.links.new(group.nodes.new("NodeGroupOutput").inputs[0], socket)
        inner = group
    node = tree.nodes.new("GeometryNodeGroup")
    node.node_tree = inner
    tree.links.new(node.inputs[0], tree.nodes.new("NodeGroupInput").outputs[0])
    return node.outputs[0]


def _cube_of_fog(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    sides = {f"Resolution_{axis}": 4096 for axis in "XYZ"}
    volume = _add(tree, "GeometryNodeVolumeCube", Density=1.0, **sides).outputs[0]
    return _add(tree, "GeometryNodeVolumeToMesh", Volume=volume).outputs[0]


def _strings(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    text = "leaf" * 1000
    for _ in range(12):
        text = _add(tree, "FunctionNodeReplaceString", String=text, Find="leaf", Replace="leafleafleaf").outputs[0]
    curves = _add(tree, "GeometryNodeStringToCurves", String=text).outputs[0]
    return _add(tree, "GeometryNodeFillCurve", Curve=curves).outputs[0]


def _read(tree: bpy.types.NodeTree, kind: str, path: str) -> bpy.types.NodeSocket:
    return _add(tree, kind, Path=path).outputs[0]


_NODES: dict[str, Make] = {
    "grid of 10⁹": _nodes(partial(_grid, x=31_623, y=31_623)),
    "grid of 10⁸": _nodes(partial(_grid, x=10_000, y=10_000)),
    "grid of 10¹⁰": _nodes(partial(_grid, x=100_000, y=100_000)),
    "subdivided mesh": _nodes(partial(_subdivided, kind="GeometryNodeSubdivideMesh", level=11)),
    "subdivision surface": _nodes(partial(_subdivided, kind="GeometryNodeSubdivisionSurface", level=11)),
    "10⁸ points": _nodes(partial(_points, count=10**8, depth=1, realize=False)),
    "2³¹ points": _nodes(partial(_points, count=_MOST, depth=1, realize=False)),
    "1000⁴ instances": _nodes(partial(_points, count=1000, depth=4, realize=False)),
    "1000⁴ real instances": _nodes(partial(_points, count=1000, depth=4, realize=True)),
    "2¹⁰⁰ instances": _nodes(partial(_points, count=2, depth=100, realize=False)),
    "2²⁵ real instances": _nodes(partial(_points, count=2, depth=25, realize=True)),
    "repeat for ever": _nodes(partial(_repeated, iterations=_MOST, grow=False)),
    "repeat and double": _nodes(partial(_repeated, iterations=60, grow=True)),
    "nested node groups": _nodes(_nested_groups),
    "cube of fog": _nodes(_cube_of_fog),
    "long string": _nodes(_strings),
    **{
        f"{kind} from {path}": _nodes(partial(_read, kind=f"GeometryNodeImport{kind}", path=path))
        for kind in ("OBJ", "PLY", "STL", "CSV", "VDB")
        for path in ("//pipe", "/dev/zero")
    },
}


def _curve(points: int, **values: Any) -> Make:
    def make(_: Path) -> None:
        leaves()
        curve = bpy.data.curves.new("mass", "CURVE")
        curve.dimensions = "3D"
        spline = curve.splines.new("NURBS")
        spline.points.add(points - 1)
        spline.points.foreach_set("co", [x for i in range(points) for x in (i * 1e-3, i % 7, i % 5, 1.0)])
        spline.resolution_u = values.get("resolution_u", 12)
        _set(curve, values)
        bpy.context.scene.collection.objects.link(bpy.data.objects.new("mass", curve))

    return make


def _surface(_: Path) -> None:
    leaves()
    surface = bpy.data.curves.new("mass", "SURFACE")
    spline = surface.splines.new("NURBS")
    spline.points.add(63)
    _set(spline, {"resolution_u": 1024, "resolution_v": 1024, "use_cyclic_u": True})
    _set(surface, {"resolution_u": 1024, "resolution_v": 1024})
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("mass", surface))


def _text(letters: int, **values: Any) -> Make:
    def make(_: Path) -> None:
        leaves()
        text = bpy.data.curves.new("mass", "FONT")
        text.body = "leaf " * (letters // 5)
        _set(text, values)
        bpy.context.scene.collection.objects.link(bpy.data.objects.new("mass", text))

    return make


def _balls(count: int, resolution: float, radius: float) -> Make:
    def make(_: Path) -> None:
        leaves()
        balls = bpy.data.metaballs.new("mass")
        _set(balls, {"resolution": resolution, "render_resolution": resolution})
        for number in range(count):
            _set(balls.elements.new(), {"radius": radius, "co": (number * 0.3, number % 7, number % 5)})
        bpy.context.scene.collection.objects.link(bpy.data.objects.new("mass", balls))

    return make


def _fog(**values: Any) -> Make:
    """Return a builder of a volume made from leaves, and of a mesh made from that volume."""

    def make(_: Path) -> None:
        source = leaves()
        volume = bpy.data.objects.new("fog", bpy.data.volumes.new("fog"))
        bpy.context.scene.collection.objects.link(volume)
        _set(volume.modifiers.new("mass", "MESH_TO_VOLUME"), {"object": source, **values})
        mesh = leaves("leaves of fog")
        _set(mesh.modifiers.new("mass", "VOLUME_TO_MESH"), {"object": volume, **values})

    return make


_SHAPES: dict[str, Make] = {
    "curve of fine steps": _curve(20_000, resolution_u=1024),
    "round curve": _curve(100_000, resolution_u=64, bevel_depth=0.1, bevel_resolution=32),
    "surface": _surface,
    "long text": _text(10**6),
    "round text": _text(50_000, extrude=0.1, bevel_depth=0.01, bevel_resolution=32, resolution_u=64),
    "fine metaballs": _balls(1, 0.005, 1000.0),
    "many metaballs": _balls(20_000, 0.02, 2.0),
    "fog of small voxels": _fog(resolution_mode="VOXEL_SIZE", voxel_size=1e-6),
    "fog of many voxels": _fog(resolution_mode="VOXEL_AMOUNT", voxel_amount=10**6),
}


def _fluid(_: Path) -> None:
    modifier = leaves().modifiers.new("mass", "FLUID")
    modifier.fluid_type = "DOMAIN"
    values = {"resolution_max": 10_000, "cache_directory": "//../escaped", "cache_type": "REPLAY"}
    _set(modifier.domain_settings, values)


def _cloth(_: Path) -> None:
    """A cloth with a cache on disk, which Blender writes beside the file."""
    obj = leaves()
    modifier = obj.modifiers.new("mass", "CLOTH")
    _set(modifier.settings, {"quality": 80})
    _set(modifier.point_cache, {"use_disk_cache": True, "frame_start": 1, "frame_end": 1})


def _sequence(path: str) -> Make:
    """Return a function that makes leaves, which read their shape from a file."""

    def make(_: Path) -> None:
        cache = leaves().modifiers.new("mass", "MESH_CACHE")
        _set(cache, {"filepath": path, "cache_format": "PC2"})

    return make


_FILES: dict[str, Make] = {
    "fluid": _fluid,
    "cloth with a cache": _cloth,
    **{f"mesh cache {path}": _sequence(path) for path in ("//pipe", "/dev/zero", "//sparse", "//../outside.dat")},
}
