"""The settings as Blender's properties, made of what `BakeSettings` says of them.

The property groups have no methods: Blender 4.2 never lets go of a group's class, and by a method's globals that would
keep bpy itself alive at exit, which crashes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ..naming import with_names
from ..plan.effects import CameraNote, Effect
from ..setting import Described
from ..settings import EFFECTS, BakeSettings, asked_effects, described
from ..versions import blend_relative_path

AUTO, ON, OFF = "AUTO", "ON", "OFF"

_LARGEST_INT = 2**31 - 1
_DIGITS = 6
"""After the point: properties are single precision, and 0.04 has to mean what it means on the command line."""

# Blender evaluates the annotations below: in them a comprehension sees no names of this module.
_EFFECT_ITEMS = [
    (AUTO, "Auto", "Where the scene calls for it"),
    (ON, "On", "In any case"),
    (OFF, "Off", "In no case"),
]


@dataclass(frozen=True)
class _Shown:
    """How a setting looks in the interface: its label, how far its slider goes, how many digits it has.

    choices: labels of choices that are not just the choice with a capital.
    """

    label: str
    slider: float | None = None
    digits: int = 2
    choices: Mapping[str, str] = field(default_factory=dict)

    def choice(self, value: str) -> str:
        """The label of one of the setting's choices."""
        return self.choices.get(value, value.title())


_SHOWN = {
    "epsilon": _Shown("Error Bound", slider=0.2, digits=3),
    "levels": _Shown("Levels", slider=4),
    "cross": _Shown("Cross"),
    "texture_size": _Shown("Texture Width"),
    "texture_height": _Shown("Texture Height"),
    "samples": _Shown("Samples"),
    "pixels": _Shown("Switch Error", slider=32.0),
    "close_cracks": _Shown("Close Cracks"),
    "chain": _Shown("Chain"),
    "prune_pixels": _Shown("Prune Below", slider=64.0),
    "prune_half": _Shown("Half Left"),
    "seconds": _Shown("Seconds", slider=600.0, digits=1),
    "image_error": _Shown("Image Error", digits=3),
    "effort": _Shown("Effort"),
    "max_billboards": _Shown("Most Billboards", slider=1000),
    "max_corners": _Shown("Corners"),
    "candidates": _Shown("Candidates", slider=2000),
    "bend_normals": _Shown("Bend Normals"),
    "seed": _Shown("Seed"),
    "trees": _Shown("Trees"),
    "engine": _Shown("Engine"),
    "viewer": _Shown("Viewer", choices={"camera": "Only This View"}),
    "unlit": _Shown("Unlit"),
}
"""The settings that the interface has; the others are the command line's."""


_OTHERS = {"leaves": "Leaves", "out": "Folder", "effects": "Effects"}
"""What messages name beside the settings: the labels of two properties and of a panel."""


def effect_property(name: str) -> str:
    """The property that forces the effect `name` on or off, or leaves it to the plan."""
    return f"effect_{name}"


def effect_label(name: str) -> str:
    """How the interface calls the effect `name`."""
    return name.replace("_", " ").title()


def with_labels(message: str) -> str:
    """The message with the label of every setting that it names."""
    return with_names(message, _label_words)


def _label_words(name: str, value: str | None) -> str | None:
    if name in _SHOWN:
        shown = _SHOWN[name]
        return shown.label if value is None else f"{shown.label}: {shown.choice(value)}"
    if name == "effects" and value is not None and (forced := asked_effects(value).forced):
        return ", ".join(f"{effect_label(effect)}: {'On' if on else 'Off'}" for effect, on in forced.items())
    # What only the command line has can be in a message of the core; then its name says what it is.
    hidden = name.replace("_", " ") if name in {each.name for each in described()} else None
    return _OTHERS.get(name, hidden)


class LeafcloudSettings(bpy.types.PropertyGroup):
    """What the next bake of this scene is asked to do."""

    leaves: StringProperty(
        name=_OTHERS["leaves"],
        description="Objects or materials that are leaves, with commas between; empty: found by name or by shape",
    )
    directory: StringProperty(
        name=_OTHERS["out"],
        description="Where to write the levels as glTF, with preview and report; empty: nothing is written",
        subtype="DIR_PATH",
        options=blend_relative_path(),
    )


def _property(each: Described, shown: _Shown) -> Any:
    setting = each.setting
    said: dict[str, Any] = {"name": shown.label, "description": _sentence(with_labels(setting.about))}
    if setting.choices:
        items = [(name, shown.choice(name), _sentence(with_labels(what))) for name, what in setting.choices.items()]
        return EnumProperty(items=items, default=each.default, **said)
    if each.type is bool:
        return BoolProperty(default=each.default, **said)
    limits = setting.limits
    assert limits is not None, each.name
    low, high = limits.low, limits.high
    if each.default is None:  # 0 stands for it
        low, said["description"] = 0, f"{said['description']}; 0: {setting.unset}"
    elif limits.above:
        low += 10.0**-shown.digits
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
    # A step is told in hundredths; ten of the last digit are one.
    step = 10 ** (3 - shown.digits)
    return FloatProperty(default=each.default or 0.0, min=low, precision=shown.digits, step=step, **said)


def _sentence(words: str) -> str:
    """With its first capital."""
    return words[:1].upper() + words[1:]


for _each in described():
    if _each.name in _SHOWN:
        LeafcloudSettings.__annotations__[_each.name] = _property(_each, _SHOWN[_each.name])
for _name in EFFECTS:
    LeafcloudSettings.__annotations__[effect_property(_name)] = EnumProperty(
        name=effect_label(_name),
        description="Whether the levels carry this effect",
        items=_EFFECT_ITEMS,
        default=AUTO,
    )


class LeafcloudPlanRow(bpy.types.PropertyGroup):
    """An effect as it was planned last; its `name` is the effect's."""

    state: EnumProperty(items=_EFFECT_ITEMS)
    reason: StringProperty()
    cost: StringProperty()


class LeafcloudStatus(bpy.types.PropertyGroup):
    """What the bake that runs now is doing; `stage` is empty while none runs. `plan` is the last one, or empty.

    note: what there is to tell of the camera, or empty; viewer: the other value of that setting.
    """

    stage: StringProperty(options={"SKIP_SAVE"})
    fraction: FloatProperty(options={"SKIP_SAVE"}, min=0.0, max=1.0)
    plan: CollectionProperty(type=LeafcloudPlanRow, options={"SKIP_SAVE"})
    note: StringProperty(options={"SKIP_SAVE"})
    viewer: StringProperty(options={"SKIP_SAVE"})


def show_nothing(status: LeafcloudStatus) -> None:
    """As before any plan and any bake."""
    show_plan(status, (), ())
    status.stage, status.fraction = "", 0.0


def show_plan(status: LeafcloudStatus, effects: Sequence[Effect], notes: Sequence[CameraNote]) -> None:
    """Puts the effects into the table, and what there is to tell of the camera into its place."""
    first = next(iter(notes), CameraNote("", ""))
    status.note, status.viewer = _sentence(with_labels(first.text)), first.viewer
    status.plan.clear()
    for effect in effects:
        row = status.plan.add()
        row.name, row.reason = effect.name, effect.reason
        row.state = {True: ON, False: OFF, None: AUTO}[effect.on]
        row.cost = "" if effect.on is False else f"{effect.seconds:.1f} s, {effect.bytes / 1e6:.1f} MB"


def bake_settings(properties: LeafcloudSettings) -> BakeSettings:
    """The settings as a bake takes them."""
    states = {name: getattr(properties, effect_property(name)) for name in EFFECTS}
    forced = [f"{'+' if state == ON else '-'}{name}" for name, state in states.items() if state != AUTO]
    values = {each.name: _value(each, getattr(properties, each.name)) for each in described() if each.name in _SHOWN}
    return BakeSettings(effects=",".join(["auto", *forced]), **values)


def _value(each: Described, value: Any) -> Any:
    """A property's value as the setting has it."""
    if each.type is float:
        value = round(value, _DIGITS)
    return value or None if each.default is None else value


def leaf_names(properties: LeafcloudSettings) -> list[str] | None:
    """The names given as leaves; None to let them be found."""
    return [name.strip() for name in properties.leaves.split(",") if name.strip()] or None
