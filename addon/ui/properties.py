"""The settings as Blender's properties, with the limits and defaults of `BakeSettings`.

The property groups have no methods: Blender 4.2 never lets go of a group's class, and by a method's globals that would
keep bpy itself alive at exit, which crashes.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ..plan.effects import Effect
from ..settings import (
    EFFECTS,
    ENGINES,
    LARGEST_TEXTURE,
    MOST_CANDIDATES,
    MOST_LEVELS,
    SMALLEST_TEXTURE,
    BakeSettings,
)

AUTO, ON, OFF = "AUTO", "ON", "OFF"

_DEFAULTS = BakeSettings()
_LARGEST_INT = 2**31 - 1
_DIGITS = 6
"""After the point: properties are single precision, and 0.04 has to mean what it means on the command line."""

# Blender evaluates the annotations below: in them a comprehension sees no names of this module.
_EFFECT_ITEMS = [
    (AUTO, "Auto", "Where the scene calls for it"),
    (ON, "On", "In any case"),
    (OFF, "Off", "In no case"),
]
_VIEWER_ITEMS = [
    ("camera", "Camera", "The scene's cameras, over all frames, unless the files are for an engine"),
    ("anywhere", "Anywhere", "The viewer may come and go as far as there are levels"),
]
_ENGINE_ITEMS = [(name, name.title(), "") for name in ENGINES]


_EFFORT_ITEMS = [
    ("literal", "Literal", "The published algorithm, for comparison"),
    ("default", "Default", "All offsets of all directions, greedily: a fraction of a second"),
    ("final", "Final", "Then a search for fewer billboards: seconds"),
    ("best", "Best", "The same, ten times as long"),
]


_CHAIN_ITEMS = [
    ("billboards", "Billboards", "All leaves until the first cloud takes over"),
    ("pruning", "Pruning", "Ever fewer leaves, then the cross"),
    ("both", "Both", "Fewer leaves on the way to a first cloud of those that are left"),
]


def effect_property(name: str) -> str:
    """The property that forces the effect `name` on or off, or leaves it to the plan."""
    return f"effect_{name}"


class LeafcloudSettings(bpy.types.PropertyGroup):
    """What the next bake of this scene is asked to do."""

    leaves: StringProperty(
        name="Leaves",
        description="Objects or materials that are leaves, with commas between; empty: found by name or by shape",
    )
    epsilon: FloatProperty(
        name="Error Bound",
        description="How far a leaf may move along its billboard's normal, as a share of the crown's radius",
        default=_DEFAULTS.epsilon,
        min=0.001,
        max=1.0,
        soft_max=0.2,
        precision=3,
        step=1,
    )
    levels: IntProperty(
        name="Levels",
        description="Billboard clouds behind the leaves",
        default=_DEFAULTS.levels,
        min=1,
        max=MOST_LEVELS,
        soft_max=4,
    )
    cross: BoolProperty(
        name="Cross",
        description="Add crossed billboards of the whole tree behind the clouds",
        default=_DEFAULTS.cross,
    )
    texture_size: IntProperty(
        name="Texture Size",
        description="Side of the first cloud's atlas in texels; halved with every level",
        default=_DEFAULTS.texture_size,
        min=SMALLEST_TEXTURE,
        max=LARGEST_TEXTURE,
    )
    pixels: FloatProperty(
        name="Switch Error",
        description="A level takes over where its error is seen smaller than this many pixels",
        default=_DEFAULTS.pixels,
        min=0.1,
        soft_max=32.0,
    )
    chain: EnumProperty(
        name="Chain",
        description="How the levels follow one another",
        items=_CHAIN_ITEMS,
        default=_DEFAULTS.chain,
    )
    prune_pixels: FloatProperty(
        name="Prune Below",
        description="Leaves are pruned where one is seen smaller than this many pixels",
        default=_DEFAULTS.prune_pixels,
        min=0.1,
        soft_max=64.0,
    )
    prune_half: FloatProperty(
        name="Half Left",
        description="Half of the leaves are left at the distance where pruning begins, divided by this",
        default=_DEFAULTS.prune_half,
        min=0.01,
        max=0.5,
    )
    close_cracks: BoolProperty(
        name="Close Cracks",
        description="Billboards also show the parts of other billboards' leaves that lie within the error bound",
        default=_DEFAULTS.close_cracks,
    )
    candidates: IntProperty(
        name="Candidates",
        description="Planes tried per billboard: more make fewer billboards, and take longer",
        default=_DEFAULTS.candidates,
        min=1,
        max=MOST_CANDIDATES,
        soft_max=2000,
    )
    samples: IntProperty(
        name="Samples",
        description="Of each texel, along each of its sides: more make smoother textures, and take longer",
        default=_DEFAULTS.samples,
        min=1,
        max=16,
    )
    seconds: FloatProperty(
        name="Seconds",
        description="Make the levels as good as possible in so many seconds, choosing error bound, texture, samples "
        "and effort; 0: as those say",
        default=0.0,
        min=0.0,
        soft_max=600.0,
        precision=1,
    )
    image_error: FloatProperty(
        name="Image Error",
        description="Make the levels as quickly as possible with at most this image error, choosing likewise; 0: as "
        "the settings say",
        default=0.0,
        min=0.0,
        max=0.999,
        precision=3,
        step=1,
    )
    effort: EnumProperty(
        name="Effort",
        description="How long to search for few billboards",
        items=_EFFORT_ITEMS,
        default=_DEFAULTS.effort,
    )
    max_billboards: IntProperty(
        name="Most Billboards",
        description="At most so many on the first level, at the smallest error bound found; 0: as the error bound asks",
        default=0,
        min=0,
        max=_LARGEST_INT,
        soft_max=1000,
    )
    max_corners: IntProperty(
        name="Corners",
        description="Corners of a billboard's outline: 4 gives rectangles, more leave less of it empty",
        default=_DEFAULTS.max_corners,
        min=3,
        max=16,
    )
    bend_normals: FloatProperty(
        name="Bend Normals",
        description="How far the billboards' normals are bent toward the hull of the crown, as foliage is often shaded",
        default=_DEFAULTS.bend_normals,
        min=0.0,
        max=1.0,
    )
    seed: IntProperty(
        name="Seed", description="Of every random choice", default=_DEFAULTS.seed, min=0, max=_LARGEST_INT
    )
    engine: EnumProperty(
        name="Engine",
        description="Which engine the glTF files are meant for",
        items=_ENGINE_ITEMS,
        default=_DEFAULTS.engine,
    )
    viewer: EnumProperty(
        name="Viewer",
        description="Who looks at the levels",
        items=_VIEWER_ITEMS,
        default=_DEFAULTS.viewer,
    )
    unlit: BoolProperty(
        name="Unlit",
        description="What draws the levels shows their colours as they are: light that stands still is baked into them",
        default=_DEFAULTS.unlit,
    )
    directory: StringProperty(
        name="Folder",
        description="Where to write the levels as glTF, with preview and report; empty: nothing is written",
        subtype="DIR_PATH",
    )


for _name in EFFECTS:
    LeafcloudSettings.__annotations__[effect_property(_name)] = EnumProperty(
        name=_name.replace("_", " ").title(),
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
    """What the bake that runs now is doing; `stage` is empty while none runs. `plan` is the last one, or empty."""

    stage: StringProperty(options={"SKIP_SAVE"})
    fraction: FloatProperty(options={"SKIP_SAVE"}, min=0.0, max=1.0)
    plan: CollectionProperty(type=LeafcloudPlanRow, options={"SKIP_SAVE"})


def show_plan(status: LeafcloudStatus, effects: Sequence[Effect]) -> None:
    """Puts the effects into the table."""
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
    return BakeSettings(
        epsilon=round(properties.epsilon, _DIGITS),
        candidates=properties.candidates,
        levels=properties.levels,
        effort=properties.effort,
        samples=properties.samples,
        seconds=round(properties.seconds, _DIGITS) or None,
        image_error=round(properties.image_error, _DIGITS) or None,
        max_billboards=properties.max_billboards or None,
        max_corners=properties.max_corners,
        bend_normals=round(properties.bend_normals, _DIGITS),
        seed=properties.seed,
        texture_size=properties.texture_size,
        cross=properties.cross,
        effects=",".join(["auto", *forced]),
        engine=properties.engine,
        viewer=properties.viewer,
        unlit=properties.unlit,
        pixels=round(properties.pixels, _DIGITS),
        chain=properties.chain,
        prune_pixels=round(properties.prune_pixels, _DIGITS),
        prune_half=round(properties.prune_half, _DIGITS),
        close_cracks=properties.close_cracks,
    )


def leaf_names(properties: LeafcloudSettings) -> list[str] | None:
    """The names given as leaves; None to let them be found."""
    return [name.strip() for name in properties.leaves.split(",") if name.strip()] or None
