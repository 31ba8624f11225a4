"""The interface: operators, their panels in the 3D view's sidebar, and the settings that both show."""

from __future__ import annotations

import bpy

from .curve import LEAFCLOUD_OT_curve, LEAFCLOUD_OT_pick, LEAFCLOUD_PT_curve, forget_curve
from .forest_panel import LEAFCLOUD_OT_forest, LEAFCLOUD_PT_forest, LeafcloudForestSettings
from .job_operator import cancel_running
from .operators import LEAFCLOUD_OT_bake, LEAFCLOUD_OT_plan
from .panels import LEAFCLOUD_PT_bake, LEAFCLOUD_PT_effects
from .properties import LeafcloudPlanRow, LeafcloudSettings, LeafcloudStatus
from .scene_panel import LEAFCLOUD_OT_scene, LEAFCLOUD_PT_scene, LeafcloudSceneSettings
from .viewport import LEAFCLOUD_OT_preview, add_handlers, remove_handlers, stop_preview

_OF_SCENE = {
    "leafcloud": LeafcloudSettings,
    "leafcloud_scene": LeafcloudSceneSettings,
    "leafcloud_forest": LeafcloudForestSettings,
}
_CLASSES = (
    *(*_OF_SCENE.values(), LeafcloudPlanRow, LeafcloudStatus),
    *(LEAFCLOUD_OT_bake, LEAFCLOUD_OT_plan, LEAFCLOUD_OT_preview, LEAFCLOUD_OT_scene, LEAFCLOUD_OT_forest),
    *(LEAFCLOUD_OT_curve, LEAFCLOUD_OT_pick),
    *(LEAFCLOUD_PT_bake, LEAFCLOUD_PT_curve, LEAFCLOUD_PT_effects, LEAFCLOUD_PT_scene, LEAFCLOUD_PT_forest),
)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    for name, settings in _OF_SCENE.items():
        setattr(bpy.types.Scene, name, bpy.props.PointerProperty(type=settings))
    bpy.types.WindowManager.leafcloud = bpy.props.PointerProperty(type=LeafcloudStatus)
    add_handlers()


def unregister() -> None:
    cancel_running()
    stop_preview()
    remove_handlers()
    forget_curve()
    del bpy.types.WindowManager.leafcloud
    for name in _OF_SCENE:
        delattr(bpy.types.Scene, name)
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
