"""Settings of a bake: those of the levels, from `levels`, and those of the scene and the files. Each is defined once.

The command line's flags, Blender's properties and the checks are made from these definitions and their texts. Code
that receives a `BakeSettings` need not check it again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from .choices import COMPRESSED_ENGINES, ENGINES, FILES, LEVEL_FILE_ENGINES, VIEWERS
from .effects import EFFECT_CHOICES, EFFECTS, asked_effects
from .levels import LevelSettings
from .setting import NamedSetting, Setting, SettingsError, require, settings_in


@dataclass(frozen=True)
class BakeSettings(LevelSettings):
    """Settings of one bake, the same for the command line and the interface.

    Raises `SettingsError` for a value outside its limits, and for settings that exclude one another.
    """

    trees: Annotated[
        str,
        Setting(
            "How the objects are divided into trees. The levels of several trees share atlas pages",
            "NAME",
            choices={
                "one": "all objects are one tree",
                "parents": "one tree per topmost parent, with its children",
                "collections": "one tree per collection",
            },
        ),
    ] = "one"
    alpha: Annotated[
        str,
        Setting(
            "What to do with leaf materials that are opaque but have a transparent image",
            "HOW",
            choices={
                "auto": "keep them opaque, and warn",
                "material": "keep them opaque",
                "texture": "cut the leaves out by the image",
            },
        ),
    ] = "auto"
    engine: Annotated[
        str,
        Setting(
            "Target engine of the glTF files. For babylon, godot, unity and unreal, rank and pivot are texture "
            "coordinates; for the others, named attributes",
            "NAME",
            choices=dict.fromkeys(ENGINES, ""),
        ),
    ] = "generic"
    compress: Annotated[
        bool,
        Setting(
            "Round and compress the meshes in the files (EXT_meshopt_compression). Only engines that read this "
            f"extension open them: {', '.join(COMPRESSED_ENGINES)} with its decoder. Blender does not"
        ),
    ] = False
    files: Annotated[
        str,
        Setting("Files that are written, beside a preview and a report", "NAME", choices=FILES),
    ] = "chain"
    effects: Annotated[
        str,
        Setting(
            f"Effects of the levels: {', '.join(EFFECT_CHOICES)}, or names separated by commas from "
            f"{', '.join(EFFECTS)}. Add +NAME or -NAME to force an effect on or off. Without a word before them they "
            "change auto, as in `effects=-roughness_metallic`",
            "NAMES",
        ),
    ] = "auto"
    viewer: Annotated[
        str,
        Setting(
            "Distances for which levels are made",
            "NAME",
            choices=VIEWERS,
        ),
    ] = "auto"
    unlit: Annotated[
        bool,
        Setting("Bake static light of the scene into the levels, for a target that draws them without lighting"),
    ] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_engine()
        self._check_effects()

    @property
    def by_cameras(self) -> bool:
        """True if the scene's cameras may decide which levels are made."""
        return self.viewer != "anywhere" and self.engine == "generic"

    @property
    def level_files(self) -> bool:
        """True if each level also gets a file of its own."""
        return self.files != "chain" or self.engine in LEVEL_FILE_ENGINES

    def _check_engine(self) -> None:
        if self.compress and self.engine not in COMPRESSED_ENGINES:
            raise SettingsError(
                f"`compress` and `engine={self.engine}` exclude each other: {self.engine} cannot read compressed "
                f"meshes; leave out `compress`, or choose {', '.join(COMPRESSED_ENGINES)}"
            )

    def _check_effects(self) -> None:
        asked = asked_effects(self.effects)
        choices = (
            f"{', '.join(EFFECT_CHOICES)}, or names separated by commas from {', '.join(EFFECTS)}, each with "
            "an optional + or -"
        )
        require(self, "effects", asked.known, choices)
        if self.chain != "billboards" and asked.listed("pruning") is False:
            raise SettingsError(
                f"`chain={self.chain}` needs the effect pruning, which is off: turn it on, or choose `chain=billboards`"
            )


def described() -> tuple[NamedSetting, ...]:
    """Return all settings, in the order of `BakeSettings`."""
    return settings_in(BakeSettings)


def setting_named(name: str) -> NamedSetting:
    """Return the setting called `name`. Raise `KeyError` for an unknown name."""
    return {each.name: each for each in described()}[name]


def flag(name: str) -> str:
    """Return the command line's flag for the setting `name`."""
    return "--" + name.replace("_", "-")
