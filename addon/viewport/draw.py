"""Drawing of a scene's baked levels in all 3D views, with each view's own camera."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import bpy
import gpu
import numpy as np
from mathutils import Matrix, Vector

from ..mesh.baked_levels import EXTRAS
from ..nodes.lod import GROUP_NAME, lod_distance
from ..versions import get_modifier_input
from .corners import MaterialTriangles, parts_of
from .look import LevelInputs, look_at
from .shader import ATTRIBUTES, SAMPLERS, compiled, uniforms_of, uniforms_of_paint

Uniforms = dict[str, float | Sequence[float]]


@dataclass(frozen=True)
class Drawn:
    """One drawn object: its node group inputs as they were read, and its triangles on the graphics card."""

    obj: bpy.types.Object
    inputs: LevelInputs
    centre: Vector
    batches: list[tuple[MaterialTriangles, gpu.types.GPUBatch]]


@dataclass
class Preview:
    """The preview of a scene. It reads the levels once, so levels of a later bake need a new preview."""

    shader: gpu.types.GPUShader = field(default_factory=compiled)
    drawn: list[Drawn] = field(default_factory=list)
    pages: dict[str, gpu.types.GPUTexture] = field(default_factory=dict)

    def read(self, objects: list[bpy.types.Object]) -> None:
        for obj in objects:
            batches = [(part, self._batch(part)) for part in parts_of(obj)]
            self.drawn.append(Drawn(obj, inputs_of(obj), centre_of(obj), batches))

    def draw(self) -> None:
        """Draw into the region of a 3D view, with that region's camera."""
        region = bpy.context.region_data
        eye, to_clip = region.view_matrix.inverted().translation, region.perspective_matrix
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        try:
            for drawn in self.drawn:
                with suppress(ReferenceError):  # The level was deleted.
                    self._draw(drawn, eye, to_clip)
        finally:
            gpu.state.depth_mask_set(False)
            gpu.state.depth_test_set("NONE")

    def _draw(self, drawn: Drawn, eye: Vector, to_clip: Matrix) -> None:
        factor = distance_factor(drawn.obj)
        uniforms = uniforms_in_view(drawn.obj.matrix_world, drawn.inputs, drawn.centre, eye, to_clip, factor)
        if uniforms is None:
            return
        self.shader.bind()
        for part, batch in drawn.batches:
            for name, value in {**uniforms, **uniforms_of_paint(part.paint)}.items():
                self.shader.uniform_float(name, value)
            for name, image in zip(SAMPLERS, (part.paint.color, part.paint.opacity), strict=True):
                self.shader.uniform_sampler(name, self._page(image))
            batch.draw(self.shader)

    def _batch(self, part: MaterialTriangles) -> gpu.types.GPUBatch:
        layout = gpu.types.GPUVertFormat()
        for name, kind in ATTRIBUTES.items():
            layout.attr_add(id=name, comp_type="F32", len=1 if kind == "FLOAT" else int(kind[3]), fetch_mode="FLOAT")
        corners = gpu.types.GPUVertBuf(layout, len(part.attributes["position"]))
        for name in ATTRIBUTES:
            corners.attr_fill(name, np.ascontiguousarray(part.attributes[name]))
        return gpu.types.GPUBatch(type="TRIS", buf=corners)

    def _page(self, image: bpy.types.Image | None) -> gpu.types.GPUTexture:
        name = "" if image is None else image.name
        if name not in self.pages:
            white = gpu.types.Buffer("FLOAT", 4, [1.0] * 4)
            self.pages[name] = gpu.texture.from_image(image) if name else gpu.types.GPUTexture(1, data=white)
        return self.pages[name]


def uniforms_in_view(
    matrix: Matrix, inputs: LevelInputs, centre: Vector, eye: Vector, to_clip: Matrix, factor: float = 1.0
) -> Uniforms | None:
    """Return the uniforms of a level at `matrix` seen from `eye` in the world; None if the level is not drawn.

    `centre`: the point to measure distances from, in the level's coordinates. `to_clip`: from world to clip space.
    `factor`: the level's LOD Distance.
    """
    place = matrix.inverted_safe() @ eye
    look = look_at(inputs, (place - centre).length / factor)
    if look is None:
        return None
    handed = -1.0 if matrix.is_negative else 1.0
    return {**uniforms_of(look), "eye": place, "to_clip": to_clip @ matrix, "handed": handed}


def centre_of(obj: bpy.types.Object) -> Vector:
    """Return the point to measure a level's distances from, in its own coordinates."""
    return Vector(get_modifier_input(obj.modifiers[GROUP_NAME], "Centre"))


def distance_factor(obj: bpy.types.Object) -> float:
    """Return a level's LOD Distance. An artist may change it during the preview."""
    return lod_distance(obj.modifiers[GROUP_NAME])


def levels_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the objects that follow a camera: levels and their trunks."""
    return [obj for obj in scene.objects if obj.type == "MESH" and GROUP_NAME in obj.modifiers]


def inputs_of(obj: bpy.types.Object) -> LevelInputs:
    """Return the current inputs of a level's node groups, and the tables in its extras."""
    modifier = obj.modifiers[GROUP_NAME]

    def number(name: str) -> float:
        return float(get_modifier_input(modifier, name))

    extras = obj.get(EXTRAS)
    table = obj.data.get(EXTRAS)
    return LevelInputs(
        start=number("Start"),
        end=number("End"),
        prune_start=number("Prune Start"),
        prune_half=number("Prune Half"),
        appear=number("Appear"),
        vanish=number("Vanish"),
        fade_in_end=number("Fade In End"),
        fade_out_start=number("Fade Out Start"),
        growth=(number("Growth"), number("Growth Quadratic")),
        contrast=(number("Contrast"), number("Contrast Quadratic")),
        mean_color=tuple(extras["mean_color"]) if extras is not None and "mean_color" in extras else (0.0, 0.0, 0.0),
        area_shares=tuple(table["area_shares"]) if table is not None and "area_shares" in table else (),
    )
