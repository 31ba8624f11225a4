"""Compares level 1 under several suns with the leaves and their shadows: `make bench-relit`.

usage: make bench-relit ARGS='[TREE.glb …]'      (default: those of ../shared/foliage up to 10 MB)

In Cycles the leaves are white and diffuse, and cast shadows on one another. Level 1 is rendered in four ways: without
shadows by its normals alone, as in an engine; with self-shadowing textures; with shadows that Cycles traces between the
billboards; and with the exact light of the leaves (bench/exact_light.py). 6 suns, 4 views each. The luminance error is
the mean difference over the pixels that either covers, divided by the leaves' mean luminance there: 1 for a black
picture. Prints a table in Markdown. A tree takes some minutes. Its results go into docs/bench/relit.json immediately,
with the measured commit; docs/bench/relit.md shows them.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import bpy
import numpy as np
from commits import measured_commit
from exact_light import ExactLight
from flat_views import bounding_sphere, directions, picture, set_up_camera
from mathutils import Vector
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
FOLIAGE = ROOT.parent / "shared" / "foliage"
LARGEST_FILE = 10_000_000
SIZE, GRID, VIEWS = 128, 4, 4
SUNS = [
    (math.radians(azimuth), math.radians(height))
    for azimuth, height in zip(range(0, 360, 60), [20, 45, 70] * 2, strict=True)
]
WAYS = ("normals", "self-shadowed", "traced", "exact")
COMPARED = ("self-shadowed", "exact")
"""Ways with a column of their error relative to normals alone."""
MEASURED = ROOT / "docs" / "bench" / "relit.json"

Pictures = NDArray[np.float32]
Errors = dict[str, list[float]]
"""Errors by way: at SIZE, and of the same pictures at a quarter of it."""

INTRODUCTION = """# Relit

Made by `make bench-relit`: level 1 under 6 suns from 4 views each, against the leaves with all their
shadows in Cycles. *Normals*: no shadows, as in an engine without shadow maps. *Self-shadowed*: with the occlusion and
bent-normal occlusion textures. *Traced*: with the billboards' shadows on one another in Cycles. *Exact*: every place
of the billboards has the exact light of its leaf; the remaining error comes from the leaves' positions, which no
texture can correct. The luminance error is the mean difference over the pixels that either covers, divided by the
leaves' mean luminance there: at 128², and of the same pictures at 32². A black picture has 1. Normals alone may have
more, because they light shadowed places. Files larger than 10 MB are left out: they are for speed tests.
"""


def bake(tree: Path, out: Path) -> Path:
    """Bake level 1 of a tree; return the .blend file."""
    effects = "transitions,normals,occlusion,self_shadowing"
    command = [sys.executable, str(ROOT / "bake.py"), "--input", str(tree), "--out", str(out), "--effects", effects]
    # Billboards also where simplified leaves would be cheaper.
    level = ("--levels", "1", "--no-cross", "--form", "billboards", "--every-level")
    subprocess.run([*command, *level], check=True, capture_output=True)
    return out / f"{tree.stem}.blend"


def open_level(blend: Path, level: int) -> bpy.types.Object:
    """Load a level of a baked file into an empty scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    name = f"{blend.stem}_LOD{level}"
    with bpy.data.libraries.load(str(blend)) as (_, wanted):
        wanted.objects = [name]
    [obj] = wanted.objects
    obj.hide_render = False
    obj.modifiers.clear()
    for slot in obj.material_slots:
        slot.link = "DATA"  # The object's own materials fade.
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.update()
    return obj


def open_white_leaves(blend: Path) -> bpy.types.Object:
    leaves = open_level(blend, 0)
    for material in leaves.data.materials:
        make_diffuse(material, shadowed=False)
    return leaves


def make_diffuse(material: bpy.types.Material, *, shadowed: bool) -> None:
    """Make the material white and diffuse, with its alpha and normals. `shadowed` adds self-shadowing."""
    tree = material.node_tree
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    output, *fading = (node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    for other in fading:
        tree.nodes.remove(other)
    paper, clear, mix = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("BsdfDiffuse", "BsdfTransparent", "MixShader")
    )
    paper.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    mix.inputs[0].default_value = surface.inputs["Alpha"].default_value
    for source, target in (
        (surface.inputs["Alpha"], mix.inputs[0]),
        (surface.inputs["Normal"], paper.inputs["Normal"]),
    ):
        if source.is_linked:
            tree.links.new(source.links[0].from_socket, target)
    if shadowed:
        tree.links.new(sun_share(tree), paper.inputs["Color"])
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(paper.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs[0])


def sun_share(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """Add lc_sun_share of shaders/leafcloud.glsl as nodes. The attribute "sun" is in the billboards' axes."""
    opened = next(node for node in tree.nodes if node.type == "SEPARATE_COLOR").outputs["Red"]
    toward, sun = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeAttribute")
    length, dot = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeVectorMath")
    toward.operation, length.operation, dot.operation = "MULTIPLY_ADD", "LENGTH", "DOT_PRODUCT"
    toward.inputs[1].default_value, toward.inputs[2].default_value = (2.0, 2.0, 2.0), (-1.0, -1.0, -1.0)
    sun.attribute_name = "sun"
    tree.links.new(tree.nodes["Bent Normal"].outputs["Color"], toward.inputs[0])
    tree.links.new(toward.outputs[0], length.inputs[0])
    tree.links.new(toward.outputs[0], dot.inputs[0])
    tree.links.new(sun.outputs["Vector"], dot.inputs[1])

    def math_node(operation: str, *values: bpy.types.NodeSocket | float) -> bpy.types.NodeSocket:
        node = tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, value in zip(node.inputs, values, strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node.outputs[0]

    def chosen(
        condition: bpy.types.NodeSocket, yes: bpy.types.NodeSocket, no: bpy.types.NodeSocket
    ) -> bpy.types.NodeSocket:
        return math_node("MULTIPLY_ADD", condition, math_node("SUBTRACT", yes, no), no)

    strength = length.outputs["Value"]
    most = math_node("GREATER_THAN", opened, 0.5)
    gap = math_node("MINIMUM", opened, math_node("SUBTRACT", 1.0, opened))
    along = math_node("MULTIPLY", dot.outputs["Value"], math_node("MULTIPLY_ADD", most, -2.0, 1.0))
    linear = math_node("ADD", gap, along)
    below = math_node("SUBTRACT", math_node("DIVIDE", along, math_node("MAXIMUM", strength, 1e-6)), 1.0)
    reach = math_node("SUBTRACT", 3.0, math_node("DIVIDE", strength, math_node("MAXIMUM", gap, 1e-6)))
    four = math_node("MULTIPLY", gap, 4.0)
    slope = math_node("DIVIDE", four, math_node("MULTIPLY", reach, reach))
    rising = math_node("MULTIPLY", slope, math_node("MAXIMUM", math_node("ADD", below, reach), 0.0))
    cone = math_node("MULTIPLY", math_node("MULTIPLY", gap, 3.0), math_node("SUBTRACT", 1.0, gap))
    left = math_node("SQRT", math_node("MAXIMUM", math_node("SUBTRACT", cone, strength), 0.0))
    edge = math_node("MAXIMUM", math_node("MULTIPLY", left, 2.0), 0.1)
    above = math_node("DIVIDE", math_node("MULTIPLY_ADD", gap, 2.0, below), edge)
    stepped = math_node("MINIMUM", math_node("MAXIMUM", math_node("MULTIPLY_ADD", above, 0.5, 0.5), 0.0), 1.0)
    far = math_node("GREATER_THAN", strength, gap)
    steep = math_node("LESS_THAN", reach, four)
    share = chosen(far, chosen(steep, stepped, rising), linear)
    return chosen(most, math_node("SUBTRACT", 1.0, share), share)


def set_sun_attribute(obj: bpy.types.Object, sun: Vector) -> None:
    """Store each face's direction to the sun in the axes of u, v and normal, as the attribute "sun"."""
    mesh, sun = obj.data, (obj.matrix_world.to_3x3().inverted() @ sun).normalized()
    attribute = mesh.attributes.get("sun") or mesh.attributes.new("sun", "FLOAT_VECTOR", "FACE")
    layout = mesh.uv_layers.active.uv
    for polygon, value in zip(mesh.polygons, attribute.data, strict=True):
        first, second, third = polygon.loop_indices[:3]
        points = [mesh.vertices[mesh.loops[i].vertex_index].co for i in (first, second, third)]
        places = [layout[i].vector for i in (first, second, third)]
        (s1, t1), (s2, t2) = places[1] - places[0], places[2] - places[0]
        e1, e2 = points[1] - points[0], points[2] - points[0]
        turn = math.copysign(1.0, s1 * t2 - s2 * t1)
        along, up = ((e1 * t2 - e2 * t1) * turn).normalized(), ((e2 * s1 - e1 * s2) * turn).normalized()
        value.vector = (along.dot(sun), up.dot(sun), along.cross(up).dot(sun))


def render(frame: tuple[Vector, float], shine: Callable[[Vector], None], *, shadows: bool, folder: str) -> Pictures:
    """Render (suns · views, size, size, 4), linear light, premultiplied. Calls `shine` with each sun's direction."""
    centre, radius = frame
    camera = set_up_camera(SIZE * GRID, radius)
    cycles = bpy.context.scene.cycles
    cycles.max_bounces = cycles.diffuse_bounces = 0
    cycles.transparent_max_bounces = 1024
    light = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    light.data.energy, light.data.angle, light.data.use_shadow = 2.0, 0.0, shadows
    light.data.cycles.cast_shadow = shadows
    bpy.context.scene.collection.objects.link(light)
    pictures = []
    for azimuth, height in SUNS:
        sun = Vector((math.cos(azimuth) * math.cos(height), math.sin(azimuth) * math.cos(height), math.sin(height)))
        light.rotation_euler = sun.to_track_quat("Z", "Y").to_euler()
        shine(sun)
        for direction in directions(VIEWS):
            camera.location = centre + direction * radius * 4.0
            camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
            pictures.append(picture(f"{folder}/view.exr", SIZE, GRID))
    return np.stack(pictures)


def error(base: Pictures, other: Pictures, times: int) -> float:
    """Return the luminance error, see the module's docstring, at SIZE / times."""

    def smaller(pictures: Pictures) -> Pictures:
        size = SIZE // times
        return pictures.reshape(-1, size, times, size, times, 4).mean((2, 4))

    base, other = smaller(base), smaller(other)
    covered = (base[..., 3] > 0.0) | (other[..., 3] > 0.0)
    luminance = [pictures[..., :3] @ np.array([0.2126, 0.7152, 0.0722], np.float32) for pictures in (base, other)]
    return float(np.abs(luminance[0] - luminance[1])[covered].mean() / luminance[0][covered].mean())


def seen(blend: Path, way: str, frame: tuple[Vector, float], folder: str) -> Pictures:
    """Render level 1 in one of WAYS."""
    if way == "exact":
        exact = ExactLight(open_white_leaves(blend))
        return render(frame, lambda sun: exact.receive(), shadows=True, folder=folder)
    level = open_level(blend, 1)
    make_diffuse(level.data.materials[0], shadowed=way == "self-shadowed")
    return render(frame, partial(set_sun_attribute, level), shadows=way == "traced", folder=folder)


def measure(tree: Path) -> Errors:
    with tempfile.TemporaryDirectory() as folder:
        blend = bake(tree, Path(folder) / "out")
        frame = bounding_sphere([open_white_leaves(blend)])
        base = render(frame, lambda sun: None, shadows=True, folder=folder)
        pictures = {way: seen(blend, way, frame, folder) for way in WAYS}
        return {way: [error(base, other, times) for times in (1, 4)] for way, other in pictures.items()}


def table(measured: dict[str, Errors]) -> str:
    """Return the table. Each cell has both sizes, or a dash if it was not measured."""
    head = ["tree", *WAYS, *(f"{way} / normals" for way in COMPARED)]
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]

    def cell(values: Sequence[float], places: int) -> str:
        return ", ".join(f"{value:.{places}f}" for value in values) or "–"

    ratios: dict[str, list[list[float]]] = {way: [] for way in COMPARED}
    for tree, errors in sorted(measured.items()):
        own = {way: [a / b for a, b in zip(errors.get(way, []), errors["normals"], strict=False)] for way in COMPARED}
        for way in COMPARED:
            ratios[way] += [own[way]] if own[way] else []
        cells = [cell(errors.get(way, []), 3) for way in WAYS] + [cell(own[way], 2) for way in COMPARED]
        lines.append(f"| {tree} | {' | '.join(cells)} |")
    means = [f"**{cell(np.mean(ratios[way], axis=0), 2)}**" if ratios[way] else "" for way in COMPARED]
    lines.append(f"| mean | {' | '.join([*[''] * len(WAYS), *means])} |")
    return "\n".join(lines)


def keep(tree: str, errors: Errors) -> None:
    """Add a tree's errors to the files of results."""
    measured = json.loads(MEASURED.read_text()) if MEASURED.is_file() else {}
    measured[tree] = {"commit": measured_commit(), "errors": errors}
    MEASURED.write_text(json.dumps(measured, indent=1, sort_keys=True) + "\n")
    shown = table({name: each["errors"] for name, each in measured.items()})
    MEASURED.with_suffix(".md").write_text(f"{INTRODUCTION}\n{shown}\n")


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare level 1 under several suns with the leaves.")
    parser.add_argument(
        "trees", nargs="*", type=Path, help="GLB files (default: all of ../shared/foliage but the largest)"
    )
    arguments = parser.parse_args()
    trees = arguments.trees or [t for t in sorted(FOLIAGE.glob("*.glb")) if t.stat().st_size < LARGEST_FILE]
    measured = {}
    for tree in trees:
        measured[tree.stem] = measure(tree.resolve())
        keep(tree.stem, measured[tree.stem])
    print(table(measured))


if __name__ == "__main__":
    main()
