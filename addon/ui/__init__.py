"""The interface: an operator, a panel in the 3D view's sidebar, and the settings that both show."""

from __future__ import annotations

import bpy

from .curve import LEAFCLOUD_OT_curve, LEAFCLOUD_OT_pick, LEAFCLOUD_PT_curve, forget_curve
from .operators import LEAFCLOUD_OT_bake, cancel_running
from .panels import LEAFCLOUD_PT_bake
from .properties import LeafcloudSettings, LeafcloudStatus

_CLASSES = (
    LeafcloudSettings,
    LeafcloudStatus,
    LEAFCLOUD_OT_bake,
    LEAFCLOUD_OT_curve,
    LEAFCLOUD_OT_pick,
    LEAFCLOUD_PT_bake,
    LEAFCLOUD_PT_curve,
)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.leafcloud = bpy.props.PointerProperty(type=LeafcloudSettings)
    bpy.types.WindowManager.leafcloud = bpy.props.PointerProperty(type=LeafcloudStatus)


def unregister() -> None:
    cancel_running()
    forget_curve()
    del bpy.types.WindowManager.leafcloud
    del bpy.types.Scene.leafcloud
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
