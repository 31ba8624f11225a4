"""Presets of the bake settings, by Blender's own menu in the panel's header."""

from __future__ import annotations

from pathlib import Path

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from .properties import PRESET_SETTINGS

_FOLDER = str(Path(__file__).resolve().parents[1])
"""The folder with the folder of the presets that come with the add-on."""


class LEAFCLOUD_PT_presets(PresetPanel, bpy.types.Panel):
    bl_label = "Leafcloud Presets"
    preset_subdir = "leafcloud"
    preset_operator = "script.execute_preset"
    preset_add_operator = "leafcloud.preset_add"


class LEAFCLOUD_OT_preset_add(AddPresetBase, bpy.types.Operator):
    """Save the settings of the bake as a preset, or remove one"""

    bl_idname = "leafcloud.preset_add"
    bl_label = "Add Leafcloud Preset"
    preset_menu = "LEAFCLOUD_PT_presets"
    preset_subdir = "leafcloud"
    preset_defines = ["settings = bpy.context.scene.leafcloud"]  # Blender's base class wants a list.
    preset_values = [f"settings.{name}" for name in PRESET_SETTINGS]


def register_presets() -> None:
    bpy.utils.register_preset_path(_FOLDER)


def unregister_presets() -> None:
    bpy.utils.unregister_preset_path(_FOLDER)
