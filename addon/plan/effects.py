"""Which effects a bake carries, and why: each costs time or memory, and is there only when something calls for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..settings import CHANNELS, EFFECTS, MOVING_LIGHT, BakeSettings, effect_names
from .wind import Wind


@dataclass(frozen=True)
class Effect:
    """One effect: `on` is None while it is left to each cloud to decide as it is baked. `reason` is one sentence."""

    name: str
    on: bool | None
    reason: str


@dataclass(frozen=True)
class Facts:
    """What the plan looks at: the engine that draws the tree, how much there is of it, what lights do there."""

    engine: str
    leaves: int = 0
    wood: int = 0
    """Triangles of trunk and branches."""
    glossy: str | None = None
    """A leaf material in which lights are seen mirrored, other than in the others or all over it."""
    translucent: str | None = None
    """A leaf material through which light shines."""
    wind: Wind | None = None
    """What the scene's force fields blow on the tree."""


def plan_effects(settings: BakeSettings, facts: Facts) -> tuple[Effect, ...]:
    """The effects in the order of `EFFECTS`: as the settings force them, else as the facts call for them."""
    if settings.effects == "auto":
        seen = (_transitions(facts), _pruning(facts), _back_sides(), _trunk_levels(facts))
        read = (_normals(facts), _gloss(facts), _translucency(facts))
        return (*seen, *read, *_SKY, _LEAF_MAP, _contrast(settings, facts), _wind(facts), _BAKED_LIGHT)
    forced = {"all": MOVING_LIGHT, "none": ()}.get(settings.effects, effect_names(settings.effects))
    asked = tuple(Effect(name, name in forced, f"asked for by --effects {settings.effects}") for name in EFFECTS)
    if settings.effects == "all":
        left_out = replace(_BAKED_LIGHT, reason=f"{_BAKED_LIGHT.reason}, not by --effects all")
        return tuple(left_out if effect.name == left_out.name else effect for effect in asked)
    return tuple(map(_under_baked_light, asked)) if "baked_light" in forced else asked


def plan_channels(settings: BakeSettings, facts: Facts) -> tuple[str, ...]:
    """The channels that are read from the materials; it does not matter how many leaves there are.

    Occlusion shares a texture with gloss, and needs it whole.
    """
    on = {effect.name for effect in plan_effects(settings, facts) if effect.on}
    if on & {"occlusion", "self_shadowing"}:
        on.add("gloss")
    return tuple(name for name in CHANNELS if name in on)


def settle_back_sides(effects: Sequence[Effect], two_sided: Sequence[int]) -> tuple[Effect, ...]:
    """The effects after the bake, where `two_sided` holds the numbers of the levels that kept both sides."""
    return tuple(_settled(effect, two_sided) if effect.on is None else effect for effect in effects)


def is_on(effects: Sequence[Effect], name: str) -> bool | None:
    """Whether the effect `name` is on; None while it is undecided. Raises `KeyError` for a name that is not planned."""
    for effect in effects:
        if effect.name == name:
            return effect.on
    raise KeyError(name)


def first_on(effects: Sequence[Effect], names: Sequence[str]) -> str:
    """The first of `names` whose effect is on; the first of all when none is."""
    return next((name for name in names if is_on(effects, name)), names[0])


def _transitions(facts: Facts) -> Effect:
    return Effect("transitions", True, f"{_free_camera(facts.engine)}, so it sees levels take over from one another")


def _pruning(facts: Facts) -> Effect:
    if facts.leaves == 1:
        return Effect("pruning", False, "the foliage is one leaf, there is nothing to prune")
    return Effect("pruning", True, f"{_free_camera(facts.engine)}, so it may see {facts.leaves} leaves from far away")


def _back_sides() -> Effect:
    return Effect("back_sides", None, "each level keeps a texture of its own for the back where the two sides differ")


def _trunk_levels(facts: Facts) -> Effect:
    if facts.wood == 0:
        return Effect("trunk_levels", False, "there is no wood beside the leaves")
    reason = f"{_free_camera(facts.engine)}, so it may see {facts.wood} triangles of wood from far away"
    return Effect("trunk_levels", True, reason)


def _normals(facts: Facts) -> Effect:
    return Effect("normals", True, f"{_free_light(facts.engine)}, so the billboards are lit as their leaves would be")


def _gloss(facts: Facts) -> Effect:
    if facts.glossy is None:
        return Effect("gloss", False, "all leaves are equally glossy, which takes a number and no texture")
    return Effect("gloss", True, f"lights are mirrored in the material {facts.glossy!r} otherwise than elsewhere")


def _translucency(facts: Facts) -> Effect:
    if facts.translucent is None:
        return Effect("translucency", False, "no light shines through the leaves' materials")
    reason = f"{_free_light(facts.engine)}, and it shines through the material {facts.translucent!r}"
    return Effect("translucency", True, reason)


def _contrast(settings: BakeSettings, facts: Facts) -> Effect:
    if settings.chain == "billboards" or facts.leaves == 1:
        return Effect("contrast", False, "no leaf is pruned before the first cloud takes over")
    return Effect("contrast", True, "pruned leaves grow, and large leaves would make far crowns coarser than they are")


def _wind(facts: Facts) -> Effect:
    if facts.wind is None:
        return Effect("wind", False, "no force field blows on the tree")
    blows = "turbulence shakes" if facts.wind.field is None else f"the force field {facts.wind.field!r} blows on"
    return Effect("wind", True, f"{blows} the tree")


_SKY = (
    Effect("occlusion", False, "the leaves have none of their own, so it would show where billboards take over"),
    Effect(
        "self_shadowing", False, "renderers cast shadows themselves, and only a shader made for it reads the texture"
    ),
)

_LEAF_MAP = Effect("leaf_map", False, "the leaves keep their textures until somebody wants another season")


_BAKED_LIGHT = Effect(
    "baked_light", False, "the light would have to stand still, which no file says, so it has to be asked for by name"
)


def _under_baked_light(effect: Effect) -> Effect:
    """Sides differ in their light; what only counts where light may move is left out, even if it is asked for."""
    if effect.name == "back_sides":
        return replace(effect, on=True, reason="the light is baked in, and differs on the two sides of a leaf")
    if effect.name == "contrast":
        return replace(effect, on=False, reason="the light is baked in, and would not be pulled toward a mean")
    if effect.name == "leaf_map":
        return replace(effect, on=False, reason="the light is baked into the page, and another texture would have none")
    if effect.name in _FOR_MOVING_LIGHT:
        return replace(effect, on=False, reason="the light is baked in, so there is none left to answer to")
    return effect


_FOR_MOVING_LIGHT = (*CHANNELS, "occlusion", "self_shadowing")


def _free_light(engine: str) -> str:
    return "light may come from anywhere" if engine == "generic" else f"light may come from anywhere in {engine}"


def _free_camera(engine: str) -> str:
    return "the camera may be anywhere" if engine == "generic" else f"the camera may be anywhere in {engine}"


def _settled(effect: Effect, two_sided: Sequence[int]) -> Effect:
    if not two_sided:
        return replace(effect, on=False, reason="the two sides of every level look alike")
    levels = ", ".join(str(level) for level in two_sided)
    return replace(effect, on=True, reason=f"the two sides differ on level {levels}")
