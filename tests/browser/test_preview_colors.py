"""The colors of the preview, compared with Cycles' pictures of the same levels from the same camera."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector
from night import rest_at_night
from node_trees import math_node, new_image, new_material, texture_node
from numpy.typing import NDArray
from preview_pictures import preview_pictures
from renders import render_from
from scenes import add_mesh, bake, read

from addon.bake.values import Baked
from addon.levels.fading import fading_copy
from addon.levels.material import hide_back_in_cycles
from addon.levels.sunlight import SHADE_NODE
from addon.nodes.laws import NEVER
from addon.nodes.lod import LodSettings, add_lod_modifier, set_manual
from addon.settings.bake import BakeSettings
from addon.viewport.draw import inputs_of

SIDE = 64
"""Width and height of the compared pictures, in pixels."""
FINER = 6
"""Preview pixels along each side of a compared pixel. The preview itself has no antialiasing."""
SAMPLES = 32

Picture = NDArray[np.float32]


def baked_shrub(shrub: Path, **settings: object) -> Baked:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    baked = bake(read(), BakeSettings(texture_size=512, last="cross", **settings))
    for obj in baked.prepared.tree.sources:
        obj.hide_render = True
    for material in bpy.data.materials:  # The preview has no shadows, so the cross impostor needs no shade there.
        if material.node_tree is not None and SHADE_NODE in material.node_tree.nodes:
            material.node_tree.nodes[SHADE_NODE].inputs[1].default_value = 0.0
    return baked


def reopened(folder: Path) -> None:
    """Save the scene in this folder and open the file."""
    file = str(folder / "tree.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    bpy.ops.wm.open_mainfile(filepath=file)


def sphere_of(baked: Baked) -> tuple[list[float], float]:
    """Return the center and the radius of the leaves."""
    return baked.prepared.foliage.world_centre.tolist(), baked.prepared.foliage.radius


def camera_at(distance: float, centre: Sequence[float], radius: float, azimuth: float = -0.9) -> bpy.types.Object:
    """Return a camera that looks slightly down at a sphere and shows all of it."""
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    direction = Vector((math.cos(azimuth), math.sin(azimuth), 0.3)).normalized()
    camera.location = Vector(centre) + distance * direction
    camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
    camera.data.angle = 2.0 * math.asin(radius / distance)
    camera.data.clip_start, camera.data.clip_end = 0.2 * distance, 3.0 * distance
    bpy.context.scene.collection.objects.link(camera)
    return camera


def mixers_of(shader: bpy.types.Node) -> set[str]:
    """Return the names of the nodes that mix a shader with others, except with the transparency of cutouts."""
    ahead = [link.to_node for link in shader.outputs[0].links]
    return {
        name
        for node in ahead
        for name in (mixers_of(node) if node.inputs[1].links[0].from_node.type == "BSDF_TRANSPARENT" else {node.name})
    }


def shine(material: bpy.types.Material) -> None:
    """Make each Principled BSDF emit its color in the preview's light: half from the eye, half from all around.

    Translucency is muted, as in the preview.
    """
    tree = material.node_tree
    for through in [node for node in tree.nodes if node.type == "BSDF_TRANSLUCENT"]:
        for mix in [node for node in tree.nodes if node.name in mixers_of(through)]:
            mix.mute = True  # A muted node passes its first shader on.
    for surface in [node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"]:
        base, emitted = surface.inputs["Base Color"], surface.inputs["Emission Color"]
        emitted.default_value = base.default_value
        for link in list(base.links):
            tree.links.new(link.from_socket, emitted)
            tree.links.remove(link)
        base.default_value = (0.0, 0.0, 0.0, 1.0)
        surface.inputs["Specular IOR Level"].default_value = 0.0
        geometry, cosine = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeVectorMath")
        cosine.operation = "DOT_PRODUCT"
        tree.links.new(geometry.outputs["Normal"], cosine.inputs[0])
        tree.links.new(geometry.outputs["Incoming"], cosine.inputs[1])
        size, light = tree.nodes.new("ShaderNodeMath"), tree.nodes.new("ShaderNodeMath")
        size.operation, light.operation = "ABSOLUTE", "MULTIPLY_ADD"
        tree.links.new(cosine.outputs["Value"], size.inputs[0])
        tree.links.new(size.outputs[0], light.inputs[0])
        light.inputs[1].default_value = light.inputs[2].default_value = 0.5
        tree.links.new(light.outputs[0], surface.inputs["Emission Strength"])


def cycles_pictures(folder: Path, cameras: Sequence[bpy.types.Object]) -> list[Picture]:
    """Return pictures (SIDE, SIDE, 4) of the scene in the preview's light, one for each camera."""
    # Modifiers set materials, too.
    for material in bpy.data.materials:
        if material.users and material.node_tree is not None and "Shining" not in material:
            shine(material)
            material["Shining"] = True
    view = {"size": (SIDE, SIDE), "samples": SAMPLES, "pixel_filter": "BOX"}
    return [render_from(folder, camera, **view) for camera in cameras]


def coarse(picture: Picture) -> Picture:
    """Return the means of blocks of FINER × FINER pixels."""
    return picture.reshape(SIDE, FINER, SIDE, FINER, 4).mean((1, 3))


def assert_alike(drawn: Picture, rendered: Picture, *, within: float) -> None:
    """Compare coverage and mean color, of the picture and of 8 × 8 blocks, within a fraction of the coverage."""
    covered = rendered[..., 3].mean()
    assert covered > 0.05, "the camera does not see the tree"
    blocks = (drawn - rendered).reshape(8, SIDE // 8, 8, SIDE // 8, 4).mean((1, 3))
    np.testing.assert_allclose(drawn.mean((0, 1)), rendered.mean((0, 1)), atol=within * covered)
    assert np.abs(blocks).mean() < within * covered
    brightness = drawn[..., :3].sum() / rendered[..., :3].sum()
    assert brightness == pytest.approx(1.0, abs=0.08)


def compare(folder: Path, cameras: Sequence[bpy.types.Object], *, within: float = 0.03) -> None:
    drawn = preview_pictures(folder, cameras, SIDE * FINER)
    for mine, theirs in zip(drawn, cycles_pictures(folder, cameras), strict=True):
        assert_alike(coarse(mine), theirs, within=within)


def test_the_preview_shows_every_level_like_cycles(shrub: Path, tmp_path: Path) -> None:
    """Leaves at rest and in transition, both clouds and the cross impostor, with materials from a saved file."""
    baked = baked_shrub(shrub)
    sphere = sphere_of(baked)
    first, second, *_, cross = baked.switch_distances[1:]
    reopened(tmp_path)
    distances = (0.4 * first, 0.75 * first, 1.12 * first, 1.12 * second, 1.5 * cross)
    compare(tmp_path, [camera_at(distance, *sphere) for distance in distances])


def test_levels_that_cross_fade_share_the_pixels(shrub: Path, tmp_path: Path) -> None:
    """In the preview each has half the pixels. Cycles shows the last cloud alone, and the cross impostor alone."""
    baked = baked_shrub(shrub)
    last, cross = baked.levels[-2], baked.levels[-1]
    fades = inputs_of(cross.object)
    camera = camera_at((fades.appear + fades.fade_in_end) / 2.0, *sphere_of(baked))
    [drawn] = preview_pictures(tmp_path, [camera], SIDE * FINER)
    alone = []
    own = [last.object] if last.trunk is None else [last.object, last.trunk]
    for obj in (cross.object, *own):
        set_manual(obj.modifiers[0], transition=0.0, keep=1.0)
    for hidden in ([cross.object], own):
        for obj in hidden:
            obj.hide_render = True
        alone += cycles_pictures(tmp_path, [camera])
        for obj in hidden:
            obj.hide_render = False
    assert_alike(coarse(drawn), np.mean(alone, axis=0), within=0.03)


EFFECTS = {
    "back sides": "auto,+back_sides",
    "translucency and leaf map": "auto,+translucency,+leaf_map",
}


@pytest.mark.parametrize("effects", rest_at_night(EFFECTS.values()), ids=EFFECTS)
def test_effects_that_change_materials_are_previewed(effects: str, shrub: Path, tmp_path: Path) -> None:
    """Cameras look from in front and from behind."""
    baked = baked_shrub(shrub, effects=effects, levels=1, form="billboards")
    first, cross = baked.switch_distances[1:]
    cameras = [
        camera_at(distance, *sphere_of(baked), azimuth=azimuth)
        for distance in (0.5 * first, 1.12 * first, 1.5 * cross)
        for azimuth in (0.7, 3.8)
    ]
    compare(tmp_path, cameras, within=0.04)


@pytest.mark.night
def test_baked_light_is_previewed(shrub: Path, tmp_path: Path) -> None:
    """Levels emit their baked light, the leaves a color for each side. The trunk has the light of the view."""
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 4.0, (0.5, 0.4, 0.0)
    bpy.context.scene.collection.objects.link(sun)
    baked = baked_shrub(shrub, effects="auto,+baked_light", levels=1, form="billboards")
    bpy.data.objects.remove(sun)
    first, cross = baked.switch_distances[1:]
    cameras = [camera_at(distance, *sphere_of(baked)) for distance in (0.5 * first, 1.12 * first, 1.5 * cross)]
    compare(tmp_path, cameras, within=0.04)


@pytest.mark.night
def test_pruned_leaves_are_previewed_with_their_contrast(shrub: Path, tmp_path: Path) -> None:
    baked = baked_shrub(shrub, chain="pruning", levels=1)
    leaves = baked.levels[0].object
    start, vanish = inputs_of(leaves).prune_start, inputs_of(leaves).vanish
    assert inputs_of(leaves).contrast != (0.0, 0.0)
    cameras = [camera_at(distance, *sphere_of(baked)) for distance in (0.9 * start, 0.5 * (start + vanish))]
    compare(tmp_path, cameras, within=0.05)


def card(name: str, material: bpy.types.Material, matrix: Matrix) -> bpy.types.Object:
    """Return a square with the modifier of a level. The square is visible at all distances."""
    corners = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
    obj = add_mesh(name, corners, [(0, 1, 2, 3)], materials=[material], matrix=matrix)
    obj.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.float32([0, 0, 1, 0, 1, 1, 0, 1]))
    colors = obj.data.color_attributes.new("Painted", "FLOAT_COLOR", "CORNER")
    colors.data.foreach_set(
        "color", np.float32([[1, 0.2, 0.2, 1], [0.2, 1, 0.2, 1], [1, 1, 1, 1], [0.4, 0.4, 1, 1]]).ravel()
    )
    add_lod_modifier(obj, LodSettings(NEVER, NEVER))
    return obj


def patches(colors: NDArray[np.float64]) -> list[list[tuple[float, ...]]]:
    """Return an opaque image of uniform patches, because some renderers filter before decoding, others after."""
    even = colors.repeat(64, 0).repeat(64, 1)
    return np.dstack([even, np.ones(even.shape[:2])]).tolist()


@pytest.mark.parametrize("mirrored", rest_at_night([False, True]))
@pytest.mark.parametrize("double_sided", rest_at_night([False, True]))
def test_own_materials_of_leaves_are_previewed(mirrored: bool, double_sided: bool, tmp_path: Path) -> None:
    """The camera sees the front of one card and the back of the other.

    Their material has a color image with a Mapping node, painted colors, alpha from another image, and a fade. A
    single-sided material hides the back.
    """
    material, principled, tree = new_material()
    rng = np.random.default_rng(5)
    color, mask = (new_image(name, patches(rng.random((3, 3, 3)))) for name in ("color", "mask"))
    colored, masked, mapping, place, product, painted = (
        *(texture_node(tree, image) for image in (color, mask)),
        *(tree.nodes.new(f"ShaderNode{kind}") for kind in ("Mapping", "UVMap", "Mix", "VertexColor")),
    )
    painted.layer_name, place.uv_map = "Painted", "UVMap"
    mapping.inputs["Scale"].default_value, mapping.inputs["Location"].default_value = (2.0, 1.5, 1.0), (0.3, 0.1, 0.0)
    tree.links.new(place.outputs[0], mapping.inputs["Vector"])
    for node in (colored, masked):
        tree.links.new(mapping.outputs[0], node.inputs["Vector"])
    product.data_type, product.blend_type = "RGBA", "MULTIPLY"
    sockets = {socket.identifier: socket for socket in product.inputs}
    sockets["Factor_Float"].default_value = 1.0
    tree.links.new(colored.outputs["Color"], sockets["A_Color"])
    tree.links.new(painted.outputs["Color"], sockets["B_Color"])
    tree.links.new(next(out for out in product.outputs if out.enabled), principled.inputs["Base Color"])
    tree.links.new(math_node(tree, "GREATER_THAN", masked.outputs["Color"], 0.15), principled.inputs["Alpha"])
    material.use_backface_culling = not double_sided
    if not double_sided:
        hide_back_in_cycles(tree)
    mirror = Matrix.Diagonal((-1.0 if mirrored else 1.0, 1.0, 1.0, 1.0))
    card("front", fading_copy(material), Matrix.Translation((-1.1, 0.0, 0.0)) @ mirror)
    card("back", fading_copy(material), Matrix.Translation((1.1, 0.0, 0.0)) @ Matrix.Rotation(math.pi, 4, "Y") @ mirror)
    camera = camera_at(8.0, (0.0, 0.0, 0.0), 2.2)
    camera.location, camera.rotation_euler = (0.0, 0.0, 8.0), (0.0, 0.0, 0.0)
    compare(tmp_path, [camera], within=0.03)
