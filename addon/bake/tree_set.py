"""Bake of a tree set. Each tree passes through the pipeline alone; levels with the same number share an atlas page.

A single tree is a tree set of one, and keeps its own atlas pages.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import replace

import bpy

import leafcloud

from ..errors import SceneError
from ..geometry import Tree
from ..levels.rollback import removed_on_failure
from ..mesh.trees import numbered
from ..plan.decision import Decision, is_on
from ..plan.effects import CameraNote, camera_note
from ..plan.registry import all_effects
from ..settings.bake import BakeSettings
from ..steps import Steps, all_steps, threads
from .job import Progress, wait
from .pipeline import file_name, finish, plan, prepare, start, view_of
from .values import Baked, Planned, Prepared, TreeSet

Said = Callable[[str], str]
"""Function that puts an interface's words into a message that names settings: see `naming`."""


def plan_tree_set(
    trees: Mapping[str, Tree], settings: BakeSettings, layer: bpy.types.ViewLayer | None, said: Said = str
) -> dict[str, Planned]:
    """Plan each tree with `pipeline.plan`."""
    planned = {name: plan(tree, settings, layer) for name, tree in trees.items()}
    return {name: replace(each, effects=_effects_said(each.effects, said)) for name, each in planned.items()}


def prepare_tree_set(
    trees: Mapping[str, Tree], settings: BakeSettings, layer: bpy.types.ViewLayer | None, said: Said = str
) -> dict[str, Prepared]:
    """Prepare each tree with `pipeline.prepare`.

    All atlas pages have the same channels: every tree gets a texture effect that one tree needs. The setting `seconds`
    is divided equally among the trees.
    Raise `SceneError` if some trees are alpha blended and the others are cut out.
    """
    if settings.seconds is not None:
        settings = replace(settings, seconds=settings.seconds / len(trees))
    prepared = {name: prepare(tree, settings, layer) for name, tree in trees.items()}
    _check_alpha(prepared)
    on = {effect.name for each in prepared.values() for effect in each.effects if effect.on}
    wanted = [effect.name for effect in all_effects() if effect.is_page_texture and effect.name in on]

    def with_channels(each: Prepared) -> Prepared:
        lacking = [name for name in wanted if not is_on(each.effects, name)]
        if not lacking:
            return each
        asked = ",".join([settings.effects, *(f"+{name}" for name in lacking)])
        again = prepare(each.tree, replace(settings, effects=asked), layer)
        reason = "another tree has it, and the trees share atlas pages"
        given = (replace(effect, reason=reason) if effect.name in lacking else effect for effect in again.effects)
        return replace(again, effects=tuple(given))

    return {name: _prepared_said(with_channels(each), said) for name, each in prepared.items()}


def camera_notes(planned: Iterable[Planned | Prepared]) -> tuple[CameraNote, ...]:
    """Return the notes about the scene's camera, without duplicates."""
    notes = (camera_note(each.settings, each.facts, each.effects) for each in planned)
    return tuple(dict.fromkeys(note for note in notes if note is not None))


def start_tree_set(prepared: Mapping[str, Prepared], drafts: Mapping[str, Prepared] | None = None) -> ChainsJob:
    """Start the core's jobs, with `drafts` of the same trees first.

    The trees run one after the other, because each uses all processors.
    """
    return ChainsJob(prepared, drafts or {})


def finish_tree_set(
    prepared: Mapping[str, Prepared], chains: Collection[leafcloud.Chain], name: str, scene: bpy.types.Scene
) -> Steps[TreeSet]:
    """Build the levels in the scene, in steps, one collection per tree. The collections of several trees get a parent
    `name`."""
    view = view_of(scene)
    with removed_on_failure():
        if len(prepared) == 1:
            [each], [chain] = prepared.values(), chains
            tree = yield from finish(each, chain, name, view)
            scene.collection.children.link(tree.collection)
            return TreeSet.of(tree)
        collection = bpy.data.collections.new(name)
        scene.collection.children.link(collection)
        trees: list[Baked] = []
        known = set(bpy.data.images)
        made: dict[bpy.types.Image, str] = {}
        for (own, each), chain in zip(prepared.items(), chains, strict=True):
            tree = yield from finish(each, chain, free_name(file_name(own)), view)
            collection.children.link(tree.collection)
            trees.append(tree)
            own_images = sorted(set(bpy.data.images) - known - made.keys(), key=lambda image: image.name)
            made |= dict.fromkeys(own_images, tree.collection.name)
        _share_images(made, name)
    return TreeSet(name, collection, tuple(trees))


def bake_tree_set(prepared: Mapping[str, Prepared], scene: bpy.types.Scene, name: str, progress: Progress) -> TreeSet:
    """Run the bake after `prepare_tree_set`. From the trees' own scene it needs only the camera."""
    chains = wait(start_tree_set(prepared), progress)
    progress("build", 0.0)
    return all_steps(finish_tree_set(prepared, chains, name, scene))


def free_name(wanted: str) -> str:
    """Return `wanted`, with a number added if names of the levels would be taken."""
    taken = [item.name for item in (*bpy.data.collections, *bpy.data.objects)]

    def is_taken(name: str) -> bool:
        return name in bpy.data.collections or any(other.startswith(f"{name}_LOD") for other in taken)

    return numbered(wanted, is_taken)


class ChainsJob:
    """Job for the chains of a tree set, in order, with the interface of `leafcloud.Job`. Several trees share pages.

    Works on a thread of its own, which never touches Blender.

    drafts: chains of the drafts; empty if one of them could not be made, None as long as they are unknown.
    """

    def __init__(self, prepared: Mapping[str, Prepared], drafts: Mapping[str, Prepared]) -> None:
        self._prepared, self._drafted = prepared, drafts
        self.drafts: list[leafcloud.Chain] | None = None
        self._finished = 0
        self._cancelled = False
        self._job: leafcloud.Job[leafcloud.Chain] | None = None
        with threads(1) as thread:
            self._result: Future[list[leafcloud.Chain]] = thread.submit(self._work)

    @property
    def stage(self) -> str:
        """The present stage, with the tree's name if there are several; empty before the first stage."""
        if self.drafts is None and self._drafted:
            return "draft"
        finished, job, names = self._finished, self._job, list(self._prepared)  # Read once: the thread runs on.
        stage = "" if job is None else job.stage
        if not stage or len(names) == 1:
            return stage
        return "share pages" if finished == len(names) else f"{names[finished]}: {stage}"

    @property
    def fraction(self) -> float:
        """The fraction done, in [0, 1]."""
        if self.drafts is None:
            return 0.0
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
        """Wait for the chains. Raise the job's error, `CancelledError` or, after `timeout` seconds, `TimeoutError`."""
        return self._result.result(timeout)

    def _work(self) -> list[leafcloud.Chain]:
        with suppress(leafcloud.LeafcloudError):  # Such as a page too small for a draft. The bake tells its own errors.
            self.drafts = [self._chain(each, draft=True) for each in self._drafted.values()]
        self.drafts = self.drafts or []
        chains = []
        for name, each in self._prepared.items():
            with _named(name if len(self._prepared) > 1 else None):
                chains.append(self._chain(each))
            self._finished += 1
        shared = chains if len(chains) == 1 else leafcloud.share_pages(chains)
        if self._cancelled:
            raise leafcloud.CancelledError("cancelled")
        return shared

    def _chain(self, prepared: Prepared, *, draft: bool = False) -> leafcloud.Chain:
        self._job = start(prepared, few_views=draft)
        if self._cancelled:  # `cancel` was called between two jobs.
            self._job.cancel()
        chain = self._job.result()
        _measure(chain.levels)
        return chain


def _measure(levels: Sequence[leafcloud.AnyLevel]) -> None:
    """Measure the image errors of all levels, which the levels keep. A large tree takes a second, which would stop the
    interface."""
    for level in levels:
        level.image_error  # noqa: B018 the levels keep it


@contextmanager
def _named(tree: str | None) -> Iterator[None]:
    """Prefix errors of the core with the name of the tree; None keeps them."""
    try:
        yield
    except leafcloud.CancelledError:
        raise
    except leafcloud.LeafcloudError as error:
        if tree is None:
            raise
        raise leafcloud.LeafcloudError(f"tree {tree!r}: {error}") from error


def _prepared_said(prepared: Prepared, said: Said) -> Prepared:
    return replace(
        prepared, effects=_effects_said(prepared.effects, said), warnings=tuple(map(said, prepared.warnings))
    )


def _effects_said(effects: Iterable[Decision], said: Said) -> tuple[Decision, ...]:
    return tuple(replace(effect, reason=said(effect.reason)) for effect in effects)


def _check_alpha(prepared: Mapping[str, Prepared]) -> None:
    blended = [name for name, each in prepared.items() if is_on(each.effects, "blend_order")]
    if blended and len(blended) < len(prepared):
        raise SceneError(
            f"the leaves of {', '.join(blended)} are alpha blended, the leaves of the other trees are cut out, and the "
            "two cannot share an atlas page: bake them separately, or cut out all with `effects=-blend_order`"
        )


def _share_images(made: Mapping[bpy.types.Image, str], name: str) -> None:
    """Merge equal images: each tree has its own copy of every shared atlas page.

    made: for each image the tree name that begins its own name. In names of shared images `name` replaces it.
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
        if image.name.startswith(made[image]):
            image.name = name + image.name.removeprefix(made[image])
        image.filepath_raw = f"//{image.name}.png"
