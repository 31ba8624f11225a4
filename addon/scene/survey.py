"""What surrounds the tree in a scene, as plain values for the plan: its cameras and its lights, over all frames.

Frames are only gone through where something may move: then the scene is evaluated at up to `FRAMES` of them, and at
its own again. What was moved by hand off its keys since that frame was set goes back to them, as when an artist scrubs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..plan.facts import Camera, Lights, Span
from ..plan.reach import View
from ..plan.sight import STILL
from .extract import Tree

FRAMES = 64
"""At most so many of the scene's frames are looked at, evenly, with the first and the last."""

_NEAREST = 1e-6
"""World units: a camera in the very middle of a crown moves by shares of this."""

_Pose = list[float]
"""Numbers of which none changes by more than `STILL` while a camera stands still."""

_Look = tuple[bool, tuple[float, ...]]
"""Whether a light shines at a frame, and what there is to see of it."""


@dataclass(frozen=True)
class Surroundings:
    """What `survey` found; `camera` is None where none looks."""

    camera: Camera | None
    lights: Lights


def survey(layer: bpy.types.ViewLayer, tree: Tree, centre: Sequence[float], view: View) -> Surroundings:
    """Looks around in the scene of `layer`, whose dependency graph is up to date.

    `centre` is that of the tree's crown, in the world, as the scene stands now; `view` is what its cameras see with.
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
        return Surroundings(None, lights)
    moves = len(set(cameras.values())) > 1 or bool(np.ptp(poses, axis=0).max() > STILL)
    return Surroundings(Camera(_spans(distances), view, moves), lights)


def _pose(camera: bpy.types.Object, away: float) -> _Pose:
    """Where an evaluated camera stands in units of `away`, how it is turned, and the logarithms of its zoom."""
    matrix = np.array(camera.matrix_world)
    turned = np.array(camera.matrix_world.to_3x3().normalized())
    # A scene may look through an object of any type; only cameras zoom.
    zoom = (camera.data.lens, camera.data.ortho_scale) if camera.type == "CAMERA" else ()
    return [*(matrix[:3, 3] / max(away, _NEAREST)), *turned.ravel(), *map(math.log, zoom)]


def _spans(distances: Sequence[Sequence[float]]) -> tuple[Span, ...]:
    """Of each tree, from its distances frame by frame; of all copies together where there is not always one of each."""
    if len({len(each) for each in distances}) == 1:
        return tuple((min(each), max(each)) for each in zip(*distances, strict=True))
    own, others = [each[0] for each in distances], [away for each in distances for away in each[1:]]
    return (min(own), max(own)), (min(others), max(others))


def _cameras(scene: bpy.types.Scene) -> dict[int, bpy.types.Object]:
    """Each camera from the frame on that it looks: the scene's own, or those that its markers name."""
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
    """The frames that are looked at, among them each on which another camera takes over; one where nothing moves."""
    known: set[bpy.types.Object] = set()
    if len(cameras) < 2 and not any(map(_is_animated, worlds)) and not any(_may_move(obj, known) for obj in objects):
        return [scene.frame_current]
    first, last = scene.frame_start, max(scene.frame_end, scene.frame_start)
    even = np.unique(np.linspace(first, last, FRAMES).round().astype(int)).tolist()
    cuts = [frame for start in cameras for frame in (start - 1, start) if first <= frame <= last]
    return sorted({*even, *cuts})


@contextmanager
def _frame_kept(scene: bpy.types.Scene) -> Iterator[None]:
    """Puts the scene back to its frame and camera at the end of the block, if they have changed."""
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
    """The baked tree and its copies in the scene, as far as a camera's distance from their middles goes."""

    layer: bpy.types.ViewLayer
    frame: bpy.types.Object
    others: tuple[bpy.types.Object, ...]
    """The tree's own other objects, which are no copies."""
    centre: Vector
    """Of the crown, in the coordinates of `frame`."""
    scale: float
    """Of `frame`."""

    def distances(self, camera: bpy.types.Object) -> list[float]:
        """From the camera, the baked tree first; in an order that is the same at every frame."""
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
    """Copies are whatever shows the mesh of the tree's first object and is not part of what is baked."""
    frame, *others = tree.sources
    here = frame.evaluated_get(layer.depsgraph).matrix_world.copy()
    return _Crowns(layer, frame, tuple(others), here.inverted_safe() @ Vector(centre), _scale(here))


def _scale(matrix: Matrix) -> float:
    return abs(matrix.to_3x3().determinant()) ** (1.0 / 3.0)


def _may_move(obj: bpy.types.Object, known: set[bpy.types.Object]) -> bool:
    """Whether an object's place may depend on the frame: its own, or that of what it hangs on or looks at."""
    if obj in known:
        return False
    known.add(obj)
    if _is_animated(obj) or _is_animated(obj.data) or obj.rigid_body is not None:
        return True
    targets = [getattr(constraint, "target", None) for constraint in obj.constraints]
    return any(_may_move(other, known) for other in (obj.parent, *targets) if other is not None)


def _is_animated(block: bpy.types.ID | None) -> bool:
    """Whether a data-block has keys, strips or drivers, or its nodes have."""
    if block is None:
        return False
    animation = getattr(block, "animation_data", None)
    if animation is not None and (animation.action or animation.nla_tracks or animation.drivers):
        return True
    return _is_animated(getattr(block, "node_tree", None))


def _look_of_lamp(layer: bpy.types.ViewLayer, lamp: bpy.types.Object) -> _Look:
    own = lamp.evaluated_get(layer.depsgraph)
    # Where a sun is says nothing, only how it is turned.
    matrix = own.matrix_world.to_3x3() if own.data.type == "SUN" else own.matrix_world
    light = (own.data.energy * np.array(own.data.color)).tolist()
    return any(light), tuple(round(float(value), 5) for value in (*(v for row in matrix for v in row), *light))


def _look_of_world(world: bpy.types.World) -> _Look:
    """A world that is as plain as a new one shines with its colour; any other does."""
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
    """Those of the lamps and worlds that ever shine; nodes that are animated count as a change without looking."""
    shining = [(source, seen) for source, seen in zip(sources, looks, strict=True) if any(on for on, _ in seen)]
    changing = None
    for source, seen in shining:
        kind, block = ("world", source) if isinstance(source, bpy.types.World) else ("lamp", source.data)
        if changing is None and (len(set(seen)) > 1 or _is_animated(block.node_tree)):
            changing = f"the {kind} {source.name!r} moves or changes"
    return Lights(tuple(source.name for source, _ in shining), changing)
