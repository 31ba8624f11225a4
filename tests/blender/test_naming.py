"""Messages name settings by flags on the command line, and by labels in the sidebar."""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest
from command_line import run
from scenes import add_mesh

import addon
import leafcloud
from addon.plan.camera_visibility import seen_as_set
from addon.plan.effects import camera_note, plan_effects
from addon.plan.facts import Camera, Facts, Lights
from addon.plan.lod_range import View
from addon.settings.bake import BakeSettings, described
from addon.settings.choices import ENGINES
from addon.settings.flags import with_flags
from addon.settings.setting import SettingsError
from addon.ui.properties import LeafcloudSettings, bake_settings, with_labels

ADDON = Path(addon.__file__).parent
FLAG = re.compile(r"--[a-z]")
NAMED = re.compile(r"`\w+(?:=[^`]*)?`")
KEYWORDS = {each.name for each in described() if "_" in each.name} | {"epsilon"}
"""Names of settings that are not also English words."""


def texts(path: Path) -> Iterator[str]:
    """Yield the texts in a module except docstrings. X replaces the values of an f-string."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    bare = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    parts = {part for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "X" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in bare | parts:
            yield node.value


def suits_the_sidebar(message: str) -> None:
    assert not FLAG.search(message), message
    assert "`" not in message, message
    assert not KEYWORDS & set(re.findall(r"\w+", message)), message


COMMAND_LINE = {"flags.py", "guard.py"}
"""Modules that only `bake.py` uses."""
MODULES = sorted(path for path in ADDON.rglob("*.py") if path.name not in COMMAND_LINE)


def test_only_the_command_line_writes_flags() -> None:
    """No other text of the extension contains a flag."""
    assert len(MODULES) > 80
    assert [text for path in MODULES for text in texts(path) if FLAG.search(text)] == []


def test_command_line_and_sidebar_know_every_name_in_a_message() -> None:
    found = {name for path in MODULES for text in texts(path) for name in NAMED.findall(text)}
    assert {"`effects=-blend_order`", "`out`", "`unlit`", "`image_epsilon`"} <= found
    for name in found - {"`X`", "`X=X`", "`with`"}:
        assert with_flags(name).startswith("--"), name
        assert not {"`", "--"} & {*with_labels(name), with_labels(name)[:2]}, name


@pytest.mark.parametrize(
    ("message", "flags", "labels"),
    [
        ("raise `epsilon`", "raise --epsilon", "raise Error Bound"),
        ("choose `chain=both`", "choose --chain both", "choose Chain: Both"),
        ("choose `viewer=camera`", "choose --viewer camera", "choose Viewer: Only This View"),
        ("cut out by `effects=-blend_order`", "cut out by --effects=-blend_order", "cut out by Blend Order: Off"),
        ("by `effects=auto,+wind`", "by --effects auto,+wind", "by Wind: On"),
        ("by `unlit`, without `cross`", "by --unlit, without --no-cross", "by Unlit, without Impostor"),
        ("without `cross=False`", "without --no-cross", "without Impostor: Off"),
        ("another `out`", "another --out", "another Folder"),
        ("leave `max_texels` out", "leave --max-texels out", "leave max texels out"),
        ("object '`bark`' and `make setup`", "object '`bark`' and `make setup`", "object '`bark`' and `make setup`"),
    ],
)
def test_a_name_becomes_a_flag_or_a_label(message: str, flags: str, labels: str) -> None:
    assert with_flags(message) == flags
    assert with_labels(message) == labels


@pytest.mark.usefixtures("registered")
def test_errors_about_settings_contain_no_flags_in_the_sidebar() -> None:
    """Try each pair of properties at all their limits and choices. Some values exceed the limits of the settings."""
    settings = bpy.context.scene.leafcloud
    ends: dict[str, list[object]] = {}
    for each in LeafcloudSettings.bl_rna.properties:
        if each.type == "ENUM":
            ends[each.identifier] = [item.identifier for item in each.enum_items]
        elif each.type == "BOOLEAN":
            ends[each.identifier] = [False, True]
        elif each.type in ("INT", "FLOAT"):
            ends[each.identifier] = [each.hard_min, each.hard_max]
    refused = set()
    for (one, ones), (two, twos) in itertools.combinations(ends.items(), 2):
        before = getattr(settings, one), getattr(settings, two)
        for first, second in itertools.product(ones, twos):
            setattr(settings, one, first)
            setattr(settings, two, second)
            try:
                bake_settings(settings)
            except SettingsError as error:
                refused.add(with_labels(str(error)))
        setattr(settings, one, before[0])
        setattr(settings, two, before[1])
    for message in refused:
        suits_the_sidebar(message)
    assert any(message.startswith("Chain: Both needs the effect pruning, which is off") for message in refused)
    assert any(message.startswith("Seconds and Image Error exclude each other") for message in refused)
    assert any(message.startswith("Chain: Pruning and Impostor: Off exclude each other") for message in refused)


def test_reasons_of_the_plan_contain_no_flags_in_the_sidebar() -> None:
    view, sun = View(), Lights(("Sun",))
    cameras = (None, *(Camera(spans, view) for spans in [((3.0, 3.0),), ((3.0, 400.0),), ((3.0, 3.0), (90.0, 90.0))]))
    facts = Facts(
        "generic", 9, 36, 18, 5, area=0.01, blended=("leaf",), see_through=("leaf",), translucent="leaf", lights=sun
    )
    asked = ("auto", "auto,+far_levels,-transitions", "auto,+wind,+baked_light,-normals", "all", "none", "normals")
    for effects, unlit, viewer, engine, chain in itertools.product(
        asked, (False, True), ("auto", "camera", "anywhere"), ENGINES[:2], ("billboards", "both")
    ):
        try:
            settings = BakeSettings(effects=effects, unlit=unlit, viewer=viewer, engine=engine, chain=chain)
        except SettingsError:
            continue  # A chain that prunes needs the effect pruning.
        for camera in cameras:
            seen = seen_as_set(settings, Facts(**{**vars(facts), "scene_camera": camera}))
            plan = plan_effects(settings, seen)
            note = camera_note(settings, seen, plan)
            for message in [*(effect.reason for effect in plan), *([] if note is None else [note.text])]:
                suits_the_sidebar(with_labels(message))


@pytest.mark.usefixtures("registered")
def test_labels_and_tooltips_contain_no_flags() -> None:
    classes = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith(("LEAFCLOUD_", "Leafcloud"))]
    assert len(classes) > 10
    for cls in classes:
        suits_the_sidebar(f"{cls.bl_rna.name} {cls.bl_rna.description}")
        for each in (each for each in cls.bl_rna.properties if not each.identifier.startswith("bl_")):
            items = each.enum_items if each.type == "ENUM" else ()
            for shown in (each, *items):
                suits_the_sidebar(f"{shown.name} {shown.description}")


@pytest.mark.usefixtures("registered")
def test_errors_of_the_core_contain_labels_in_the_sidebar() -> None:
    corners = np.random.default_rng(1).normal(size=(1500, 1, 3)) + np.random.default_rng(2).normal(size=(1500, 3, 3))
    leaves = add_mesh("leaves", corners.reshape(-1, 3).tolist(), np.arange(4500).reshape(-1, 3).tolist())
    leaves.select_set(True)
    bpy.context.view_layer.objects.active = leaves
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.epsilon, settings.candidates = 64, 0.001, 1
    with pytest.raises(RuntimeError, match=r"\d+ billboards do not fit on .*; raise Texture Width or Error Bound"):
        bpy.ops.leafcloud.bake()
    foliage = leafcloud.Foliage(corners.reshape(-1, 3), np.arange(4500).reshape(-1, 3))
    with pytest.raises(leafcloud.LeafcloudError) as refused:
        leafcloud.cost_curve(foliage, max_billboards=9)
    assert "leave Max Billboards and max texels out" in with_labels(str(refused.value))


def test_help_names_settings_by_flags() -> None:
    text = " ".join(run("--help").stdout.split())
    assert "`" not in text
    assert "k-means clusters of leaves, as many as --max-billboards" in text
    assert "as in --effects=-roughness_metallic" in text
