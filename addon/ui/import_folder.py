"""All trees of a folder of files, imported side by side, each into a collection of its own, ready to bake."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import bpy
from bpy.props import StringProperty
from mathutils import Vector

from ..errors import SceneError
from ..levels.rollback import removed_on_failure
from ..scene.load import SUFFIXES, load_beside
from .job_operator import refuse
from .on_tree import InObjectMode
from .properties import with_labels
from .selection import select_only

_GAP = 0.2
"""Space between two trees, as a fraction of the wider one's width."""


class LEAFCLOUD_OT_import_folder(InObjectMode, bpy.types.Operator):
    """Import all files of trees in a folder side by side, and select them. Sets Trees to Collections, so that Bake Levels bakes each"""  # noqa: E501

    bl_idname = "leafcloud.import_folder"
    bl_label = "Import Trees from Folder"
    bl_options = {"REGISTER", "UNDO"}

    directory: StringProperty(name="Folder", description="Folder of the files", subtype="DIR_PATH")
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        folder = Path(bpy.path.abspath(self.directory))
        try:
            files = tree_files(folder)
        except SceneError as error:
            return refuse(self, error)
        trees: list[list[bpy.types.Object]] = []
        for path in files:
            try:
                with removed_on_failure():
                    objects, notes = _imported(context, path)
                    trees.append(objects)
                for note in notes:
                    self.report({"WARNING"}, with_labels(f"{path.name}: {note}"))
            except SceneError as error:
                self.report({"WARNING"}, f"left out: {error}")
        if not trees:
            return refuse(self, SceneError(f"no file in {folder} can be read: export them again"))
        context.view_layer.update()
        made = {obj for tree in trees for obj in tree}
        _in_a_row(trees, [obj for obj in context.view_layer.objects if obj not in made and obj.visible_get()])
        select_only(context, [obj for tree in trees for obj in tree])
        context.scene.leafcloud.trees = "collections"
        self.report({"INFO"}, f"Imported {len(trees)} of {len(files)} files, and set Trees to Collections")
        return {"FINISHED"}


def tree_files(folder: Path) -> list[Path]:
    """Return the files of trees in a folder, by name. Raise `SceneError` if there are none."""
    try:
        files = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file())
    except OSError as error:
        raise SceneError(f"{folder} cannot be read: {error.strerror or error}; choose another folder") from error
    if not files:
        raise SceneError(f"{folder} has no {', '.join(SUFFIXES)} file: choose a folder with trees")
    return files


def _imported(context: bpy.types.Context, path: Path) -> tuple[list[bpy.types.Object], list[str]]:
    """Import a file. Return its objects that are drawn, in a new collection with its name, and notes about the file.

    Importers hide helpers, such as the shapes of bones, and objects of a file's other scenes in collections of their
    own: these stay there.
    """
    known = set(bpy.data.collections)
    objects, notes = load_beside(path)
    context.view_layer.update()
    drawn = [obj for obj in objects if obj.name in context.view_layer.objects and obj.visible_get()]
    if not any(obj.type == "MESH" for obj in drawn):
        raise SceneError(f"{path} has no mesh; choose files of trees")
    collection = bpy.data.collections.new(path.stem)
    context.scene.collection.children.link(collection)
    for obj in drawn:
        for other in list(obj.users_collection):
            other.objects.unlink(obj)
        collection.objects.link(obj)
    for left in [each for each in bpy.data.collections if each not in known and each is not collection]:
        if not left.all_objects:
            bpy.data.collections.remove(left)
    return drawn, notes


def _in_a_row(trees: Sequence[Sequence[bpy.types.Object]], beside: Iterable[bpy.types.Object]) -> None:
    """Move the trees along x so that none stands in another, nor in the objects that are there already."""
    edge = max((corner.x for corner in _corners(beside)), default=None)
    before = 0.0
    for objects in trees:
        own = set(objects)
        across = [corner.x for corner in _corners(objects)]
        low, wide = min(across), max(across) - min(across)
        move = 0.0 if edge is None else edge + _GAP * max(wide, before) - low
        for obj in objects:
            if obj.parent not in own:
                obj.matrix_world.translation.x += move
        edge, before = low + wide + move, wide


def _corners(objects: Iterable[bpy.types.Object]) -> list[Vector]:
    """Return the corners of the boxes around all meshes, in world space."""
    return [obj.matrix_world @ Vector(corner) for obj in objects if obj.type == "MESH" for corner in obj.bound_box]
