"""The interface: operators, panels in the 3D view's sidebar, and their settings."""

from __future__ import annotations

import bpy

from ..viewport.eye import follow_views, stop_following
from .billboard_leaves import LEAFCLOUD_OT_select_billboard
from .curve import LEAFCLOUD_OT_curve, LEAFCLOUD_OT_pick, LEAFCLOUD_PT_curve, forget_curve
from .draft import HANDLERS as DRAFT_HANDLERS
from .export import LEAFCLOUD_OT_export, LEAFCLOUD_OT_write_files
from .forest_export import LEAFCLOUD_OT_export_forest
from .forest_panel import LEAFCLOUD_OT_forest, LEAFCLOUD_PT_forest, LeafcloudForestSettings
from .framing import LEAFCLOUD_OT_frame_level
from .handlers import add_handlers, remove_handlers
from .import_folder import LEAFCLOUD_OT_import_folder
from .job_operator import LEAFCLOUD_OT_cancel, cancel_running
from .menu import LEAFCLOUD_MT_object, add_menu, remove_menu
from .new_instances import HANDLERS as INSTANCE_HANDLERS
from .new_instances import stop_offers
from .operators import LEAFCLOUD_OT_bake, LEAFCLOUD_OT_plan
from .panels import (
    LEAFCLOUD_PT_bake,
    LEAFCLOUD_PT_effects,
    LEAFCLOUD_PT_levels,
    LEAFCLOUD_PT_output,
    LEAFCLOUD_PT_search,
    LEAFCLOUD_PT_textures,
)
from .place import (
    LEAFCLOUD_OT_asset,
    LEAFCLOUD_OT_place,
    LEAFCLOUD_OT_place_instances,
    LEAFCLOUD_OT_show_placed_level,
    LEAFCLOUD_PT_place,
)
from .preferences import LeafcloudPreferences
from .presets import LEAFCLOUD_OT_preset_add, LEAFCLOUD_PT_presets, register_presets, unregister_presets
from .properties import LeafcloudPlanRow, LeafcloudSettings, LeafcloudStatus, show_nothing
from .rendering import LEAFCLOUD_OT_mend_rendering
from .sample import LEAFCLOUD_OT_sample
from .scene_panel import LEAFCLOUD_OT_scene, LEAFCLOUD_PT_scene, LeafcloudSceneSettings
from .selected_tree import HANDLERS as SELECTION_HANDLERS
from .selected_tree import forget_selection
from .tree_panel import LEAFCLOUD_OT_remove, LEAFCLOUD_OT_show_level, LEAFCLOUD_PT_tree
from .trees_panel import LEAFCLOUD_OT_select_tree, LEAFCLOUD_PT_trees
from .views import HANDLERS as VIEW_HANDLERS
from .views import LEAFCLOUD_OT_labels, stop_labels

_OF_SCENE = {
    "leafcloud": LeafcloudSettings,
    "leafcloud_scene": LeafcloudSceneSettings,
    "leafcloud_forest": LeafcloudForestSettings,
}
_CLASSES = (
    *(*_OF_SCENE.values(), LeafcloudPlanRow, LeafcloudStatus),
    *(LEAFCLOUD_OT_bake, LEAFCLOUD_OT_plan, LEAFCLOUD_OT_labels, LEAFCLOUD_OT_scene, LEAFCLOUD_OT_forest),
    LEAFCLOUD_OT_export_forest,
    *(LEAFCLOUD_OT_curve, LEAFCLOUD_OT_pick, LEAFCLOUD_OT_preset_add),
    *(LEAFCLOUD_OT_show_level, LEAFCLOUD_OT_frame_level, LEAFCLOUD_OT_show_placed_level),
    *(LEAFCLOUD_OT_remove, LEAFCLOUD_OT_mend_rendering, LEAFCLOUD_OT_cancel),
    *(LEAFCLOUD_OT_export, LEAFCLOUD_OT_write_files, LEAFCLOUD_OT_select_tree),
    *(LEAFCLOUD_OT_place, LEAFCLOUD_OT_asset, LEAFCLOUD_OT_place_instances, LEAFCLOUD_OT_select_billboard),
    *(LeafcloudPreferences, LEAFCLOUD_MT_object, LEAFCLOUD_OT_sample, LEAFCLOUD_OT_import_folder),
    *(LEAFCLOUD_PT_presets, LEAFCLOUD_PT_bake),
    *(LEAFCLOUD_PT_levels, LEAFCLOUD_PT_textures, LEAFCLOUD_PT_search, LEAFCLOUD_PT_effects, LEAFCLOUD_PT_output),
    *(
        LEAFCLOUD_PT_tree,
        LEAFCLOUD_PT_trees,
        LEAFCLOUD_PT_place,
        LEAFCLOUD_PT_curve,
        LEAFCLOUD_PT_scene,
        LEAFCLOUD_PT_forest,
    ),
)


def _forget_file(*_: object) -> None:
    """Forget the previous file. Blender keeps modules and the window manager when it opens another file."""
    forget_curve()
    forget_selection()
    show_nothing(bpy.context.window_manager.leafcloud)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    for name, settings in _OF_SCENE.items():
        setattr(bpy.types.Scene, name, bpy.props.PointerProperty(type=settings))
    bpy.types.WindowManager.leafcloud = bpy.props.PointerProperty(type=LeafcloudStatus)
    register_presets()
    add_menu()
    add_handlers(VIEW_HANDLERS, INSTANCE_HANDLERS, DRAFT_HANDLERS, SELECTION_HANDLERS, (("load_post", _forget_file),))
    follow_views()


def unregister() -> None:
    remove_handlers()
    stop_offers()
    cancel_running()
    stop_labels()
    stop_following()
    remove_menu()
    unregister_presets()
    forget_curve()
    del bpy.types.WindowManager.leafcloud
    for name in _OF_SCENE:
        delattr(bpy.types.Scene, name)
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
