"""The plan of a bake's effects. Each effect costs time or memory, so it is on only where the scene needs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..settings.bake import BakeSettings
from .camera_visibility import camera_visibility
from .decision import Decision, is_on
from .effect import Effect
from .facts import Facts
from .registry import all_effects, effect_named
from .situation import Situation


def plan_effects(settings: BakeSettings, facts: Facts) -> tuple[Decision, ...]:
    """Return the decision on each effect. The settings override the rules, which look at the facts."""
    situation = Situation.of(settings, facts)
    decisions = tuple(_decision(effect, situation) for effect in all_effects())
    return tuple(map(_under_baked_light, decisions)) if is_on(decisions, "baked_light") else decisions


def on_effects(decisions: Sequence[Decision]) -> tuple[Effect, ...]:
    """Return the effects that are on."""
    return tuple(effect_named(decision.name) for decision in decisions if decision.on)


def plan_channels(settings: BakeSettings, facts: Facts) -> tuple[str, ...]:
    """Return the channels to read from the leaf materials."""
    read = (channel for effect in on_effects(plan_effects(settings, facts)) for channel in effect.reads)
    return tuple(sorted(set(read)))


def plan_levels(settings: BakeSettings, facts: Facts, effects: Sequence[Decision]) -> tuple[int, bool]:
    """Return the number of billboard clouds to make, and whether to make the cross impostor.

    Without the effect far_levels, a bake stops at the last level that a camera sees, but not before level 1. If the
    viewer may be anywhere, it stops at level 1.
    """
    clouds = 0 if settings.chain == "pruning" else settings.levels
    if is_on(effects, "far_levels"):
        return clouds, settings.cross
    seen = camera_visibility(settings, facts)
    last = 1 if seen is None else max(seen.last, 1)
    return min(clouds, last), settings.cross and last > clouds


@dataclass(frozen=True)
class CameraNote:
    """A note on the camera's influence on the levels.

    viewer: the value of the setting `viewer` that undoes it; empty if none does.
    """

    text: str
    viewer: str = ""


def camera_note(settings: BakeSettings, facts: Facts, effects: Sequence[Decision]) -> CameraNote | None:
    """Return a note on what the scene's camera changed in the plan, with the reason; None if there is nothing to tell.

    The note tells which levels are left out, that only one level is shown, or that the plan ignores a still camera.
    """
    situation = Situation.of(settings, facts)
    far_levels, transitions = effect_named("far_levels"), effect_named("transitions")
    if settings.viewer == "camera" and not settings.by_cameras:
        text = f"`engine={settings.engine}` may show the tree from anywhere, so all levels are made"
        return CameraNote(text)
    if settings.viewer == "camera" and facts.scene_camera is None:
        return CameraNote("no camera of the scene sees the tree, so all levels are made")
    if situation.stands_still and far_levels.asked(situation.asked) is None:
        return CameraNote("the camera stands still, so all levels are made", "camera")
    if situation.seen is None:
        return None
    said = []
    clouds, cross = plan_levels(settings, facts, effects)
    planned = 0 if settings.chain == "pruning" else settings.levels
    left_out = [f"level {number}" for number in range(clouds + 1, planned + 1)]
    left_out += ["the cross impostor"] if settings.cross and not cross else []
    if left_out and far_levels.asked(situation.asked) is None:
        verb = "is" if len(left_out) == 1 else "are"
        all_left_out = " and ".join(filter(None, [", ".join(left_out[:-1]), left_out[-1]]))
        said.append(f"{all_left_out} {verb} left out: {far_levels.rule(situation)[1]}")
    follows = is_on(effects, "transitions") or is_on(effects, "pruning") or situation.seen.first != situation.seen.last
    if not follows and transitions.asked(situation.asked) is None:
        said.append(f"level {situation.seen.first} is always shown: {transitions.rule(situation)[1]}")
    return CameraNote("; ".join(said), "anywhere") if said else None


def sees_pages(settings: BakeSettings, facts: Facts) -> bool:
    """Return whether any camera may see a billboard. If not, the atlas is packed quickly instead of tightly."""
    seen = camera_visibility(settings, facts)
    return seen is None or seen.last > 0


def joint_effects(plans: Sequence[tuple[Decision, ...]]) -> tuple[Decision, ...]:
    """Merge the plans of several trees into one.

    An effect is on if any tree has it on, with the first such reason. Its cost is the sum over the trees.
    """

    def joint(effects: tuple[Decision, ...]) -> Decision:
        shown = next((effect for effect in effects if effect.on), None) or next(
            (effect for effect in effects if effect.on is None), effects[0]
        )
        paid = [effect for effect in effects if effect.on is not False]
        return replace(
            shown, seconds=sum(effect.seconds for effect in paid), bytes=sum(effect.bytes for effect in paid)
        )

    return plans[0] if len(plans) == 1 else tuple(map(joint, zip(*plans, strict=True)))


def _decision(effect: Effect, situation: Situation) -> Decision:
    on = effect.asked(situation.asked)
    if on is None:
        return Decision(effect.name, *effect.rule(situation))
    if effect.name in situation.asked.forced:
        return Decision(effect.name, on, f"asked for by `effects={'+' if on else '-'}{effect.name}`")
    return Decision(effect.name, on, effect.asked_reason(situation.settings))


def _under_baked_light(decision: Decision) -> Decision:
    """Return the decision with baked light. Effects for moving light are off, even if forced on."""
    on, reason = effect_named(decision.name).under_baked_light(decision)
    return replace(decision, on=on, reason=reason)
