"""Renders levels of baked GLB files from a ring of views, flat-lit, with Cycles: what `measure.py` compares.

usage: python flat_views.py OUT.npz SIZE VIEWS SAMPLES BAKED.glb LEVEL[@TRANSITION] …

LEVEL is a node of the file (NAME_LOD0 …), drawn without its wood; @1 sets its morph target. All levels are framed by
the bounding sphere of the first. Writes one array (views, SIZE, SIZE, 4) of straight RGBA per level as asked for.
Independent of the project's own renderer and judge: Blender imports, Cycles renders.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray


def directions(count: int) -> Iterator[Vector]:
    """A spiral over the upper three quarters of the sphere: trees are rarely seen from straight below."""
    for i in range(count):
        z = 1.0 - 1.5 * (i + 0.5) / count
        radius, angle = math.sqrt(1.0 - z * z), i * math.pi * (3.0 - math.sqrt(5.0))
        yield Vector((radius * math.cos(angle), radius * math.sin(angle), z))


def make_flat(material: bpy.types.Material) -> None:
    """Emission of the base colour where alpha lets it: no light, no gloss, no normals."""
    tree = material.node_tree
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    emission, mix = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeMixShader")
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    for source, target in (
        (surface.inputs["Base Color"], emission.inputs[0]),
        (surface.inputs["Alpha"], mix.inputs[0]),
    ):
        if source.is_linked:
            tree.links.new(source.links[0].from_socket, target)
        else:
            target.default_value = source.default_value
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(emission.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs[0])


def bounding_sphere(obj: bpy.types.Object) -> tuple[Vector, float]:
    points = np.empty(3 * len(obj.data.vertices))
    obj.data.vertices.foreach_get("co", points)
    matrix = np.array(obj.matrix_world)
    world = points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    centre = (world.min(0) + world.max(0)) / 2.0
    return Vector(centre), float(np.linalg.norm(world - centre, axis=1).max())


def set_up_camera(size: int, samples: int, radius: float) -> bpy.types.Object:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", samples, 1
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.transparent_max_bounces = 64
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.view_settings.view_transform = "Standard"
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale, camera.data.clip_end = "ORTHO", 2.05 * radius, 20.0 * radius
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def picture(path: str, size: int) -> NDArray[np.float32]:
    bpy.context.scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(path)
    pixels = np.empty(size * size * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(size, size, 4)[::-1]


def main() -> None:
    out, size, views, samples, baked, *levels = sys.argv[1:]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=baked)
    for material in bpy.data.materials:
        make_flat(material)
    objects = {obj.name: obj for obj in bpy.data.objects if obj.type == "MESH"}
    centre, radius = bounding_sphere(objects[levels[0].split("@")[0]])
    camera = set_up_camera(int(size), int(samples), radius)
    rendered = {}
    with tempfile.TemporaryDirectory() as folder:
        for level in levels:
            name, _, transition = level.partition("@")
            for obj in objects.values():
                obj.hide_render = obj.name != name
            keys = objects[name].data.shape_keys
            if keys is not None:
                keys.key_blocks["Billboards"].value = float(transition or 0.0)
            pictures = []
            for direction in directions(int(views)):
                camera.location = centre + direction * radius * 4.0
                camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
                pictures.append(picture(str(Path(folder) / "view.png"), int(size)))
            rendered[level] = np.stack(pictures)
    np.savez(out, **rendered)


main()
