"""Draws the pictures of docs/guide.md by the guide's own steps: a film in Cycles, a game in Godot. `make docs`.

usage: python tools/landscape.py film OUT.png
       python tools/landscape.py game FOLDER    (a Godot project; GODOT draws it)
"""

from __future__ import annotations

import math
import shutil
import sys
import tempfile
from pathlib import Path

import bpy
from mathutils import Vector

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT)]
from unseen_trees import write  # noqa: E402

import addon  # noqa: E402

KINDS, TREES, SIDE = ("birch", "walnut"), 500, 150.0
HEIGHTS = {"birch": 9.0, "walnut": 11.0}
"""Heights of the trees in meters."""


def height(x: float, y: float) -> float:
    return 3.5 * math.sin(x / 22.0 + 0.6) * math.cos(y / 27.0) + 1.5 * math.sin((x + y) / 13.0)


def main() -> None:
    purpose, out = sys.argv[1], Path(sys.argv[2]).absolute()
    with tempfile.TemporaryDirectory() as folder:
        files = {kind: write(kind, Path(folder)) for kind in KINDS}  # Each one empties the scene.
        bpy.ops.wm.read_factory_settings(use_empty=True)
        addon.register()
        settings = bpy.context.scene.leafcloud
        if purpose == "game":
            (out / "trees").mkdir(parents=True, exist_ok=True)
            settings.engine, settings.directory = "godot", str(out / "trees")
        for kind, file in files.items():
            bake(kind, file)
    ground = plant()
    if purpose == "film":
        film(out)
    else:
        game(out, ground)


def bake(kind: str, file: Path) -> None:
    """Import a plant at the origin, as high as the table says, and bake it."""
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=str(file))
    parts = [obj for obj in bpy.data.objects if obj not in before and obj.type == "MESH"]
    scale = HEIGHTS[kind] / max((obj.matrix_world @ Vector(corner)).z for obj in parts for corner in obj.bound_box)
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in parts)
    bpy.context.view_layer.objects.active = next(obj for obj in parts if "lea" in obj.name)
    bpy.context.object.name = kind
    for obj in parts:
        obj.scale = [scale] * 3
    bpy.ops.object.transform_apply(location=False)
    bpy.ops.leafcloud.bake()


def plant() -> bpy.types.Object:
    """Plant the trees on hills, and hide the baked ones."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=120, y_subdivisions=120, size=SIDE)
    ground = bpy.context.object
    ground.name = "ground"
    for vertex in ground.data.vertices:
        vertex.co.z = height(vertex.co.x, vertex.co.y)
    ground.data.shade_smooth()
    bpy.context.scene.leafcloud_forest.density = TREES / SIDE**2
    bpy.ops.leafcloud.forest()
    for kind in KINDS:
        bpy.context.view_layer.layer_collection.children[kind].exclude = True
    return ground


def film(out: Path) -> None:
    """Render a frame of a flight: Cycles, sun and sky, motion blur."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    grass(bpy.data.objects["ground"])
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.data.angle, sun.rotation_euler = 4.0, 0.02, (math.radians(50.0), 0.0, math.radians(-40.0))
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    for obj in (sun, camera):
        scene.collection.objects.link(obj)
    scene.world = scene.world or bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.3, 0.5, 0.9, 1.0)
    scene.camera, camera.data.lens = camera, 28.0
    for frame, place in ((1, (-40.0, -70.0, 16.0)), (24, (-38.0, -66.0, 15.0))):
        camera.location = place
        camera.rotation_euler = (Vector((10.0, 10.0, 0.0)) - camera.location).to_track_quat("-Z", "Y").to_euler()
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_euler", frame=frame)
    bpy.ops.leafcloud.mend_rendering()
    scene.frame_set(12)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.5
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 960, 540, 100
    scene.cycles.samples, scene.cycles.use_denoising = 64, True
    scene.view_settings.exposure = 0.6
    scene.render.filepath = str(out)
    bpy.ops.render.render(write_still=True)


def grass(ground: bpy.types.Object) -> None:
    material = bpy.data.materials.new("grass")
    if material.node_tree is None:  # From Blender 5.0 on every material has nodes.
        material.use_nodes = True
    ground.data.materials.append(material)
    surface = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    noise, ramp = (material.node_tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexNoise", "ValToRGB"))
    noise.inputs["Scale"].default_value, surface.inputs["Roughness"].default_value = 40.0, 1.0
    colors = (0.04, 0.07, 0.015, 1.0), (0.12, 0.13, 0.04, 1.0)
    for element, color in zip(ramp.color_ramp.elements, colors, strict=True):
        element.color = color
    material.node_tree.links.new(noise.outputs[0], ramp.inputs[0])
    material.node_tree.links.new(ramp.outputs[0], surface.inputs["Base Color"])


def game(out: Path, ground: bpy.types.Object) -> None:
    """Write a Godot project: trees, their forest, the ground, the add-on, and a scene that draws itself."""
    bpy.ops.leafcloud.export_forest(directory=str(out / "trees"))
    for modifier in list(ground.modifiers):
        ground.modifiers.remove(modifier)
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj == ground)
    bpy.ops.export_scene.gltf(filepath=str(out / "ground.glb"), use_selection=True)
    shutil.copytree(ROOT / "engines" / "godot" / "addons", out / "addons", dirs_exist_ok=True)
    for file in (ROOT / "tools" / "landscape").iterdir():
        shutil.copy(file, out)


if __name__ == "__main__":
    main()
