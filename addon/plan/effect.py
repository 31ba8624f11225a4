"""The base class of effects: everything that the plan, the bake and the export ask of an effect.

Each method but `rule` has a default that does nothing, so an effect overrides few of them. Linters take empty defaults
of an abstract class for forgotten ones (B027).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

from ..settings.bake import BakeSettings
from ..settings.effects import AskedEffects
from .decision import Decision
from .rates import Rate
from .situation import Situation

if TYPE_CHECKING:
    import bpy

    import leafcloud

    from ..levels.building import Build, BuiltLevel
    from ..levels.material import Page
    from .lod_range import LodRange

Rule = tuple[bool | None, str]
"""The state of an effect, None while undecided, and the reason: one sentence without a capital letter or a period."""


class Effect(ABC):
    """An effect: something rendered that costs time or memory, so it is on only where the scene needs it.

    about: the tooltip. It says what the effect does to the result, and when an artist wants it.
    moving_light: the effect is for light that moves, and off with baked light.
    reads: channels of the leaf materials that the effect needs.
    is_page_texture: the effect is a texture of the clouds. Trees that share an atlas page must have the same ones.
    channels: channels of the core's textures that exist only for this effect.
    """

    about: str = ""
    moving_light: bool = False
    reads: tuple[str, ...] = ()
    is_page_texture: bool = False
    channels: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The name in settings, messages and reports: the name of the effect's file."""
        return type(self).__module__.rpartition(".")[2]

    # The plan

    def asked(self, asked: AskedEffects) -> bool | None:
        """Return whether the setting `effects` turns the effect on or off; None leaves the decision to `rule`."""
        return asked.listed(self.name)

    def asked_reason(self, settings: BakeSettings) -> str:
        """Return the reason for a state that comes from a list without a sign before this effect's name."""
        return f"asked for by `effects={settings.effects}`"

    @abstractmethod
    def rule(self, situation: Situation) -> Rule:
        """Return the state that the situation calls for."""

    def under_baked_light(self, decision: Decision) -> Rule:
        """Return the state with baked light, for the `decision` without it."""
        if self.moving_light:
            return False, "the light is baked in, so the levels respond to no other light"
        return decision.on, decision.reason

    def rates(self, settings: BakeSettings, decisions: Sequence[Decision]) -> tuple[Rate, ...]:
        """Return the rates of the effect while it is on or undecided. Their sum is the estimated cost."""
        return ()

    # The core

    def core_options(self, on: bool | None, settings: BakeSettings) -> dict[str, Any]:
        """Return the effect's options of `leafcloud.build_chain` in the state `on`."""
        return {}

    def core_seconds(self, chain: leafcloud.Chain, decisions: Sequence[Decision]) -> float:
        """Return the seconds that the effect took in the core."""
        return sum(level.channel_seconds.get(channel, 0.0) for level in chain.clouds for channel in self.channels)

    def settled(self, decision: Decision, chain: leafcloud.Chain) -> Decision:
        """Return the decision after the core's work."""
        return decision

    def texture_bytes(self, chain: leafcloud.Chain) -> int:
        """Return bytes of the textures that no other method counts."""
        return 0

    # The levels. Only effects that are on are asked.

    def add_to_page(self, page: Page, level: leafcloud.Level, build: Build) -> Page:
        """Return the atlas page of a cloud with the effect's images added."""
        return page

    def add_to_leaves(self, mesh: bpy.types.Mesh, build: Build) -> dict[str, Any]:
        """Change the mesh of LOD 0, and return custom properties for its object."""
        return {}

    def add_to_member(self, obj: bpy.types.Object, lod_range: LodRange, build: Build) -> None:  # noqa: B027
        """Change a level's object or its trunk, which has the given LOD range."""

    def add_to_cloud(self, built: BuiltLevel, level: leafcloud.Level, build: Build) -> BuiltLevel:
        """Change a finished cloud."""
        return built

    def add_to_tree(self, collection: bpy.types.Collection, build: Build) -> None:  # noqa: B027
        """Add objects to the collection of all levels."""

    # The files. Only effects that are on are asked.

    def as_in_files(self, levels: Sequence[BuiltLevel]) -> AbstractContextManager[None]:
        """Change the levels' materials to those for files while the context lasts."""
        return nullcontext()
