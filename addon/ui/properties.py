"""Blender properties made from the definitions in `BakeSettings`.

The property groups have no methods. Blender 4.2 never frees the class of a group. The globals of a method would keep
bpy alive at exit, and Blender would crash.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ..plan.decision import Decision
from ..plan.effects import CameraNote
from ..plan.registry import effect_named
from ..settings.bake import BakeSettings, described
from ..settings.effects import EFFECTS, asked_effects
from ..settings.naming import with_names
from ..settings.setting import NamedSetting, SettingsError
from ..versions import blend_relative_path

AUTO, ON, OFF = "AUTO", "ON", "OFF"

_LARGEST_INT = 2**31 - 1
_DIGITS = 6
"""Decimals kept of a float property. Properties are single precision, but 0.04 must equal the command line's 0.04."""

_SWITCH = {"True": "On", "False": "Off"}

# Blender evaluates the annotations below. A comprehension inside them cannot see the names of this module.
_EFFECT_ITEMS = [
    (AUTO, "Auto", "Add the effect if the scene needs it"),
    (ON, "On", "Always add the effect"),
    (OFF, "Off", "Never add the effect"),
]


@dataclass(frozen=True)
class _Shown:
    """Display of a setting in the interface: its label, the end of its slider and its number of decimals.

    choices: labels of choices that differ from the choice in title case.
    """

    label: str
    slider: float | None = None
    digits: int = 2
    choices: Mapping[str, str] = field(default_factory=dict)

    def choice(self, value: str) -> str:
        """Return the label of one of the setting's choices, or of a switch's values."""
        return {**_SWITCH, **self.choices}.get(value, value.title())


ENGINE_LABELS = {"generic": "Blender, glTF", "three": "three.js", "babylon": "Babylon.js"}
"""Labels of engines, where they differ from the capitalized name."""

_SHOWN = {
    "quality": _Shown("Quality"),
    "sizes": _Shown("Sizes"),
    "scene": _Shown("Horizon", slider=500.0, digits=0),
    "memory_budget": _Shown("Memory", slider=64.0, digits=1),
    "form": _Shown("Form"),
    "epsilon": _Shown("Error Bound", slider=0.2, digits=3),
    "levels": _Shown("Levels", slider=4),
    "cross": _Shown("Impostor"),
    "last": _Shown("Impostor As"),
    "triangles": _Shown("Triangles", slider=10000),
    "every_level": _Shown("Every Level"),
    "texture_size": _Shown("Texture Width"),
    "texture_height": _Shown("Texture Height"),
    "samples": _Shown("Samples"),
    "pixels": _Shown("Switch Error", slider=32.0),
    "close_gaps": _Shown("Close Gaps"),
    "refine": _Shown("Refine"),
    "chain": _Shown("Chain"),
    "prune_pixels": _Shown("Prune Below", slider=64.0),
    "prune_half": _Shown("Prune Half"),
    "seconds": _Shown("Seconds", slider=600.0, digits=1),
    "image_error": _Shown("Image Error", digits=3),
    "effort": _Shown("Effort"),
    "max_billboards": _Shown("Max Billboards", slider=1000),
    "max_corners": _Shown("Corners"),
    "min_visibility": _Shown("Min Visibility", digits=3),
    "candidates": _Shown("Candidates", slider=2000),
    "bend_normals": _Shown("Bend Normals"),
    "seed": _Shown("Seed"),
    "trees": _Shown("Trees"),
    "engine": _Shown("For", choices=ENGINE_LABELS),
    "compress": _Shown("Compress Meshes"),
    "files": _Shown("Files", choices={"chain": "Few", "levels": "Each Level", "all": "All"}),
    "viewer": _Shown("Viewer", choices={"camera": "Only This View"}),
    "unlit": _Shown("Unlit"),
}
"""Settings in the interface. The command line has all settings."""


_OTHERS = {
    **{"leaves": "Leaves", "out": "Folder", "effects": "Effects"},
    **{"up": "the Up axis of Blender's own importer", "alpha": "in the Shader Editor"},
}
"""Words for what messages name beside the settings."""


def effect_property(name: str) -> str:
    """Return the name of the property that forces the effect `name` on or off, or leaves it to the plan."""
    return f"effect_{name}"


def effect_label(name: str) -> str:
    """Return the label of the effect `name`, short enough for the sidebar."""
    return "Roughness" if name == "roughness_metallic" else name.replace("_", " ").title()


def with_labels(message: str) -> str:
    """Replace every setting named in the message by its label."""
    return with_names(message, _label_words)


def _label_words(name: str, value: str | None) -> str | None:
    if name in _SHOWN:
        shown = _SHOWN[name]
        return shown.label if value is None else f"{shown.label}: {shown.choice(value)}"
    if name == "effects" and value is not None and (forced := asked_effects(value).forced):
        return ", ".join(f"{effect_label(effect)}: {'On' if on else 'Off'}" for effect, on in forced.items())
    # A message of the core may name a setting that only the command line has. It has no label, so use its name.
    hidden = name.replace("_", " ") if name in {each.name for each in described()} else None
    return _OTHERS.get(name, hidden)


PRESET_SETTINGS = (
    *(name for name in _SHOWN if name not in ("seed", "trees", "engine", "compress", "files")),
    *map(effect_property, EFFECTS),
)
"""Properties that a preset holds: not those of one tree, one file or one purpose."""


class LeafcloudSettings(bpy.types.PropertyGroup):
    """Settings of the next bake of this scene."""

    leaves: StringProperty(
        name=_OTHERS["leaves"],
        description="Objects or materials that are leaves, separated by commas. Empty: found by name or shape",
    )
    directory: StringProperty(
        name=_OTHERS["out"],
        description="Folder for the levels as glTF files, a preview and a report. Empty: write no files",
        subtype="DIR_PATH",
        options=blend_relative_path(),
    )


def _property(each: NamedSetting, shown: _Shown) -> Any:
    setting = each.setting
    said: dict[str, Any] = {"name": shown.label, "description": _sentence(with_labels(setting.about))}
    if setting.choices:
        items = [(name, shown.choice(name), _sentence(with_labels(what))) for name, what in setting.choices.items()]
        return EnumProperty(items=items, default=each.default, **said)
    if each.type is bool:
        return BoolProperty(default=each.default, **said)
    if setting.many:
        said["description"] = f"{said['description']}. In percent, such as 50 25 10. Empty: {setting.unset}"
        return StringProperty(**said)
    limits = setting.limits
    assert limits is not None, each.name
    low, high = limits.low, limits.high
    if each.default is None:  # 0 means unset.
        low, said["description"] = 0, f"{said['description']}. 0: {setting.unset}"
    elif each.type is float and (limits.above or low > 0.0):
        low = max(low, 10.0**-shown.digits)  # The field shows no smaller number.
    if each.type is int:
        high = int(min(high, _LARGEST_INT))
        return IntProperty(
            default=each.default or 0, min=int(low), max=high, soft_max=int(shown.slider or high), **said
        )
    if limits.below:
        high -= 10.0**-shown.digits
    if high < math.inf:
        said["max"] = high
    if shown.slider is not None:
        said["soft_max"] = shown.slider
    # Blender gives steps in hundredths. One step is ten units of the last decimal.
    step = 10 ** (3 - shown.digits)
    return FloatProperty(default=each.default or 0.0, min=low, precision=shown.digits, step=step, **said)


def _sentence(words: str) -> str:
    """Return `words` with a capital first letter."""
    return words[:1].upper() + words[1:]


for _each in described():
    if _each.name in _SHOWN:
        LeafcloudSettings.__annotations__[_each.name] = _property(_each, _SHOWN[_each.name])
for _name in EFFECTS:
    LeafcloudSettings.__annotations__[effect_property(_name)] = EnumProperty(
        name=effect_label(_name),
        description=effect_named(_name).about,
        items=_EFFECT_ITEMS,
        default=AUTO,
    )


class LeafcloudPlanRow(bpy.types.PropertyGroup):
    """An effect in the last plan. `name` is the name of the effect."""

    state: EnumProperty(items=_EFFECT_ITEMS)
    reason: StringProperty()
    cost: StringProperty()


class LeafcloudStatus(bpy.types.PropertyGroup):
    """State of the running bake, and the last plan.

    stage: stage of the running bake; empty while none runs. fraction, left: its progress, and the time that is left in
    words. plan: the last plan, or empty.
    note: note about the scene's camera, or empty. viewer: the value of the setting Viewer that it offers, or empty.
    """

    stage: StringProperty(options={"SKIP_SAVE"})
    fraction: FloatProperty(options={"SKIP_SAVE"}, min=0.0, max=1.0)
    left: StringProperty(options={"SKIP_SAVE"})
    plan: CollectionProperty(type=LeafcloudPlanRow, options={"SKIP_SAVE"})
    note: StringProperty(options={"SKIP_SAVE"})
    viewer: StringProperty(options={"SKIP_SAVE"})


def show_nothing(status: LeafcloudStatus) -> None:
    """Reset the status to its state before any plan and any bake."""
    show_plan(status, (), ())
    status.stage, status.fraction = "", 0.0


def show_plan(status: LeafcloudStatus, effects: Sequence[Decision], notes: Sequence[CameraNote]) -> None:
    """Show the planned effects and the first note about the camera."""
    first = next(iter(notes), CameraNote(""))
    status.note, status.viewer = _sentence(with_labels(first.text)), first.viewer
    status.plan.clear()
    for effect in effects:
        row = status.plan.add()
        row.name, row.reason = effect.name, effect.reason
        row.state = {True: ON, False: OFF, None: AUTO}[effect.on]
        row.cost = "" if effect.on is False else f"{effect.seconds:.1f} s, {effect.bytes / 1e6:.1f} MB"


def bake_settings(properties: LeafcloudSettings) -> BakeSettings:
    """Return the settings of a bake from the properties."""
    states = {name: getattr(properties, effect_property(name)) for name in EFFECTS}
    forced = [f"{'+' if state == ON else '-'}{name}" for name, state in states.items() if state != AUTO]
    values = {each.name: _value(each, getattr(properties, each.name)) for each in described() if each.name in _SHOWN}
    if not properties.directory:
        values["engine"] = BakeSettings.engine  # Without files no engine reads the levels.
    return BakeSettings(effects=",".join(["auto", *forced]), **values)


def _value(each: NamedSetting, value: Any) -> Any:
    """Return the setting's value for a property's value."""
    if each.setting.many:
        return _fractions(value)
    if each.type is float:
        value = round(value, _DIGITS)
    return value or None if each.default is None else value


def _fractions(text: str) -> tuple[float, ...]:
    """Return the numbers of a text in percent, as fractions. Raise `SettingsError` for other text."""
    try:
        return tuple(round(float(word.rstrip("%")) / 100.0, _DIGITS) for word in re.split(r"[\s,;]+", text) if word)
    except ValueError:
        raise SettingsError(f"`sizes` is {text!r}, it must be numbers in percent, such as 50 25 10") from None


def leaf_names(properties: LeafcloudSettings) -> list[str] | None:
    """Return the names given as leaves, or None to find the leaves."""
    return [name.strip() for name in properties.leaves.split(",") if name.strip()] or None
