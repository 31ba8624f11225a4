"""Renders models from several views, flat-lit, with Cycles, for `measure.py`, `fidelity.py` and others.

usage: python flat_views.py OUT.npz SIZE VIEWS GRID MODEL …

A MODEL is FILE.glb, or FILE.glb:NODE for one of its levels without the trunk. Behind either, @1 sets the morph target,
@sway moves the leaves as a breeze does (`sway.py`; @sway0.05 by 0.05 R), and @half moves the samples by half their
distance, to measure the sampling error. The bounding sphere of the first model frames all pictures, or that of the
model with @frame, which is not drawn. Writes one array (views, SIZE, SIZE, 4) per model: linear light, premultiplied,
the mean of GRID × GRID samples on a regular grid in each pixel. That converges faster than random samples under a wide
filter. Independent of the project's own renderer: Blender imports, Cycles renders.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from clear_cells import leave_out_clear
from mathutils import Vector
from numpy.typing import NDArray
from sway import MOVE, first_of_trunk, places_of, sphere_around, sway

MARGIN = 1.0 / 128.0
"""Margin around the rendered region, as a fraction of the picture's side."""


def directions(count: int) -> Iterator[Vector]:
    """Yield directions on a spiral over the upper three quarters of the sphere: trees are rarely seen from below."""
    for i in range(count):
        z = 1.0 - 1.5 * (i + 0.5) / count
        radius, angle = math.sqrt(1.0 - z * z), i * math.pi * (3.0 - math.sqrt(5.0))
        yield Vector((radius * math.cos(angle), radius * math.sin(angle), z))


def make_flat(material: bpy.types.Material) -> None:
    """Make the material emit its base color, with its alpha and without lighting."""
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


def visible_meshes(model: str) -> list[bpy.types.Object]:
    """Open a model's file and hide all its other meshes; return the visible ones."""
    file, _, rest = model.partition(".glb")
    name, _, state = rest.lstrip(":").partition("@")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=f"{file}.glb")
    for material in bpy.data.materials:
        if material.use_nodes and any(node.type == "BSDF_PRINCIPLED" for node in material.node_tree.nodes):
            make_flat(material)
    meshes = [obj for obj in bpy.data.objects if obj.type == "MESH"]
    for obj in meshes:
        obj.hide_render = name not in ("", obj.name)
        if obj.name == name:
            remove_trunk(obj.data)
        if obj.data.shape_keys:
            set_morph(obj, int(state == "1"))
    visible = [obj for obj in meshes if not obj.hide_render]
    if state.startswith("sway"):
        sway(visible, float(state[4:] or MOVE))
    return visible


def set_morph(obj: bpy.types.Object, number: int) -> None:
    """Give the mesh the corners of one of its shape keys, and remove these: they keep transparent parts in the mesh."""
    places = np.empty(3 * len(obj.data.vertices), np.float32)
    obj.data.shape_keys.key_blocks[number].data.foreach_get("co", places)
    obj.shape_key_clear()
    obj.data.vertices.foreach_set("co", places)


def remove_trunk(mesh: bpy.types.Mesh) -> None:
    import bmesh  # It is there only after bpy.

    trunk = bmesh.new()
    trunk.from_mesh(mesh)
    faces = [face for face in trunk.faces if face.material_index >= first_of_trunk(mesh)]
    bmesh.ops.delete(trunk, geom=faces, context="FACES")
    trunk.to_mesh(mesh)
    trunk.free()


def bounding_sphere(objects: list[bpy.types.Object]) -> tuple[Vector, float]:
    centre, radius = sphere_around(places_of(objects))
    return Vector(centre), radius


def set_up_camera(side: int, radius: float) -> bpy.types.Object:
    """Add an orthographic camera for a picture of `side`² pixels, with one sample at the center of each."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples = "CPU", 1
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.transparent_max_bounces = 1024
    scene.render.use_persistent_data = True
    scene.cycles.use_auto_tile = False
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = side
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth, image.exr_codec = "OPEN_EXR", "RGBA", "16", "NONE"
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale, camera.data.clip_end = "ORTHO", 2.05 * radius, 20.0 * radius
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def look_from(
    camera: bpy.types.Object, direction: Vector, centre: Vector, radius: float, places: NDArray[np.float64]
) -> None:
    """Rotate the camera to a view from `direction`, and limit the rendered region to the vertices at `places`."""
    turned = direction.to_track_quat("Z", "Y")
    camera.location, camera.rotation_euler = centre + direction * radius * 4.0, turned.to_euler()
    seen = (places - np.array(centre)) @ np.array(turned.to_matrix())[:, :2] / camera.data.ortho_scale
    seen += (0.5 - camera.data.shift_x, 0.5 - camera.data.shift_y)
    render = bpy.context.scene.render
    render.use_border, render.use_crop_to_border = True, False
    render.border_min_x, render.border_min_y = seen.min(0) - MARGIN
    render.border_max_x, render.border_max_y = seen.max(0) + MARGIN


def picture(path: str, size: int, grid: int) -> NDArray[np.float32]:
    bpy.context.scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(path)
    side = size * grid
    light = np.empty(side * side * 4, np.float32)
    image.pixels.foreach_get(light)
    bpy.data.images.remove(image)
    return light.reshape(size, grid, size, grid, 4)[::-1, ::-1].mean((1, 3), dtype=np.float32)


def rendered(
    models: list[str], size: int, views: int, grid: int, *, shrink: bool = True, bounces: int = 1024
) -> dict[str, NDArray[np.float32]]:
    """Return the pictures (views, size, size, 4) of each model that is drawn, with so many transparent bounces.

    shrink: leave out the transparent parts of meshes. That takes seconds a view, so few samples are faster without.
    """
    frame = next((model for model in models if model.endswith("@frame")), models[0])
    centre, radius = bounding_sphere(visible_meshes(frame))
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for model in (model for model in models if not model.endswith("@frame")):
            objects = visible_meshes(model)
            places = places_of(objects)
            for obj in objects if shrink else []:
                leave_out_clear(obj)
            camera = set_up_camera(size * grid, radius)
            bpy.context.scene.cycles.transparent_max_bounces = bounces
            if model.endswith("@half"):
                camera.data.shift_x = camera.data.shift_y = 0.5 / (size * grid)
            pictures = []
            for direction in directions(views):
                look_from(camera, direction, centre, radius, places)
                pictures.append(picture(str(Path(folder) / "view.exr"), size, grid))
            found[model] = np.stack(pictures)
    return found


def main() -> None:
    out, size, views, grid, *models = sys.argv[1:]
    np.savez(out, **rendered(models, int(size), int(views), int(grid)))


if __name__ == "__main__":
    main()
