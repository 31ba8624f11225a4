"""The plan of a bake's effects. Each effect costs time or memory, so it is on only where the scene needs it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from ..settings.bake import CHANNELS, EFFECTS, BakeSettings, asked_effects
from .camera_visibility import CameraVisibility, camera_visibility, pixels_of, prune_start
from .facts import Facts


@dataclass(frozen=True)
class Effect:
    """One effect of the plan, the reason for its state, and its estimated cost.

    on: None while undecided; the bake then decides for each cloud. reason: one sentence.
    seconds, bytes: the estimated cost (`plan.costs`).
    """

    name: str
    on: bool | None
    reason: str
    seconds: float = 0.0
    bytes: int = 0


def plan_effects(settings: BakeSettings, facts: Facts) -> tuple[Effect, ...]:
    """Return the effects in the order of `EFFECTS`. The settings override the rules, which look at the facts."""
    scene = _Scene(settings, facts, camera_visibility(settings, facts))
    effects = tuple(_asked(settings, name) or _RULES[name](scene) for name in EFFECTS)
    return tuple(map(_under_baked_light, effects)) if is_on(effects, "baked_light") else effects


def plan_channels(settings: BakeSettings, facts: Facts) -> tuple[str, ...]:
    """Return the channels to read from the leaf materials.

    Occlusion and self-shadowing need roughness and metallic, too: all are channels of one texture.
    """
    on = {effect.name for effect in plan_effects(settings, facts) if effect.on}
    if on & {"occlusion", "self_shadowing"}:
        on.add("gloss")
    return tuple(name for name in CHANNELS if name in on)


def blended_leaves(settings: BakeSettings, facts: Facts) -> tuple[str, ...]:
    """Return the names of the leaf materials that stay alpha blended in files.

    By default the mostly semi-transparent ones; if `effects` forces `blend_order`, all blended ones or none.
    """
    asked = asked_effects(settings.effects).forced.get("blend_order")
    if asked is None:
        return facts.see_through
    return facts.blended if asked else ()


def plan_levels(settings: BakeSettings, facts: Facts, effects: Sequence[Effect]) -> tuple[int, bool]:
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
    """A note on the camera's influence on the levels, and the value of the setting `viewer` that undoes it."""

    text: str
    viewer: str


def camera_note(settings: BakeSettings, facts: Facts, effects: Sequence[Effect]) -> CameraNote | None:
    """Return a note on what the scene's camera changed in the plan, with the reason; None if there is nothing to tell.

    The note tells which levels are left out, that only one level is shown, or that the plan ignores a still camera.
    """
    scene = _Scene(settings, facts, camera_visibility(settings, facts))
    asked = asked_effects(settings.effects)
    if scene.stands_still and asked.state("far_levels") is None:
        return CameraNote("the camera stands still, so all levels are made", "camera")
    if scene.seen is None:
        return None
    said = []
    clouds, cross = plan_levels(settings, facts, effects)
    planned = 0 if settings.chain == "pruning" else settings.levels
    left_out = [f"level {number}" for number in range(clouds + 1, planned + 1)]
    left_out += ["the cross impostor"] if settings.cross and not cross else []
    if left_out and asked.state("far_levels") is None:
        verb = "is" if len(left_out) == 1 else "are"
        said.append(f"{' and '.join(left_out)} {verb} left out: {_far_levels(scene).reason}")
    follows = is_on(effects, "transitions") or is_on(effects, "pruning") or scene.seen.first != scene.seen.last
    if not follows and asked.state("transitions") is None:
        said.append(f"only level {scene.seen.first} is shown: {_transitions(scene).reason}")
    return CameraNote("; ".join(said), "anywhere") if said else None


def sees_pages(settings: BakeSettings, facts: Facts) -> bool:
    """Return whether any camera may see a billboard. If not, the atlas is packed quickly instead of tightly."""
    seen = camera_visibility(settings, facts)
    return seen is None or seen.last > 0


def joint_effects(plans: Sequence[tuple[Effect, ...]]) -> tuple[Effect, ...]:
    """Merge the plans of several trees into one.

    An effect is on if any tree has it on, with the first such reason. Its cost is the sum over the trees.
    """

    def joint(effects: tuple[Effect, ...]) -> Effect:
        shown = next((effect for effect in effects if effect.on), None) or next(
            (effect for effect in effects if effect.on is None), effects[0]
        )
        paid = [effect for effect in effects if effect.on is not False]
        return replace(
            shown, seconds=sum(effect.seconds for effect in paid), bytes=sum(effect.bytes for effect in paid)
        )

    return plans[0] if len(plans) == 1 else tuple(map(joint, zip(*plans, strict=True)))


def settle_back_sides(effects: Sequence[Effect], two_sided: Sequence[int]) -> tuple[Effect, ...]:
    """Return the effects after the bake. `two_sided`: the numbers of the levels with a texture for each side."""
    return tuple(_settled(effect, two_sided) if effect.on is None else effect for effect in effects)


def is_on(effects: Sequence[Effect], name: str) -> bool | None:
    """Return whether the effect `name` is on; None while it is undecided. Raises `KeyError` for an unplanned name."""
    for effect in effects:
        if effect.name == name:
            return effect.on
    raise KeyError(name)


def first_on(effects: Sequence[Effect], names: Sequence[str]) -> str:
    """Return the first name of an effect that is on; the first of `names` if all are off."""
    return next((name for name in names if is_on(effects, name)), names[0])


@dataclass(frozen=True)
class _Scene:
    """The input of the rules. `seen` is None if the viewer may be anywhere."""

    settings: BakeSettings
    facts: Facts
    seen: CameraVisibility | None

    @property
    def stands_still(self) -> bool:
        """True if the plan ignores the scene's camera because it stands still."""
        return self.facts.camera is None and self.facts.scene_camera is not None and self.settings.by_cameras

    @property
    def free_camera(self) -> str:
        engine = self.facts.engine
        if self.stands_still:
            return "the camera stands still, and the viewer may be anywhere"
        return "the camera may be anywhere" if engine == "generic" else f"the camera may be anywhere in {engine}"

    @property
    def only_leaves(self) -> bool:
        """True if the cameras see LOD 0 only."""
        return self.seen is not None and self.seen.last == 0

    @property
    def where(self) -> str:
        """The distances of the cameras, as the beginning of a sentence."""
        assert self.facts.camera is not None
        near, far = (
            f"{away / self.facts.radius:.3g}" for away in (self.facts.camera.nearest, self.facts.camera.farthest)
        )
        trees = len(self.facts.camera.spans)
        if trees > 1:
            return f"the camera sees the {trees} trees from {near} to {far} crown radii"
        span = far if near == far else f"{near} to {far}"
        return f"the camera stays {span} crown radii away"

    def takes_over(self, level: int) -> str:
        assert self.seen is not None
        return f"level {level} takes over at {self.seen.switches[level] / self.facts.radius:.3g}"

    @property
    def before_level_1(self) -> str:
        """The reason why no billboard is seen."""
        return f"{self.where}, and {self.takes_over(1)}: no billboard is seen"


def _asked(settings: BakeSettings, name: str) -> Effect | None:
    """Return the effect as the settings force it; None if they leave it to the plan."""
    asked = asked_effects(settings.effects)
    on = asked.state(name)
    if on is None:
        return None
    if name in asked.forced:
        return Effect(name, on, f"asked for by `effects={'+' if on else '-'}{name}`")
    if name == "far_levels":
        return Effect(name, on, f"asked for by `levels={settings.levels}` with `effects={settings.effects}`")
    if name == "baked_light" and asked.base == "all":
        return Effect(name, on, f"{_BY_NAME}, not by `effects={settings.effects}`")
    return Effect(name, on, f"asked for by `effects={settings.effects}`")


_BY_NAME = "baked light is right only while no light changes, so it must be asked for by name or by `unlit`"


def _transitions(scene: _Scene) -> Effect:
    seen = scene.seen
    if seen is None:
        return Effect("transitions", True, f"{scene.free_camera}, so it may see one level take over from another")
    if seen.passed:
        return Effect("transitions", True, f"{scene.where}, and {scene.takes_over(seen.passed[0])}")
    if seen.first != seen.last:
        return Effect("transitions", False, f"{scene.where}, and no tree is seen changing levels")
    if seen.last + 1 < len(seen.switches):
        return Effect("transitions", False, f"{scene.where}, and {scene.takes_over(seen.last + 1)}")
    return Effect("transitions", False, f"{scene.where}, past the last change of level: {scene.takes_over(seen.last)}")


def _pruning(scene: _Scene) -> Effect:
    facts, settings, camera = scene.facts, scene.settings, scene.facts.camera
    if facts.leaves == 1:
        return Effect("pruning", False, "the foliage is one leaf, so there is nothing to prune")
    if settings.chain == "billboards":
        return _pruning_of_scenes(scene)
    if camera is None:
        reason = f"{scene.free_camera}, so it may see {facts.leaves} leaves from far away"
        return Effect("pruning", True, reason)
    start = prune_start(settings, facts, camera.view)
    begins = f"pruning starts at {start / facts.radius:.3g}"
    return Effect("pruning", camera.farthest > start, f"{scene.where}, and {begins}")


def _pruning_of_scenes(scene: _Scene) -> Effect:
    """Return the effect for `chain=billboards`: the levels prune no leaves, but a scene of many trees may."""
    facts, camera = scene.facts, scene.facts.camera
    if camera is None:
        reason = "`chain=billboards` keeps all leaves until level 1 takes over"
        return Effect("pruning", False, reason)
    pixels = pixels_of(facts.leaf_size, camera.farthest, camera.view)
    if len(camera.spans) > 1 and pixels < 1.0:
        reason = f"{scene.where}, where a leaf is {pixels:.2g} pixels wide, so a scene of many trees may prune leaves"
        return Effect("pruning", True, reason)
    return Effect("pruning", False, f"{scene.where}, where all leaves stay until level 1 takes over")


def _back_sides(scene: _Scene) -> Effect:
    if scene.only_leaves:
        return Effect("back_sides", False, scene.before_level_1)
    return Effect("back_sides", None, "each level keeps a second texture for the back if its two sides differ")


def _trunk_levels(scene: _Scene) -> Effect:
    trunk = scene.facts.trunk
    if trunk == 0:
        return Effect("trunk_levels", False, "the tree has no trunk or branches")
    if scene.only_leaves:
        return Effect("trunk_levels", False, f"{scene.where}, and {scene.takes_over(1)}: only LOD 0's trunk is seen")
    if scene.seen is not None:
        return Effect("trunk_levels", True, f"{scene.where}, and sees {trunk} trunk triangles beside billboards")
    return Effect("trunk_levels", True, f"{scene.free_camera}, so it may see {trunk} trunk triangles from far away")


def _far_levels(scene: _Scene) -> Effect:
    seen = scene.seen
    if seen is None:
        return Effect("far_levels", True, f"{scene.free_camera}, so it may see every level")
    needed = max(seen.last, 1)
    if needed + 1 >= len(seen.switches):
        return Effect("far_levels", True, f"{scene.where}, and {scene.takes_over(needed)}: every level is seen")
    left = f"only level {needed} is made" if needed == 1 else f"no level after level {needed} is made"
    return Effect("far_levels", False, f"{scene.where}, and {scene.takes_over(needed + 1)}: {left}")


def _normals(scene: _Scene) -> Effect:
    if (nobody := _why_unlit(scene)) is not None:
        return Effect("normals", False, nobody)
    reason = f"{_whose_light(scene)}, so the billboards are lit as their leaves would be"
    return Effect("normals", True, reason)


def _gloss(scene: _Scene) -> Effect:
    if scene.facts.glossy is None:
        return Effect("gloss", False, "roughness and metallic do not vary visibly, so no texture is needed")
    if (nobody := _why_unlit(scene)) is not None:
        return Effect("gloss", False, nobody)
    reason = f"roughness and metallic vary in the material {scene.facts.glossy!r}, or differ from the other materials'"
    return Effect("gloss", True, reason)


def _translucency(scene: _Scene) -> Effect:
    if scene.facts.translucent is None:
        return Effect("translucency", False, "no leaf material is translucent")
    if (nobody := _why_unlit(scene)) is not None:
        return Effect("translucency", False, nobody)
    reason = f"{_whose_light(scene)}, and the material {scene.facts.translucent!r} is translucent"
    return Effect("translucency", True, reason)


def _blend_order(scene: _Scene) -> Effect:
    facts, name = scene.facts, "blend_order"
    if not facts.blended:
        return Effect(name, False, "no leaf material is alpha blended, and cutouts need no draw order")
    if not facts.see_through:
        return Effect(
            name, False, f"too few leaves are known to be semi-transparent, so {facts.blended[0]!r} is cut out"
        )
    if scene.only_leaves:
        return Effect(name, False, scene.before_level_1)
    return Effect(
        name, True, f"the material {facts.see_through[0]!r} is semi-transparent, so it is drawn back to front"
    )


def _shadow_proxy(scene: _Scene) -> Effect:
    facts, name = scene.facts, "shadow_proxy"
    if (nobody := _why_unlit(scene)) is not None:
        return Effect(name, False, nobody)
    if scene.settings.chain == "pruning":
        return Effect(name, False, "`chain=pruning` has no cloud that could cast the leaves' shadow")
    if facts.engine == "generic":
        return Effect(name, False, "each level casts its own shadow; a proxy would shade some leaves wrongly")
    if facts.triangles < _WORTH_A_PROXY:
        return Effect(name, False, f"{facts.triangles} triangles of leaves cost a shadow map next to nothing")
    reason = f"every light in {facts.engine} would draw {facts.triangles} triangles of leaves again for its shadows"
    return Effect(name, True, reason)


_WORTH_A_PROXY = 2000
"""Leaf triangles from which a shadow proxy pays off: some ten times as many as a cloud has."""


def _contrast(scene: _Scene) -> Effect:
    if scene.settings.chain == "billboards" or scene.facts.leaves == 1:
        return Effect("contrast", False, "no leaf is pruned before the first cloud takes over")
    if scene.facts.one_color:
        return Effect("contrast", False, "all leaves have the same color, so there is no contrast to keep")
    pruning = asked_effects(scene.settings.effects).state("pruning")
    if not (_pruning(scene).on if pruning is None else pruning):
        return Effect("contrast", False, f"{scene.where}, where no leaf is pruned")
    return Effect("contrast", True, "pruning enlarges the kept leaves, which would give far crowns too much contrast")


def _wind(scene: _Scene) -> Effect:
    wind = scene.facts.wind
    if wind is None:
        return Effect("wind", False, "no force field blows on the tree")
    blows = "turbulence shakes" if wind.field is None else f"the force field {wind.field!r} blows on"
    return Effect("wind", True, f"{blows} the tree")


def _baked_light(scene: _Scene) -> Effect:
    lights = scene.facts.lights
    if not scene.settings.unlit:
        return Effect("baked_light", False, _BY_NAME)
    if not lights.names:
        return Effect("baked_light", False, "the target is unlit, but the scene has no light to bake")
    if lights.changing is not None:
        return Effect("baked_light", False, f"the target is unlit, but {lights.changing}")
    shining = ", ".join(repr(name) for name in lights.names[:3]) + (" and others" if len(lights.names) > 3 else "")
    return Effect("baked_light", True, f"the target is unlit, and the scene's lights do not change: {shining}")


def _why_unlit(scene: _Scene) -> str | None:
    """Return the reason why billboards need no textures that respond to light; None if they may need them."""
    if scene.settings.unlit:
        return "the target is unlit"
    return scene.before_level_1 if scene.only_leaves else None


def _whose_light(scene: _Scene) -> str:
    facts = scene.facts
    if facts.engine != "generic":
        return f"light may come from anywhere in {facts.engine}"
    if facts.camera is None and not scene.stands_still:
        return "light may come from anywhere"
    return facts.lights.changing or "Blender lights the tree as it renders"


def _always(name: str, reason: str) -> Callable[[_Scene], Effect]:
    """Return the rule of an effect that is on only if the settings ask for it."""
    return lambda scene: Effect(name, False, reason)


_RULES: dict[str, Callable[[_Scene], Effect]] = {
    "transitions": _transitions,
    "pruning": _pruning,
    "back_sides": _back_sides,
    "trunk_levels": _trunk_levels,
    "far_levels": _far_levels,
    "normals": _normals,
    "gloss": _gloss,
    "translucency": _translucency,
    "occlusion": _always("occlusion", "the leaves have no occlusion, so billboards would differ where they take over"),
    "self_shadowing": _always(
        "self_shadowing", "renderers cast shadows themselves, and only a custom shader reads the texture"
    ),
    "shadow_proxy": _shadow_proxy,
    "blend_order": _blend_order,
    "leaf_map": _always("leaf_map", "only needed to swap the leaf textures later, for another season"),
    "contrast": _contrast,
    "wind": _wind,
    "baked_light": _baked_light,
}


def _under_baked_light(effect: Effect) -> Effect:
    """Return the effect as it is with baked light.

    The light differs on the two sides, so both are kept. Effects for moving light are off, even if forced on.
    """
    if effect.name == "back_sides":
        return replace(effect, on=True, reason="the light is baked in, and differs on the two sides of a leaf")
    if effect.name == "contrast":
        return replace(effect, on=False, reason="the light is baked in, and contrast would change base colors only")
    if effect.name == "leaf_map":
        return replace(effect, on=False, reason="the light is baked in, and a swapped leaf texture would have none")
    if effect.name in _FOR_MOVING_LIGHT:
        return replace(effect, on=False, reason="the light is baked in, so the levels respond to no other light")
    return effect


_FOR_MOVING_LIGHT = (*CHANNELS, "occlusion", "self_shadowing", "shadow_proxy")


def _settled(effect: Effect, two_sided: Sequence[int]) -> Effect:
    if not two_sided:
        return replace(effect, on=False, reason="the two sides of every level look alike")
    levels = ", ".join(str(level) for level in two_sided)
    return replace(effect, on=True, reason=f"the two sides differ on level {levels}")
