"""The input of the effects' rules: settings, facts and camera visibility, with phrases for reasons."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings.bake import BakeSettings
from ..settings.effects import AskedEffects, asked_effects
from .camera_visibility import CameraVisibility, camera_visibility
from .facts import Facts


@dataclass(frozen=True)
class Situation:
    """The settings, the facts, and the levels that the cameras see: None if the viewer may be anywhere."""

    settings: BakeSettings
    facts: Facts
    seen: CameraVisibility | None

    @staticmethod
    def of(settings: BakeSettings, facts: Facts) -> Situation:
        return Situation(settings, facts, camera_visibility(settings, facts))

    @property
    def asked(self) -> AskedEffects:
        return asked_effects(self.settings.effects)

    @property
    def stands_still(self) -> bool:
        """True if the plan ignores the scene's camera because it stands still."""
        return self.facts.camera is None and self.facts.scene_camera is not None and self.settings.by_cameras

    @property
    def only_leaves(self) -> bool:
        """True if the cameras see LOD 0 only."""
        return self.seen is not None and self.seen.last == 0

    @property
    def free_camera(self) -> str:
        """The reason why the viewer may be anywhere."""
        engine = self.facts.engine
        if self.stands_still:
            return "the camera stands still, and the viewer may be anywhere"
        return "the camera may be anywhere" if engine == "generic" else f"the camera may be anywhere in {engine}"

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
        soonest, latest = (each[level] / self.facts.radius for each in (self.seen.soonest, self.seen.latest))
        if soonest == latest:
            return f"level {level} takes over at {soonest:.3g}"
        return f"level {level} takes over between {soonest:.3g} and {latest:.3g}"

    @property
    def before_level_1(self) -> str:
        """The reason why no billboard is seen."""
        return f"{self.where}, and {self.takes_over(1)}: no billboard is seen"

    @property
    def unlit(self) -> str | None:
        """The reason why billboards need no textures that respond to light; None if they may need them."""
        if self.settings.unlit:
            return "the target is unlit"
        if self.facts.unlit:
            return "the leaves show their colors without light"
        return self.before_level_1 if self.only_leaves else None

    @property
    def light(self) -> str:
        """The reason why light may change on the billboards."""
        facts = self.facts
        if facts.engine != "generic":
            return f"light may come from anywhere in {facts.engine}"
        if facts.camera is None and not self.stands_still:
            return "light may come from anywhere"
        return facts.lights.changing or "Blender lights the tree as it renders"
