"""Bake the leaves of a tree into levels of detail on the command line:

    blender -b [scene.blend] --python bake.py -- --out DIR …      the open scene, or --input FILE
    python bake.py --input FILE --out DIR …                       with the bpy wheel

Both do the same. Exit status 0: every file in the report was written completely. On a failure (1) or a wrong command
line (2), standard error has one line with the reason, and DIR is unchanged. An interrupt (130) or a termination (143)
also leaves DIR unchanged. Signals have no effect from the moment the files are moved into DIR together. The baked scene
has the levels, and of the open scene cameras, lights and empties alone. The source file is not changed.
"""

from __future__ import annotations

import os
import sys

if __name__ == "__main__":
    # Answer signals before any slow import. Under Blender the folder of this file is not in the module path.
    sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
    from addon.ending import answer_signals, leave, open_closed_streams
    from addon.guard import arguments, guarded

    open_closed_streams()
    CANCELLED = "bake.py: cancelled, nothing was written"
    with guarded("bake.py", CANCELLED):
        answer_signals(CANCELLED)

import argparse
import json
import re
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    import bpy

    from addon.geometry import Tree
    from addon.mesh.trees import Groups
    from addon.plan.decision import Decision
    from addon.plan.effects import CameraNote
    from addon.scene.obj_corrections import Up
    from addon.settings.bake import BakeSettings

STARTED = time.monotonic()
ROOT = Path(__file__).resolve().parent
PROGRAM = "bake.py"
SLOW_SECONDS = 1.0
"""Longer stages are printed on standard error."""


_MADE = {"camera": "only the levels for this view", "anywhere": "all levels"}
"""The levels made with each value of the setting `viewer`."""


class Refusal(Exception):
    """The bake is impossible. The message is one line."""


def main(arguments: Sequence[str]) -> int:
    """Run one bake and return the exit status."""
    from addon.ending import own_temporary_folder

    try:
        _find_wheel()
    except Refusal as error:
        _print(f"{PROGRAM}: {error}", sys.stderr)
        return 1
    from addon.settings.bake import flag
    from addon.settings.effects import asked_effects
    from addon.settings.flags import UsageError, parse, settings_of
    from addon.settings.levels import WISHES

    try:
        options = parse(arguments)
        settings = settings_of(options)
        if options.json and not options.plan_only:
            raise UsageError("--json needs --plan-only: add --plan-only, or leave --json out")
        if options.out is None and not options.plan_only:
            raise UsageError("--out DIR is missing: name the output folder")
        if options.cost_curve and options.plan_only:
            raise UsageError("--cost-curve and --plan-only exclude each other: give one of them")
        wished = [flag(name) for name in WISHES if getattr(settings, name) is not None]
        if options.cost_curve and wished:
            raise UsageError(f"--cost-curve measures all choices of {wished[0]}: give one of them")
        if options.cost_curve and settings.chain == "pruning":
            raise UsageError("--cost-curve measures clouds, and --chain pruning has none: leave one of them out")
        if len(options.input or ()) > 1 and (settings.unlit or asked_effects(settings.effects).named("baked_light")):
            raise UsageError("baked light needs one scene, but --input has several files: open a scene with all trees")
        own_temporary_folder()
    except UsageError as error:
        _print(f"{PROGRAM}: {error}", sys.stderr)
        return 2
    except OSError as error:
        remedy = "make room for temporary files, or name another folder in the environment variable TMPDIR"
        _print(f"{PROGRAM}: no temporary folder: {error}; {remedy}", sys.stderr)
        return 1
    with _own_console() as console:
        try:
            console.tell(_run(options, settings, console))
            return 0
        except Refusal as error:
            console.refuse(str(error))
            return 1


def _run(options: argparse.Namespace, settings: BakeSettings, console: _Console) -> str:
    """Run the action and return its last line of output. Raise `Refusal`."""
    _find_blender()
    import leafcloud
    from addon import guard
    from addon.errors import SceneError
    from addon.settings.flags import with_flags
    from addon.settings.notes import notes

    for note in notes(settings):
        console.note(with_flags(note))
    if (options.memory or options.minutes) and not guard.is_guarded:
        console.note("--memory and --minutes have no effect inside Blender, and on other systems than Linux")
    try:
        if options.plan_only:
            return _plan(options, settings, console)
        if options.cost_curve:
            return _measure_curve(options, settings, console)
        return _bake(options, settings, console)
    except (SceneError, leafcloud.LeafcloudError) as error:
        raise Refusal(with_flags(str(error))) from error
    except MemoryError as error:
        raise Refusal(f"the memory is full: {error or 'no size is known'}; use a smaller tree or textures") from error


def _find_blender() -> None:
    """Import bpy. Raise `Refusal` if it is missing, or cannot be loaded, such as with too little memory."""
    if find_spec("bpy") is None:
        raise Refusal(
            f"{sys.executable} has no module bpy: run `make setup` and use .venv/bin/python, or run "
            "`blender -b --python bake.py -- …`"
        )
    try:
        import bpy  # noqa: F401
    except ImportError as error:
        raise Refusal(f"the module bpy cannot be loaded: {error}; free memory, or run `make setup` again") from error


def _find_wheel() -> None:
    """Make the wheel importable: the settings read their ranges from it. Raise `Refusal` if it is missing or broken."""
    if find_spec("leafcloud") is None:
        # Append to the path, so that no package of that environment hides one of Blender's own modules.
        sys.path += [str(folder.parent) for folder in sorted(ROOT.glob(".venv/[Ll]ib/**/site-packages/leafcloud"))]
    if find_spec("leafcloud") is None:
        raise Refusal("the module leafcloud is missing: run `make setup`, or enable the Leafcloud extension")
    try:
        import leafcloud  # noqa: F401
    except ImportError as error:
        raise Refusal(f"the module leafcloud cannot be loaded: {error}; run `make setup` again") from error


def _trees(options: argparse.Namespace) -> tuple[dict[str, Tree], str]:
    """Return the trees to bake by name, and the base name of all files."""
    import bpy

    from addon.bake.pipeline import file_name, layer_of
    from addon.mesh.extract import extract
    from addon.mesh.motion import at_rest
    from addon.mesh.trees import extract_trees, grouped, rendered

    files: dict[str, set[bpy.types.Object]] = {}
    notes: list[str] = []
    if options.input is not None:
        files, notes = _load(options.input, options.up)
        name = file_name("_".join(files))
    elif not bpy.app.binary_path:
        raise Refusal("no scene is open in the bpy module: name a file with --input FILE")
    else:
        active = bpy.context.view_layer.objects.active
        name = file_name(Path(bpy.data.filepath).stem or ("tree" if active is None else active.name))
    layer = layer_of(bpy.context.scene)
    with at_rest(layer):
        depsgraph = bpy.context.evaluated_depsgraph_get()
        if options.trees == "one" and len(files) < 2:
            trees = {name: extract(depsgraph, None, leaf_names=options.leaves)}
        else:
            shown = rendered(layer)
            groups: Groups = {stem: [obj for obj in shown if obj in objects] for stem, objects in files.items()}
            if options.trees != "one":
                groups = grouped(shown, options.trees)
            trees = extract_trees(depsgraph, groups, leaf_names=options.leaves)
    if options.alpha == "texture":
        _cut_out(trees)
    return {each: replace(tree, warnings=[*notes, *tree.warnings]) for each, tree in trees.items()}, name


def _cut_out(trees: Mapping[str, Tree]) -> None:
    """Cut the leaves' opaque materials out by their images."""
    from addon.material.cutouts import cut_out_by_images

    for tree in trees.values():
        cut_out_by_images(tree.leaves.materials)


def _load(files: Sequence[Path], up: Up) -> tuple[dict[str, set[bpy.types.Object]], list[str]]:
    """Open the files in one scene. Return the objects of each file by the file's name, and notes about the files."""
    import bpy

    from addon.mesh.trees import numbered
    from addon.scene.load import load, load_beside

    first, *others = files
    told = {first: load(first, up)}
    groups = {first.stem: set(bpy.data.objects)}
    for path in others:
        objects, told[path] = load_beside(path, up)
        groups[numbered(path.stem, groups.__contains__)] = set(objects)
    of_file = {path: f"{path.name}: " if others else "" for path in told}
    return groups, [f"{of_file[path]}{note}" for path, notes in told.items() for note in notes]


def _plan(options: argparse.Namespace, settings: BakeSettings, console: _Console) -> str:
    import bpy

    from addon.bake.pipeline import layer_of
    from addon.bake.tree_set import camera_notes, plan_tree_set
    from addon.plan.effects import joint_effects
    from addon.settings.flags import with_flags

    trees, _ = _trees(options)
    planned = plan_tree_set(trees, settings, layer_of(bpy.context.scene), with_flags)
    console.camera_notes(camera_notes(planned.values()))
    effects = joint_effects([each.effects for each in planned.values()])
    if options.json:
        return json.dumps([asdict(effect) for effect in effects], indent=2)
    return plan_table(effects)


def plan_table(effects: Sequence[Decision]) -> str:
    """Return the plan as a table with one line per effect: name, state, expected seconds and megabytes, reason."""
    shown = {True: "on", False: "off", None: "auto"}
    rows = [("effect", "", "seconds", "MB", "reason")]
    for effect in effects:
        costs = ("", "") if effect.on is False else (f"{effect.seconds:.1f}", f"{effect.bytes / 1e6:.1f}")
        rows.append((effect.name, shown[effect.on], *costs, effect.reason))
    first, second, *widths = (max(len(row[column]) for row in rows) for column in range(4))
    lines = (
        f"{name:<{first}}  {on:<{second}}  {seconds:>{widths[0]}}  {size:>{widths[1]}}  {reason}"
        for name, on, seconds, size, reason in rows
    )
    return "\n".join(lines)


def _bake(options: argparse.Namespace, settings: BakeSettings, console: _Console) -> str:
    import bpy

    from addon.bake.job import StageClock
    from addon.bake.pipeline import layer_of
    from addon.bake.tree_set import bake_tree_set, camera_notes, prepare_tree_set
    from addon.export.blend import clear_scene, make_self_contained
    from addon.export.files import write
    from addon.export.staging import Staging
    from addon.scene.rendering import allow_bounces
    from addon.settings.flags import with_flags

    stages = StageClock(_Stages(console), STARTED)
    with _refusing(options.out), Staging(options.out):
        pass  # Report a folder that is not writable before the work, not after it.
    stages("read", 0.0)
    trees, name = _trees(options)
    _keep_sources(options.input or [Path(bpy.data.filepath)], options.out, [name, *trees])
    scene = bpy.context.scene
    stages("prepare", 0.0)
    prepared = prepare_tree_set(trees, settings, layer_of(scene), with_flags)
    console.camera_notes(camera_notes(prepared.values()))
    clear_scene(scene)
    tree_set = bake_tree_set(prepared, scene, name, stages)
    make_self_contained()
    allow_bounces(scene)
    with _refusing(options.out):
        report = write(tree_set, options.out, stages, blend=True)
    console.warn([with_flags(warning) for warning in report["warnings"]])
    told = report.get("trees", [report])
    for tree in told:
        of_tree = f"{tree['name']}: " if len(told) > 1 else ""
        for reason in [*(each["reason"] for each in tree["left_out"]), tree["needs_no_levels"]]:
            if reason:
                console.note(of_tree + with_flags(reason))
    levels = max(len(tree.levels) for tree in tree_set.trees)
    of_trees = f" of {len(trees)} trees" if len(trees) > 1 else ""
    return f"{name}: {levels} levels{of_trees}, {len(report['files'])} files in {options.out}; {_savings(told)}"


def _keep_sources(sources: Sequence[Path], out: Path, names: Sequence[str]) -> None:
    """Raise `Refusal` if the results with these names would replace a file that is baked."""
    results = re.compile(rf"({'|'.join(map(re.escape, names))})(_LOD\d+|_shadow)?\.(glb|blend)", re.IGNORECASE)

    def is_result(file: Path) -> bool:
        return bool(results.fullmatch(file.name)) and out.is_dir() and out.samefile(file.parent)

    for source in sources:
        if is_result(source) or is_result(source.resolve()):
            raise Refusal(f"the results in {out} would replace {source}, which is baked: choose another --out")


def _savings(told: Sequence[dict[str, Any]]) -> str:
    """Return how many times cheaper each level is to draw than the leaves, from the reports of all trees."""

    def times(tree: dict[str, Any]) -> str:
        of_tree = f"{tree['name']} " if len(told) > 1 else ""
        return of_tree + ", ".join(f"{level['drawing']['cheaper']:.1f}" for level in tree["levels"][1:])

    return f"cheaper to draw than the leaves at the same distance: {'; '.join(map(times, told))} ×"


def _measure_curve(options: argparse.Namespace, settings: BakeSettings, console: _Console) -> str:
    from addon.bake.job import wait
    from addon.bake.pipeline import prepare, start_curve
    from addon.export.curve import write_curve
    from addon.export.staging import Staging

    stages = _Stages(console)
    with _refusing(options.out), Staging(options.out):
        pass
    stages("read", 0.0)
    trees, name = _trees(options)
    if len(trees) > 1:
        raise Refusal(
            f"--cost-curve measures one tree, but there are {len(trees)}: name the file or the leaves of one tree"
        )
    [tree] = trees.values()
    stages("prepare", 0.0)
    curve = wait(start_curve(prepare(tree, settings), quick=options.cost_curve == "quick"), stages)
    with _refusing(options.out):
        files = write_curve(curve, name, options.out)
    return f"{name}: {len(curve.rows)} settings measured, {len(files)} files in {options.out}"


@contextmanager
def _refusing(directory: Path) -> Iterator[None]:
    """Turn errors of the system or Blender on writing to `directory` into a `Refusal`."""
    from addon.errors import ExportError

    try:
        yield
    except (FileExistsError, NotADirectoryError) as error:
        raise Refusal(f"cannot write to {directory}: {error.filename} is not a folder; choose another --out") from error
    except ExportError as error:
        remedy = "make room there, or try File > Export > glTF 2.0 in Blender to see what it cannot write"
        raise Refusal(f"cannot write to {directory}: {error}; {remedy}") from error
    except OSError as error:
        remedy = "make room there, or choose another folder with --out"
        raise Refusal(f"cannot write to {directory}: {error.strerror or error}; {remedy}") from error


def _printable(text: str) -> str:
    """Return a text in one line, with control characters of names as escape sequences: they command terminals."""
    line = " ".join(text.split())
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in line)


class _Console:
    """Standard output and error for the program's own messages, while Blender's output goes into a log.

    A message that cannot be written is lost, such as to a reader that has ended: the bake goes on.
    """

    def __init__(self, out: TextIO, err: TextIO) -> None:
        self._out, self._err = out, err

    def tell(self, text: str) -> None:
        _print(text, self._out)

    def progress(self, stage: str) -> None:
        _print(f"{PROGRAM}: {stage} …", self._err)

    def warn(self, warnings: Sequence[str]) -> None:
        for warning in warnings:
            _print(f"{PROGRAM}: warning: {_printable(warning)}", self._err)

    def note(self, text: str) -> None:
        _print(f"{PROGRAM}: note: {_printable(text)}", self._err)

    def camera_notes(self, notes: Sequence[CameraNote]) -> None:
        from addon.settings.flags import with_flags

        for note in notes:
            remedy = f"; `viewer={note.viewer}` makes {_MADE[note.viewer]}" if note.viewer else ""
            self.note(with_flags(note.text + remedy))

    def refuse(self, reason: str) -> None:
        _print(f"{PROGRAM}: {_printable(reason)}", self._err)


def _print(text: str, file: TextIO) -> None:
    with suppress(OSError):
        print(text, file=file, flush=True)


class _Stages:
    """Print the name of each stage that takes more than a second, as soon as it does, and only once."""

    def __init__(self, console: _Console) -> None:
        self._console = console
        self._stage, self._begin = "", time.monotonic()
        self._told = {self._stage}

    def __call__(self, stage: str, fraction: float) -> None:
        if self._stage not in self._told and time.monotonic() - self._begin > SLOW_SECONDS:
            from addon.bake.job import stage_words

            self._told.add(self._stage)
            self._console.progress(stage_words(self._stage))
        if stage != self._stage:
            self._stage, self._begin = stage, time.monotonic()


@contextmanager
def _own_console() -> Iterator[_Console]:
    """Redirect the output of Blender and its add-ons to a file during the block. Print it if the block raises.

    Blender prints from C, so the file descriptors themselves are redirected.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    kept = [os.dup(1), os.dup(2)]
    streams = [
        open(os.dup(descriptor), "w", encoding=stream.encoding, errors="backslashreplace")  # noqa: SIM115
        for descriptor, stream in zip(kept, (sys.stdout, sys.stderr), strict=True)
    ]
    with tempfile.TemporaryFile() as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        broke = True
        try:
            yield _Console(*streams)
            broke = False
        finally:
            for stream in (sys.stdout, sys.stderr):
                with suppress(OSError):
                    stream.flush()
            for descriptor, number in zip(kept, (1, 2), strict=True):
                os.dup2(descriptor, number)
                os.close(descriptor)
            for stream in streams:
                with suppress(OSError):
                    stream.close()
            if broke:
                log.seek(0)
                _print(log.read().decode(errors="replace"), sys.stderr)


def _status(given: Sequence[str]) -> int:
    """Run the program and return the exit status. Print the traceback of an unexpected error."""
    try:
        return main(given)
    except SystemExit as ended:  # After --help.
        return int(ended.code or 0)
    except Exception:
        with suppress(OSError):
            traceback.print_exc()
        return 1


if __name__ == "__main__":
    leave(_status(arguments()))
