"""A bake of several trees: each goes the pipeline's way by itself, and levels of one number share an atlas page.

A single tree is a grove of one, and keeps its own pages.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace

import bpy

import leafcloud

from .baked import Baked, Grove, Planned, Prepared
from .build.rollback import removed_on_failure
from .job import Progress, wait
from .pipeline import file_name, finish, plan, prepare, start, view_of
from .plan.effects import CameraNote, Effect, camera_note, is_on
from .scene import SceneError
from .scene.extract import Tree
from .scene.trees import numbered
from .settings import PAGE_EFFECTS, BakeSettings

Said = Callable[[str], str]
"""How a face says a message that names settings: see `naming`."""


def plan_grove(
    trees: Mapping[str, Tree], settings: BakeSettings, layer: bpy.types.ViewLayer | None, said: Said = str
) -> dict[str, Planned]:
    """As `pipeline.plan` for each tree."""
    planned = {name: plan(tree, settings, layer) for name, tree in trees.items()}
    return {name: replace(each, effects=_effects_said(each.effects, said)) for name, each in planned.items()}


def prepare_grove(
    trees: Mapping[str, Tree], settings: BakeSettings, layer: bpy.types.ViewLayer | None, said: Said = str
) -> dict[str, Prepared]:
    """As `pipeline.prepare` for each tree. What one needs a texture for, all get: pages have the same channels; and of
    the seconds that a bake may take each has as many.

    Raises `SceneError` where some trees are blended and the others cut out.
    """
    if settings.seconds is not None:
        settings = replace(settings, seconds=settings.seconds / len(trees))
    prepared = {name: prepare(tree, settings, layer) for name, tree in trees.items()}
    _check_alpha(prepared)
    wanted = {effect.name for each in prepared.values() for effect in each.effects if effect.on} & set(PAGE_EFFECTS)

    def with_channels(each: Prepared) -> Prepared:
        lacking = [name for name in PAGE_EFFECTS if name in wanted and not is_on(each.effects, name)]
        if not lacking:
            return each
        asked = ",".join([settings.effects, *(f"+{name}" for name in lacking)])
        again = prepare(each.tree, replace(settings, effects=asked), layer)
        reason = "another tree has it, and they share their pages"
        given = (replace(effect, reason=reason) if effect.name in lacking else effect for effect in again.effects)
        return replace(again, effects=tuple(given))

    return {name: _prepared_said(with_channels(each), said) for name, each in prepared.items()}


def camera_notes(planned: Iterable[Planned | Prepared]) -> tuple[CameraNote, ...]:
    """What there is to tell of the scene's camera, once where it is the same of several trees."""
    notes = (camera_note(each.settings, each.facts, each.effects) for each in planned)
    return tuple(dict.fromkeys(note for note in notes if note is not None))


def start_grove(prepared: Mapping[str, Prepared]) -> ChainsJob:
    """Starts the core: the trees one after the other, for each takes all processors."""
    return ChainsJob(prepared)


def finish_grove(
    prepared: Mapping[str, Prepared], chains: Collection[leafcloud.Chain], name: str, scene: bpy.types.Scene
) -> Grove:
    """Builds the levels in the scene, one collection a tree; those of several trees lie in one called `name`."""
    view = view_of(scene)
    with removed_on_failure():
        if len(prepared) == 1:
            [each], [chain] = prepared.values(), chains
            tree = finish(each, chain, name, view)
            scene.collection.children.link(tree.collection)
            return Grove.of(tree)
        collection = bpy.data.collections.new(name)
        scene.collection.children.link(collection)
        trees: list[Baked] = []
        known = set(bpy.data.images)
        made: dict[bpy.types.Image, str] = {}
        for (own, each), chain in zip(prepared.items(), chains, strict=True):
            tree = finish(each, chain, free_name(file_name(own)), view)
            collection.children.link(tree.collection)
            trees.append(tree)
            own_images = sorted(set(bpy.data.images) - known - made.keys(), key=lambda image: image.name)
            made |= dict.fromkeys(own_images, tree.collection.name)
        _share_images(made, name)
    return Grove(name, collection, tuple(trees))


def bake_grove(prepared: Mapping[str, Prepared], scene: bpy.types.Scene, name: str, progress: Progress) -> Grove:
    """What follows on `prepare_grove`, and needs nothing of the trees' own scene but the camera."""
    chains = wait(start_grove(prepared), progress)
    progress("build", 0.0)
    return finish_grove(prepared, chains, name, scene)


def free_name(wanted: str) -> str:
    """`wanted`, with a number if the levels could not have their names under it."""
    taken = [item.name for item in (*bpy.data.collections, *bpy.data.objects)]

    def is_taken(name: str) -> bool:
        return name in bpy.data.collections or any(other.startswith(f"{name}_LOD") for other in taken)

    return numbered(wanted, is_taken)


class ChainsJob:
    """The chains of trees, in their order, on shared pages if there are several; to be waited for as `leafcloud.Job`.

    Works on a thread of its own, which never touches Blender.
    """

    def __init__(self, prepared: Mapping[str, Prepared]) -> None:
        self._prepared = prepared
        self._finished = 0
        self._cancelled = False
        self._job: leafcloud.Job[leafcloud.Chain] | None = None
        with _one_thread() as thread:
            self._result: Future[list[leafcloud.Chain]] = thread.submit(self._work)

    @property
    def stage(self) -> str:
        """What is done, and of several trees for which; empty before anything is."""
        finished, job, names = self._finished, self._job, list(self._prepared)  # Once: the thread goes on meanwhile.
        if job is None or len(names) == 1:
            return "" if job is None else job.stage
        return "share pages" if finished == len(names) else f"{names[finished]}: {job.stage}"

    @property
    def fraction(self) -> float:
        """In [0, 1]."""
        finished, job, count = self._finished, self._job, len(self._prepared)
        within = 0.0 if job is None or finished == count else job.fraction
        return (finished + within) / count

    @property
    def done(self) -> bool:
        return self._result.done()

    def cancel(self) -> None:
        self._cancelled = True
        if self._job is not None:
            self._job.cancel()

    def result(self, timeout: float | None = None) -> list[leafcloud.Chain]:
        """Waits for the end. Raises the work's error, `CancelledError` or, after `timeout` seconds, `TimeoutError`."""
        return self._result.result(timeout)

    def _work(self) -> list[leafcloud.Chain]:
        chains = []
        for name, each in self._prepared.items():
            with _named(name if len(self._prepared) > 1 else None):
                self._job = start(each)
                if self._cancelled:  # Between two jobs: there was none to tell.
                    self._job.cancel()
                chains.append(self._job.result())
            self._finished += 1
        shared = chains if len(chains) == 1 else leafcloud.share_pages(chains)
        if self._cancelled:
            raise leafcloud.CancelledError("cancelled")
        return shared


@contextmanager
def _named(tree: str | None) -> Iterator[None]:
    """Says of which tree a refusal is, where there are several."""
    try:
        yield
    except leafcloud.CancelledError:
        raise
    except leafcloud.LeafcloudError as error:
        if tree is None:
            raise
        raise leafcloud.LeafcloudError(f"tree {tree!r}: {error}") from error


@contextmanager
def _one_thread() -> Iterator[ThreadPoolExecutor]:
    """A thread that ends when it has done what it was given in the block; nobody waits for it here."""
    pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="leafcloud")
    try:
        yield pool
    finally:
        pool.shutdown(wait=False)


def _prepared_said(prepared: Prepared, said: Said) -> Prepared:
    return replace(
        prepared, effects=_effects_said(prepared.effects, said), warnings=tuple(map(said, prepared.warnings))
    )


def _effects_said(effects: Iterable[Effect], said: Said) -> tuple[Effect, ...]:
    return tuple(replace(effect, reason=said(effect.reason)) for effect in effects)


def _check_alpha(prepared: Mapping[str, Prepared]) -> None:
    blended = [name for name, each in prepared.items() if is_on(each.effects, "blend_order")]
    if blended and len(blended) < len(prepared):
        raise SceneError(
            f"the leaves of {', '.join(blended)} are seen through, those of the other trees are cut out, and no page "
            "has both: bake them apart, or cut out all with `effects=-blend_order`"
        )


def _share_images(made: Mapping[bpy.types.Image, str], name: str) -> None:
    """Leaves one of the images wherever several are equal: each tree has brought a copy of every page.

    `made` has the tree by whose name each is called; what is shared is called by `name` instead.
    """
    kept: dict[tuple[str, bytes], bpy.types.Image] = {}
    shared = set()
    for image in made:
        own = kept.setdefault((image.colorspace_settings.name, image.packed_file.data), image)
        if own is not image:
            shared.add(own)
            image.user_remap(own)
            bpy.data.images.remove(image)
    for image in shared:
        image.name = name + image.name.removeprefix(made[image])
        image.filepath_raw = f"//{image.name}.png"
