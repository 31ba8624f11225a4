"""Hostile .blend files, made by Blender as a module. `make bench-hostile` bakes them."""

from __future__ import annotations

import os
import random
import struct
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import bpy
from hostile_files import NAMES, Case, Write, png, surround, tree

ESCAPE = "open({path!r}, 'w').close()"
"""A line of Python that writes a file into the folder of the input."""


_FILES = ("pipe", "folder", "gone.png", "../outside.dat", "loop", "sparse", "short")


def leaves(name: str = "leaves", material: bpy.types.Material | None = None) -> bpy.types.Object:
    """Add an object of 24 leaf cards to the scene."""
    document, body = tree()
    count = document["accessors"][0]["count"]
    positions = list(struct.iter_unpack("<3f", body[: 12 * count]))
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(positions, [], [tuple(range(first, first + 4)) for first in range(0, count, 4)])
    mesh.uv_layers.new(name="UVMap")
    mesh.materials.append(material or bpy.data.materials.new("leaves"))
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def saved(make: Callable[[Path], object], *, compress: bool = False) -> Write:
    """Return a writer of the scene that `make` builds for a folder."""

    def write(folder: Path) -> Path:
        surround(folder)
        _call("WM_OT_read_factory_settings", use_empty=True)
        after = make(folder)
        _call("WM_OT_save_as_mainfile", filepath=str(folder / "tree.blend"), compress=compress)
        _call("WM_OT_read_factory_settings", use_empty=True)  # Else the next operator evaluates the scene here.
        if callable(after):
            after()
        return folder / "tree.blend"

    return write


def _call(operator: str, **options: object) -> None:
    """Run an operator as `bpy.ops` does, but without evaluating the scene first: a bake is to do that."""
    sys.modules["_bpy"].ops.call(operator, options)


def blend_cases() -> Iterator[Case]:
    yield Case("fine blend", saved(lambda _: leaves()))
    yield Case("fine compressed blend", saved(lambda _: leaves(), compress=True))
    for name, make in (*_SCRIPTS, *_LIBRARIES, *_NODES, *_MASSES):
        yield Case(f"blend {name}", saved(make))
    for path in (
        "//pipe",
        "/dev/zero",
        "//folder",
        "//gone.png",
        "//../outside.dat",
        "//loop",
        "//sparse",
        "//short",
        "x",
    ):
        yield Case(f"blend image {path}", saved(partial(_with_image, _image_at, path)))
    for side in (16_384, 65_536):
        yield Case(f"blend generated image {side}", saved(partial(_with_image, _generated, side)))
        yield Case(f"blend packed image {side}", saved(partial(_with_image, _packed, side)))
    for name in NAMES:
        if "\ud800" not in name and "\0" not in name:
            yield Case(f"blend name {name[:20]!a}", saved(partial(_named, name)))
    for compress in (False, True):
        for share in range(8):
            yield Case(f"blend {'compressed ' * compress}cut at {share}/8", _cut(share, compress))
    for seed in range(24):
        yield Case(f"blend bytes {seed}", _flipped(seed))
    yield Case("blend sparse", _sparse)
    yield Case("blend zstd bomb", _bomb)


def _script(folder: Path) -> None:
    text = bpy.data.texts.new("startup.py")
    text.write(ESCAPE.format(path=str(folder / "escaped")))
    text.use_module = True
    leaves()


def _driver(folder: Path) -> None:
    driver = leaves().driver_add("location", 0).driver
    driver.type = "SCRIPTED"
    driver.expression = f"{ESCAPE.format(path=str(folder / 'escaped'))} or 1"


def _node_driver(folder: Path) -> None:
    material = _material()
    socket = material.node_tree.nodes["Principled BSDF"].inputs["Roughness"]
    driver = socket.driver_add("default_value").driver
    driver.type = "SCRIPTED"
    driver.expression = f"{ESCAPE.format(path=str(folder / 'escaped'))} or 1"
    leaves(material=material)


_SCRIPTS = (("script", _script), ("driver", _driver), ("driver of a node", _node_driver))


def _linked(replace: Callable[[Path], object], *, override: bool = False) -> Callable[[Path], object]:
    """Return a builder of a scene with leaves from a library, which `replace` changes after the scene is saved."""

    def make(folder: Path) -> Callable[[], object]:
        library = folder / "library.blend"
        leaves()
        bpy.ops.wm.save_as_mainfile(filepath=str(library))
        bpy.ops.wm.read_factory_settings(use_empty=True)
        with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
            wanted.objects = ["leaves"]
        obj = wanted.objects[0]
        bpy.context.scene.collection.objects.link(obj.override_create() if override else obj)
        return lambda: replace(library)

    return make


def _replaced(by: Callable[[Path], object]) -> Callable[[Path], object]:
    def replace(library: Path) -> None:
        library.unlink()
        by(library)

    return replace


_LIBRARIES = (
    ("library", _linked(lambda library: None)),
    ("library override", _linked(lambda library: None, override=True)),
    ("library gone", _linked(Path.unlink)),
    ("library is a pipe", _linked(_replaced(os.mkfifo))),
    ("library is a device", _linked(_replaced(lambda library: library.symlink_to("/dev/zero")))),
    ("library is a folder", _linked(_replaced(Path.mkdir))),
    ("library is a text", _linked(lambda library: library.write_text("no library"))),
    ("library is cut", _linked(lambda library: os.truncate(library, 5000))),
)


def _material() -> bpy.types.Material:
    material = bpy.data.materials.new("leaves")
    material.use_nodes = True
    return material


def _with_nodes(build: Callable[[bpy.types.NodeTree, bpy.types.Node], object]) -> Callable[[Path], object]:
    def make(_: Path) -> None:
        material = _material()
        build(material.node_tree, material.node_tree.nodes["Principled BSDF"])
        leaves(material=material)

    return make


def _shared(kind: str, inputs: tuple[int, int], output: int, target: str) -> Callable[[Path], object]:
    """Return a builder of 60 nodes. Each uses the one before twice: 2⁶⁰ paths."""

    def build(nodes: bpy.types.NodeTree, shader: bpy.types.Node) -> None:
        before = nodes.nodes.new(kind)
        for _ in range(60):
            node = nodes.nodes.new(kind)
            for index in inputs:
                nodes.links.new(node.inputs[index], before.outputs[output])
            before = node
        end = nodes.nodes["Material Output"].inputs["Surface"] if target == "Surface" else shader.inputs[target]
        nodes.links.new(end, before.outputs[output])

    return _with_nodes(build)


def _loop(kind: str) -> Callable[[Path], object]:
    def build(nodes: bpy.types.NodeTree, shader: bpy.types.Node) -> None:
        first, second = nodes.nodes.new(kind), nodes.nodes.new(kind)
        nodes.links.new(second.inputs[0], first.outputs[0])
        nodes.links.new(first.inputs[0], second.outputs[0])
        nodes.links.new(shader.inputs["Base Color"], second.outputs[0])

    return _with_nodes(build)


def _nested_groups(nodes: bpy.types.NodeTree, shader: bpy.types.Node) -> None:
    inner = None
    for depth in range(14):
        group = bpy.data.node_groups.new(f"group {depth}", "ShaderNodeTree")
        group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
        for _ in range(2 if inner else 0):
            group.nodes.new("ShaderNodeGroup").node_tree = inner
        end = group.nodes.new("NodeGroupOutput")
        if inner:
            group.links.new(end.inputs[0], group.nodes[0].outputs[0])
        inner = group
    user = nodes.nodes.new("ShaderNodeGroup")
    user.node_tree = inner
    nodes.links.new(shader.inputs["Base Color"], user.outputs[0])


def _chain(nodes: bpy.types.NodeTree, shader: bpy.types.Node) -> None:
    before = nodes.nodes.new("ShaderNodeGamma")
    for _ in range(500):
        node = nodes.nodes.new("ShaderNodeGamma")
        nodes.links.new(node.inputs[0], before.outputs[0])
        before = node
    nodes.links.new(shader.inputs["Base Color"], before.outputs[0])


_NODES = (
    ("shared math nodes", _shared("ShaderNodeMath", (0, 1), 0, "Roughness")),
    ("shared mix nodes", _shared("ShaderNodeMixRGB", (1, 2), 0, "Base Color")),
    ("shared mix shaders", _shared("ShaderNodeMixShader", (1, 2), 0, "Surface")),
    ("loop of reroutes", _loop("NodeReroute")),
    ("loop of nodes", _loop("ShaderNodeGamma")),
    ("nested groups", _with_nodes(_nested_groups)),
    ("chain of 500 nodes", _with_nodes(_chain)),
)


def _instances(side: int) -> Callable[[Path], object]:
    def make(_: Path) -> None:
        child = leaves()
        mesh = bpy.data.meshes.new("ground")
        mesh.from_pydata([(x, y, 0.0) for x in range(side) for y in range(side)], [], [])
        ground = bpy.data.objects.new("ground", mesh)
        bpy.context.scene.collection.objects.link(ground)
        ground.instance_type = "VERTS"
        child.parent = ground

    return make


def _broken_indices(_: Path) -> None:
    mesh = leaves().data
    mesh.attributes[".corner_vert"].data.foreach_set("value", [10**9] * len(mesh.loops))


def _deep_parents(_: Path) -> None:
    parent = None
    for number in range(2000):
        obj = bpy.data.objects.new(f"parent {number}", None)
        bpy.context.scene.collection.objects.link(obj)
        obj.parent = parent
        parent = obj
    leaves().parent = parent


def _properties(value: object) -> Callable[[Path], object]:
    def make(_: Path) -> None:
        leaves()["leafcloud"] = value

    return make


_MASSES = (
    ("1000000 instances", _instances(1000)),
    ("25000000 instances", _instances(5000)),
    ("indices out of range", _broken_indices),
    ("2000 parents", _deep_parents),
    ("property text", _properties("x")),
    ("property of texts", _properties({"level": "x", "sources": 5})),
    ("property of lists", _properties({"level": [1, 2]})),
    ("nothing", lambda _: None),
)


def _named(name: str, _: Path) -> None:
    leaves(name)


def _with_image(make: Callable[[Any], bpy.types.Image], value: Any, _: Path) -> None:
    material = _material()
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = make(value)
    shader = material.node_tree.nodes["Principled BSDF"]
    material.node_tree.links.new(shader.inputs["Base Color"], node.outputs["Color"])
    leaves(material=material)


def _image_at(path: str) -> bpy.types.Image:
    image = bpy.data.images.new("leaf", 4, 4)
    image.source = "FILE"
    image.filepath = path
    return image


def _generated(side: int) -> bpy.types.Image:
    image = bpy.data.images.new("leaf", 4, 4)
    image.generated_width = image.generated_height = side
    return image


def _packed(side: int) -> bpy.types.Image:
    content = png(16_384, 1)
    content = content[:16] + struct.pack(">II", side, side) + content[24:]
    image = bpy.data.images.new("leaf", 4, 4)
    image.pack(data=content, data_len=len(content))
    image.source = "FILE"
    return image


def _cut(share: int, compress: bool) -> Write:
    def write(folder: Path) -> Path:
        path = saved(lambda _: leaves(), compress=compress)(folder)
        os.truncate(path, path.stat().st_size * share // 8)
        return path

    return write


def _flipped(seed: int) -> Write:
    """Return a writer of a .blend file with eight random bytes."""

    def write(folder: Path) -> Path:
        path = saved(lambda _: leaves())(folder)
        content = bytearray(path.read_bytes())
        numbers = random.Random(seed)
        for _ in range(8):
            content[numbers.randrange(len(content))] = numbers.randrange(256)
        path.write_bytes(content)
        return path

    return write


def _sparse(folder: Path) -> Path:
    path = saved(lambda _: leaves())(folder)
    os.truncate(path, 10**11)
    return path


def _bomb(folder: Path) -> Path:
    import zstandard

    surround(folder)
    path = folder / "tree.blend"
    with open(path, "wb") as file, zstandard.ZstdCompressor().stream_writer(file) as packed:
        packed.write(b"BLENDER-v405" + struct.pack("<4siQii", b"DATA", 2**31 - 8, 1, 0, 1))
        for _ in range(2**11):
            packed.write(bytes(1 << 20))
    return path
