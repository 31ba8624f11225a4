"""Lines of the panels about settings that show trees wrongly, and the button that mends them."""

from __future__ import annotations

import json
from collections.abc import Sequence

import bpy
from bpy.props import StringProperty
from mathutils import Vector

from ..bake.pipeline import view_of
from ..levels.baked_trees import tree_collections
from ..levels.placed_tree import place_of
from ..levels.results import magnification
from ..levels.root import root_of
from ..mesh.baked_levels import levels_and_trunks
from ..plan.camera_visibility import pixels_of
from ..scene.rendering import Fault, faults, faults_of_all, lens_fault
from .on_tree import InObjectMode
from .wrapped import add_text


class LEAFCLOUD_OT_mend_rendering(InObjectMode, bpy.types.Operator):
    """Change what the lines above name: of the render settings, the camera, the materials and the trees"""

    bl_idname = "leafcloud.mend_rendering"
    bl_label = "Mend"
    bl_options = {"REGISTER", "UNDO"}

    trees: StringProperty(
        name="Trees", description="Names of the trees' collections, as JSON. Empty: all trees of the scene"
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        wanted = set(json.loads(self.trees or "[]"))
        trees = [each for each in tree_collections(context.scene.objects) if not wanted or each.name in wanted]
        for fault in _faults_of(trees, context.scene):
            fault.mend()
        return {"FINISHED"}


def draw_faults(layout: bpy.types.UILayout, context: bpy.types.Context, trees: Sequence[bpy.types.Collection]) -> None:
    """Add a line for each fault, and the button below them."""
    texts = dict.fromkeys(fault.text for fault in _faults_of(trees, context.scene))
    for text in texts:
        add_text(layout, context, text, "ERROR")
    if texts:
        layout.operator("leafcloud.mend_rendering").trees = json.dumps([tree.name for tree in trees])


def _faults_of(trees: Sequence[bpy.types.Collection], scene: bpy.types.Scene) -> list[Fault]:
    """Return what is wrong with each of the trees alone, and with one of them alone also with its place."""
    pixels = pixels_of(1.0, 1.0, view_of(scene))
    roots = ((tree, root_of(tree)) for tree in trees if scene.camera is not None)
    lenses = [fault for tree, root in roots if root for fault in lens_fault(root, magnification(tree, pixels))]
    of_place = _faults_of_tree(trees[0], scene) if len(trees) == 1 else faults_of_all(scene)
    return [*lenses, *of_place]


def _faults_of_tree(tree: bpy.types.Collection, scene: bpy.types.Scene) -> list[Fault]:
    if root_of(tree) is None:
        return []  # Of an earlier version.
    objects = [obj for _, obj in levels_and_trunks(tree.all_objects)]
    materials = [slot.material for obj in objects for slot in obj.material_slots]
    place = place_of(tree)
    corners = [place.to_3x3() @ Vector(corner) for obj in objects for corner in obj.bound_box]
    return faults(scene, place.translation, max((corner.length for corner in corners), default=0.0), materials)
