"""The billboard clouds and the cross impostor: one mesh, one atlas page and one material each."""

from __future__ import annotations

from contextlib import nullcontext

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..nodes.laws import OWN_BILLBOARD
from .baked_light import shine, unlit_material
from .building import Build, own_bytes
from .filtering import show_shares
from .material import Page, atlas_material
from .mesh import PolygonFaces, create_mesh, polygon_faces, polygon_surface
from .morphs import add_point_attribute
from .shape import Shape, object_of, pruning_of, transition_of
from .sides import add_sides
from .wind import cloud_wind_attributes


def cloud_object(
    level: leafcloud.Level, following: leafcloud.Level | None, number: int, build: Build
) -> bpy.types.Object:
    """Create the object of the level `number`. `following`: the next level, None after the last."""
    name, schedule = f"{build.name}_LOD{number}", build.schedule
    material = _material(name, level, number, build)
    shape, faces = _shape(level, _cloud_or_none(following), build)
    mesh = create_mesh(name, shape.surface, [material])
    if level.two_sided:
        add_sides(mesh, level, faces)
    if level.cloud is not None and build.has("transitions"):
        own = level.plane_ids[level.polygon_billboards][faces.vertex_polygons].astype(np.int32)
        with build.costs.spent_on("transitions", own.nbytes):
            add_point_attribute(mesh, OWN_BILLBOARD, "INT", own)
    extras = {
        "level": number,
        "switch_distance": schedule.switch_distances[number],
        "max_deviation": level.max_deviation_leaves,
    }
    return object_of(mesh, shape, extras, schedule.lod_ranges[number], build)


def _cloud_or_none(level: leafcloud.Level | None) -> leafcloud.Level | None:
    """Return the level if it is a cloud, else None. The cross impostor has no parents, so nothing morphs to it."""
    return level if level is not None and level.cloud is not None else None


def _material(name: str, level: leafcloud.Level, number: int, build: Build) -> bpy.types.Material:
    cutoff, double = level.alpha_cutoff, not level.two_sided
    page = _page(name, level, number, build)
    if not build.emits:
        material = atlas_material(name, page, alpha_cutoff=cutoff, double_sided=double)
        if build.has("filtering"):
            show_shares(material)
        return material
    material = unlit_material(name, page.base_color, cutoff, double_sided=double)
    if build.light is not None:
        shine(material, build.light_strength)
    return material


def _page(name: str, level: leafcloud.Level, number: int, build: Build) -> Page:
    """Create the images of the level with this number."""
    nbytes, shading = own_bytes(level, level.base_color), build.shading
    # Level 1 belongs to every bake, so its base color is charged to no effect.
    with build.costs.spent_on("far_levels", nbytes) if number > 1 else nullcontext():
        image = build.images.add(name, level.base_color)
    page = Page(image, roughness=shading.roughness, metallic=shading.metallic, specular=shading.specular, name=name)
    for effect in build.charged():
        page = effect.add_to_page(page, level, build)
    return page


def _shape(level: leafcloud.Level, following: leafcloud.Level | None, build: Build) -> tuple[Shape, PolygonFaces]:
    """Return the polygons sorted by the ranks of their billboards. `following`: the cloud that they morph to."""
    morphs = following is not None and build.has("transitions")
    ranks = level.ranks[level.polygon_billboards]
    keys = np.zeros(level.triangles, np.int32)
    if following is not None and morphs:
        keys = _parents(following)
    order = np.argsort(ranks, kind="stable")
    faces = polygon_faces(level.polygon_sizes, keys, order, mirrored=build.foliage.mirrored)
    surface = polygon_surface(level.corners, level.uvs, faces)
    parents = keys[faces.triangles]
    wind = cloud_wind_attributes(level, following, level.polygon_billboards[faces.vertex_polygons], parents, build)
    if following is None:
        return Shape(surface, ranks[faces.polygons], wind=wind), faces
    transition = None
    if morphs:
        targets = following.targets[faces.triangles, faces.places]
        transition = transition_of(parents, targets, following.pivot_targets[faces.triangles])
    shape = Shape(
        surface=surface,
        ranks=ranks[faces.polygons],
        pruning=pruning_of(ranks[faces.vertex_polygons], following.pivots[faces.triangles], build),
        transition=transition,
        wind=wind,
    )
    return shape, faces


def _parents(level: leafcloud.Level) -> NDArray[np.int32]:
    """Return (t,) the plane of the cloud `level` for each triangle of the level before."""
    assert level.cloud is not None
    return level.cloud.parents.astype(np.int32)
