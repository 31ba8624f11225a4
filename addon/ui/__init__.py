"""The interface: an operator, a panel in the 3D view's sidebar, and the settings that both show."""

from __future__ import annotations

import bpy

from .operators import LEAFCLOUD_OT_bake, LEAFCLOUD_OT_plan, cancel_running
from .panels import LEAFCLOUD_PT_bake, LEAFCLOUD_PT_effects
from .properties import LeafcloudPlanRow, LeafcloudSettings, LeafcloudStatus
from .viewport import LEAFCLOUD_OT_preview, stop_preview

_CLASSES = (
    LeafcloudSettings,
    LeafcloudPlanRow,
    LeafcloudStatus,
    LEAFCLOUD_OT_bake,
    LEAFCLOUD_OT_plan,
    LEAFCLOUD_OT_preview,
    LEAFCLOUD_PT_bake,
    LEAFCLOUD_PT_effects,
)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.leafcloud = bpy.props.PointerProperty(type=LeafcloudSettings)
    bpy.types.WindowManager.leafcloud = bpy.props.PointerProperty(type=LeafcloudStatus)


def unregister() -> None:
    cancel_running()
    stop_preview()
    del bpy.types.WindowManager.leafcloud
    del bpy.types.Scene.leafcloud
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
