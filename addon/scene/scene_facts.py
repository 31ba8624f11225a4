"""Scene facts for the plan: the cameras and lights around a tree over all frames, as plain values.

Frames are sampled only if something may move. Then the scene is evaluated at `FRAMES` frames or fewer, plus camera
cuts, and at its original frame again. As when an artist scrubs the timeline, objects moved by hand off their keyframes
go back to them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..geometry import Tree
from ..plan.camera_visibility import STILL
from ..plan.facts import Camera, Lights, Span
from ..plan.lod_range import View

FRAMES = 64
"""Greatest number of evenly spaced frames to sample, including the first and the last."""

_NEAREST = 1e-6
"""Least distance in world units by which a camera's motion is divided, for a camera in the center of a crown."""

_Pose = list[float]
"""Pose of a camera. A camera is still if none of these numbers changes by more than `STILL`."""

_Look = tuple[bool, tuple[float, ...]]
"""Whether a light shines at a frame, and numbers that describe it."""


@dataclass(frozen=True)
class CamerasAndLights:
    """Cameras and lights around a tree. `camera` is None in a scene without cameras."""

    camera: Camera | None
    lights: Lights


def read_scene_facts(layer: bpy.types.ViewLayer, tree: Tree, centre: Sequence[float], view: View) -> CamerasAndLights:
    """Read the cameras and lights in the scene of `layer`. Its dependency graph must be up to date.

    `centre`: the center of the tree's crown in world space, at the current frame. `view`: resolution and field of view
    of the cameras.
    """
    scene = layer.id_data
    lamps = [obj for obj in layer.objects if obj.type == "LIGHT" and not obj.hide_render]
    worlds = [scene.world] if scene.world is not None else []
    cameras = _cameras(scene)
    distances: list[list[float]] = []
    poses: list[_Pose] = []
    looks: list[list[_Look]] = []
    crowns = _crowns(layer, tree, centre)
    with _frame_kept(scene):
        for frame in _frames(scene, cameras, [*cameras.values(), *lamps, *tree.sources], worlds):
            if frame != scene.frame_current:
                scene.frame_set(frame)
            if (camera := _camera_at(cameras, frame)) is not None:
                distances.append(crowns.distances(camera))
                poses.append(_pose(camera.evaluated_get(layer.depsgraph), distances[0][0]))
            looks.append(
                [*(_look_of_lamp(layer, lamp) for lamp in lamps), *(_look_of_world(world) for world in worlds)]
            )
    lights = _lights([*lamps, *worlds], list(zip(*looks, strict=True)))
    if not distances:
        return CamerasAndLights(None, lights)
    moves = len(set(cameras.values())) > 1 or bool(np.ptp(poses, axis=0).max() > STILL)
    return CamerasAndLights(Camera(_spans(distances), view, moves), lights)


def _pose(camera: bpy.types.Object, away: float) -> _Pose:
    """Return an evaluated camera's position in units of `away`, its rotation matrix, and the logarithms of its zoom."""
    matrix = np.array(camera.matrix_world)
    turned = np.array(camera.matrix_world.to_3x3().normalized())
    # A scene's camera may be an object of any type. Only cameras zoom.
    zoom = (camera.data.lens, camera.data.ortho_scale) if camera.type == "CAMERA" else ()
    return [*(matrix[:3, 3] / max(away, _NEAREST)), *turned.ravel(), *map(math.log, zoom)]


def _spans(distances: Sequence[Sequence[float]]) -> tuple[Span, ...]:
    """Return the distance range of each tree over all frames. If the number of copies changes, they share one range."""
    if len({len(each) for each in distances}) == 1:
        return tuple((min(each), max(each)) for each in zip(*distances, strict=True))
    own, others = [each[0] for each in distances], [away for each in distances for away in each[1:]]
    return (min(own), max(own)), (min(others), max(others))


def _cameras(scene: bpy.types.Scene) -> dict[int, bpy.types.Object]:
    """Return the cameras by the frame from which they are active: those bound to markers, else the scene's camera."""
    marked = {m.frame: m.camera for m in sorted(scene.timeline_markers, key=lambda m: m.frame) if m.camera is not None}
    if marked:
        return marked
    return {} if scene.camera is None else {scene.frame_start: scene.camera}


def _camera_at(cameras: dict[int, bpy.types.Object], frame: int) -> bpy.types.Object | None:
    before = [start for start in cameras if start <= frame]
    return cameras[max(before, default=min(cameras))] if cameras else None


def _frames(
    scene: bpy.types.Scene,
    cameras: dict[int, bpy.types.Object],
    objects: Sequence[bpy.types.Object],
    worlds: Sequence[bpy.types.World],
) -> list[int]:
    """Return the frames to sample, including the frames at camera cuts; only the current frame if nothing moves."""
    known: set[bpy.types.Object] = set()
    if len(cameras) < 2 and not any(map(_is_animated, worlds)) and not any(_may_move(obj, known) for obj in objects):
        return [scene.frame_current]
    first, last = scene.frame_start, max(scene.frame_end, scene.frame_start)
    even = np.unique(np.linspace(first, last, FRAMES).round().astype(int)).tolist()
    cuts = [frame for start in cameras for frame in (start - 1, start) if first <= frame <= last]
    return sorted({*even, *cuts})


@contextmanager
def _frame_kept(scene: bpy.types.Scene) -> Iterator[None]:
    """Restore the scene's frame and camera at the end of the block, if they have changed."""
    frame, subframe, camera = scene.frame_current, scene.frame_subframe, scene.camera
    try:
        yield
    finally:
        if (scene.frame_current, scene.frame_subframe) != (frame, subframe):
            scene.frame_set(frame, subframe=subframe)
        if scene.camera != camera:
            scene.camera = camera


@dataclass(frozen=True)
class _Crowns:
    """The baked tree and its copies in the scene, to measure a camera's distances from their centers."""

    layer: bpy.types.ViewLayer
    frame: bpy.types.Object
    others: tuple[bpy.types.Object, ...]
    """The tree's other objects, which do not count as copies."""
    centre: Vector
    """Center of the crown in the coordinates of `frame`."""
    scale: float
    """Scale of `frame`."""

    def distances(self, camera: bpy.types.Object) -> list[float]:
        """Return the camera's distances from the baked tree and its copies. The order is the same at every frame."""
        depsgraph = self.layer.depsgraph
        eye = camera.evaluated_get(depsgraph).matrix_world.translation
        found = [self._distance(eye, self.frame.evaluated_get(depsgraph).matrix_world)]
        for instance in depsgraph.object_instances:
            own = instance.object.original
            if own == self.frame and not instance.is_instance:
                continue
            placed_by = instance.parent.original if instance.is_instance else own
            if placed_by not in self.others and own.data is not None and own.data == self.frame.data:
                found.append(self._distance(eye, instance.matrix_world))
        return found

    def _distance(self, eye: Vector, matrix: Matrix) -> float:
        own = _scale(matrix)
        return (eye - matrix @ self.centre).length * (self.scale / own if own > 0.0 else 1.0)


def _crowns(layer: bpy.types.ViewLayer, tree: Tree, centre: Sequence[float]) -> _Crowns:
    """Return the crowns. A copy shows the mesh of the tree's first object and is not part of the baked tree."""
    frame, *others = tree.sources
    here = frame.evaluated_get(layer.depsgraph).matrix_world.copy()
    return _Crowns(layer, frame, tuple(others), here.inverted_safe() @ Vector(centre), _scale(here))


def _scale(matrix: Matrix) -> float:
    return abs(matrix.to_3x3().determinant()) ** (1.0 / 3.0)


def _may_move(obj: bpy.types.Object, known: set[bpy.types.Object]) -> bool:
    """Return whether an object, its parents or its constraint targets may move over the frames."""
    waiting = [obj]
    while waiting:  # A chain of parents can be longer than Python's stack allows.
        current = waiting.pop()
        if current in known:
            continue
        known.add(current)
        if _is_animated(current) or _is_animated(current.data) or current.rigid_body is not None:
            return True
        targets = [getattr(constraint, "target", None) for constraint in current.constraints]
        waiting += [other for other in (current.parent, *targets) if other is not None]
    return False


def _is_animated(block: bpy.types.ID | None) -> bool:
    """Return whether a data-block or its node tree has an action, NLA tracks or drivers."""
    if block is None:
        return False
    animation = getattr(block, "animation_data", None)
    if animation is not None and (animation.action or animation.nla_tracks or animation.drivers):
        return True
    return _is_animated(getattr(block, "node_tree", None))


def _look_of_lamp(layer: bpy.types.ViewLayer, lamp: bpy.types.Object) -> _Look:
    own = lamp.evaluated_get(layer.depsgraph)
    # Only the rotation of a sun matters, not its location.
    matrix = own.matrix_world.to_3x3() if own.data.type == "SUN" else own.matrix_world
    light = (own.data.energy * np.array(own.data.color)).tolist()
    return any(light), tuple(round(float(value), 5) for value in (*(v for row in matrix for v in row), *light))


def _look_of_world(world: bpy.types.World) -> _Look:
    """Return whether a world shines, and its values that may change. Nodes other than one Background always shine."""
    nodes = [] if world.node_tree is None else list(world.node_tree.nodes)
    plain = all(node.type in ("BACKGROUND", "OUTPUT_WORLD") for node in nodes)
    backgrounds = [node.inputs for node in nodes if node.type == "BACKGROUND"]
    if not plain or len(backgrounds) > 1:
        return True, ()
    if nodes:
        colors = [np.multiply(each["Strength"].default_value, each["Color"].default_value[:3]) for each in backgrounds]
    else:
        colors = [np.array(world.color)]
    values = [float(value) for color in colors for value in color]
    return any(values), tuple(values)


def _lights(sources: Sequence[bpy.types.ID], looks: Sequence[Sequence[_Look]]) -> Lights:
    """Return the lamps and worlds that shine at any frame. Animated nodes always count as a change."""
    shining = [(source, seen) for source, seen in zip(sources, looks, strict=True) if any(on for on, _ in seen)]
    changing = None
    for source, seen in shining:
        kind, block = ("world", source) if isinstance(source, bpy.types.World) else ("lamp", source.data)
        if changing is None and (len(set(seen)) > 1 or _is_animated(block.node_tree)):
            changing = f"the {kind} {source.name!r} moves or changes"
    return Lights(tuple(source.name for source, _ in shining), changing)
