"""Writer of all files of a bake, for one tree or for several that share atlas pages."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import bpy
from mathutils import Vector

import leafcloud

from ..bake.job import Progress, StageClock
from ..bake.values import Baked, TreeSet
from ..effects.blend_order import blended_leaves
from ..levels.octahedral import plain_files
from ..levels.rollback import left_out
from ..levels.root import without_root
from ..levels.shadow_proxy import shadow_proxy_of
from ..material.blended import masked
from ..mesh.baked_levels import plain_mesh
from ..plan.decision import is_on
from ..plan.effects import on_effects
from ..plan.lod_range import View
from ..plan.pages import KTX2_ENGINES
from . import gltf, ktx2, report_page
from .blend import save_blend
from .blend_order import BlendOrders
from .compression import compress
from .glb_file import Edit
from .gpu_load import GpuLoad
from .joined_trunks import join_trunks
from .lod_extension import LodChain, add_lods, screen_coverages
from .pictures import film_names, write_pictures
from .plain_materials import materials_of_meshes, untangled
from .preview import pictures_of
from .report import joint_report, report
from .staging import Staging
from .usual_view import for_usual_view, to_usual_view
from .vertex_data import VertexData, engine_attributes


def write(tree_set: TreeSet, directory: Path, progress: Progress, *, blend: bool) -> dict[str, Any]:
    """Write all files of the bake into `directory`, all or none, and return the report.

    The report has the seconds of `progress` if that is the clock of the whole bake, else those of writing.

    Each file holds all trees: NAME.glb shows level 0 of each tree and references the other levels (`lod_extension`).
    If the settings ask for them, NAME_LOD1.glb has the first cloud of each tree, and shared atlas pages once, and a
    film shows each hand-over. `blend` also saves a copy of the open file as NAME.blend. The levels must be in a scene.

    Raises `OSError` for a folder that is not writable, `ExportError` if Blender cannot write a file.
    """
    clock = progress if isinstance(progress, StageClock) else StageClock(progress)
    name, trees = tree_set.name, tree_set.trees
    settings, count = trees[0].prepared.settings, max(len(tree.levels) for tree in trees)
    # The core draws pictures while Blender writes the files.
    with Staging(directory) as staging, ThreadPoolExecutor(max_workers=1) as pool:
        drawn = [pool.submit(pictures_of, tree) for tree in trees]
        seconds = [0.0] * count
        with ExitStack() as changes:
            load = GpuLoad()
            last = [compress] if settings.compress else []
            edits = [*_edits(trees), join_trunks, *last, load.read]
            # In an engine a tree stands where it is put. Several trees of a file keep their places.
            place = Vector() if len(trees) == 1 and settings.engine != "generic" else None
            for tree in trees:
                changes.enter_context(without_root(tree.collection, place))
                changes.enter_context(plain_files(tree.levels, tree.schedule.plain_distances[-1]))
                changes.enter_context(_as_in_files(tree))
            for number in range(count) if settings.level_files else ():
                stem = f"{name}_LOD{number}"
                clock(f"write {stem}.glb", 0.0)
                begin = time.perf_counter()
                file = staging.path(f"{stem}.glb")
                gltf.export_objects(_objects(trees, number), file, stem, edits)
                seconds[number] = time.perf_counter() - begin
            shadows = [(tree, shadow) for tree in trees if (shadow := shadow_proxy_of(tree.collection)) is not None]
            for tree, shadow in shadows:
                changes.enter_context(left_out(tree.collection, shadow))
            if shadows:
                stem = f"{name}_shadow"
                gltf.export_objects([shadow for _, shadow in shadows], staging.path(f"{stem}.glb"), stem, last)
            clock(f"write {name}.glb", 0.0)
            file = staging.path(f"{name}.glb")
            chains = [_lod_chain(tree) for tree in trees]
            gltf.export_collection(tree_set.collection, file, [*edits, lambda glb: add_lods(glb, chains)])
        if blend:
            clock(f"write {name}.blend", 0.0)
            save_blend(staging.path(f"{name}.blend"))
        films = film_names(trees) if settings.files == "all" else []
        files = sorted([*staging.files, *films, "preview.png", "report.html", "report.json"])
        reports = {each.collection.name: report(each, seconds[: len(each.levels)], files, load) for each in trees}
        content = joint_report(reports, settings.engine) if len(trees) > 1 else reports[name]
        clock("write preview.png", 0.0)
        shown = [
            (tree, reports[tree.collection.name], pictures.result())
            for tree, pictures in zip(trees, drawn, strict=True)
        ]
        sections = write_pictures(staging, shown, films=bool(films))
        content["seconds"] = clock.seconds()
        page = report_page.page(name, content, sections)
        staging.path("report.html").write_text(page, encoding="utf-8", newline="\n")
        staging.write_json("report.json", content)
        staging.commit(_levels_in(directory, [name, *(tree.collection.name for tree in trees)]))
    return content


def _levels_in(directory: Path, names: Iterable[str]) -> set[str]:
    """Return the files of single levels that an earlier bake of the same names wrote, by its report in the folder.

    A chain with fewer levels must not leave the farther levels of a longer one beside it.
    """
    try:
        files = json.loads((directory / "report.json").read_text(encoding="utf-8"))["files"]
        of_level = re.compile(rf"({'|'.join(map(re.escape, names))})_(LOD\d+\.glb|shadow\.glb|flight\d+\.png)")
        return {file for file in files if of_level.fullmatch(file)}
    except (OSError, ValueError, TypeError, KeyError):  # No report, or none of ours.
        return set()


def _edits(trees: Sequence[Baked]) -> list[Edit]:
    """Return the edits that complete the files.

    All trees share their settings, and blended leaves or none.
    """
    first = trees[0]
    engine = first.prepared.settings.engine
    clouds = _levels_by_material(trees)
    taken = {name: level for name, level in clouds.items() if ktx2.is_taken(level)}
    textures = ktx2.Ktx2Textures(taken if engine in KTX2_ENGINES else {})
    if not is_on(first.effects, "blend_order"):
        return [VertexData(engine).add_to, textures.add_to, for_usual_view(first.view)]
    triangles = sum(tree.prepared.facts.triangles for tree in trees)
    orders = BlendOrders(clouds, triangles, first.costs)
    return [VertexData(engine).add_to, orders.add_to, textures.add_to, for_usual_view(first.view)]


@contextmanager
def _as_in_files(tree: Baked) -> Iterator[None]:
    """Change the tree's attributes and materials to those for files while the block runs."""
    settings, facts = tree.prepared.settings, tree.prepared.facts
    with ExitStack() as changes:
        changes.enter_context(engine_attributes(tree.levels))
        changes.enter_context(untangled(tree.levels))
        changes.enter_context(masked(tree.levels[0].object.data.materials, blended_leaves(settings, facts)))
        changes.enter_context(materials_of_meshes(tree.levels))
        for effect in on_effects(tree.effects):
            changes.enter_context(effect.as_in_files(tree.levels))
        yield


def _lod_chain(tree: Baked) -> LodChain:
    names = tuple(level.object.name for level in tree.levels)
    distances = [to_usual_view(tree.view) * each for each in tree.schedule.plain_distances]
    return LodChain(names, screen_coverages(distances, tree.prepared.foliage.radius, View()))


def _objects(trees: Sequence[Baked], number: int) -> list[bpy.types.Object]:
    """Return the objects of level `number` of each tree that has it, with its trunk."""
    levels = [tree.levels[number] for tree in trees if number < len(tree.levels)]
    return [obj for level in levels for obj in (level.object, level.trunk) if obj is not None]


def _levels_by_material(trees: Sequence[Baked]) -> dict[str, leafcloud.Level]:
    """Return the clouds and cross impostors by the name of their only material."""
    return {
        plain_mesh(built.object).materials[0].name: level
        for tree in trees
        for built, level in zip(tree.levels[-len(tree.chain.clouds) :], tree.chain.clouds, strict=True)
    }
