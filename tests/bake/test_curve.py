"""Cost curves: measurements of the wheel, files of `bake.py --cost-curve`, targets and presets, the panel."""

from __future__ import annotations

import csv
import json
import struct
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from command_line import bake, refusal, run, saved
from lod_scenes import add_camera
from scenes import import_part

import addon
import leafcloud
from addon.settings.bake import BakeSettings
from addon.settings.setting import SettingsError
from addon.ui import curve as panel
from addon.ui import measured
from addon.ui.properties import bake_settings

SMALL = {"levels": 1, "cross": False, "texture_size": 256}


@pytest.fixture(scope="module")
def crown() -> leafcloud.Foliage:
    """Return two hundred square leaves at random places."""
    random = np.random.default_rng(3)
    places, sides = random.normal(size=(200, 1, 3)), random.normal(size=(200, 2, 3)) * 0.15
    corners = places + np.stack([-sides[:, 0], sides[:, 1], sides[:, 0], -sides[:, 1]], axis=1)
    first = 4 * np.arange(200)[:, None, None]
    return leafcloud.Foliage(corners.reshape(-1, 3), (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3))


@pytest.fixture(scope="module")
def curve(crown: leafcloud.Foliage) -> leafcloud.Curve:
    return leafcloud.cost_curve(crown, quick=True, **SMALL)


def test_rows_agree_with_the_measured_chains(crown: leafcloud.Foliage, curve: leafcloud.Curve) -> None:
    assert curve.quick
    assert curve.refused == []
    for row in curve.rows:
        stages = [value for stage, value in row["seconds"].items() if stage != "total"]
        assert sum(stages) == pytest.approx(row["seconds"]["total"])
        assert 0.0 < row["mean_deviation"] <= row["max_deviation"] <= row["settings"]["epsilon"]
        assert 0.0 < row["image_error"] < 1.0
        assert row["measured_on"] == crown.triangle_count
    built = leafcloud.build_chain(crown, **{**SMALL, **curve.rows[0]["settings"]}).levels[0]
    # All rows share one size limit of billboards, which a bake of its own may choose differently.
    assert curve.rows[0]["triangles"] == pytest.approx(built.triangles, rel=0.05)
    assert curve.rows[0]["billboards"] == pytest.approx(len(built.regions), rel=0.05)
    by_epsilon = {row["settings"]["epsilon"]: row["billboards"] for row in curve.rows}
    assert by_epsilon[0.028] > by_epsilon[0.056] > by_epsilon[0.112]


def test_no_row_is_better_than_a_row_on_the_front(curve: leafcloud.Curve) -> None:
    costs = [(row["seconds"]["total"], row["image_error"]) for row in curve.rows]
    beaten = [any(a[0] <= b[0] and a[1] <= b[1] and a != b for a in costs) for b in costs]
    assert [row["front"] for row in curve.rows] == [not b for b in beaten]


@pytest.mark.night
def test_offers_and_presets_can_be_built(crown: leafcloud.Foliage, curve: leafcloud.Curve) -> None:
    predicted = [(o["predicted"]["seconds"], -o["predicted"]["image_error"]) for o in curve.offers]
    assert predicted == sorted(predicted)
    assert all(offer in curve.offers for offer in curve.presets.values())
    assert list(curve.presets) == ["draft", "balanced", "final"]
    chain = leafcloud.build_chain(crown, preset="draft", **SMALL)
    assert chain.chosen is not None
    assert chain.seconds > 0.0
    assert chain.levels[0].base_color.shape[1] == chain.chosen["settings"]["texture_size"]
    assert leafcloud.build_chain(crown, **SMALL).chosen is None


def test_a_chain_stays_below_the_requested_image_error(crown: leafcloud.Foliage) -> None:
    most = leafcloud.build_chain(crown, epsilon=0.08, **SMALL).levels[0].image_error
    assert leafcloud.build_chain(crown, image_error=most, **SMALL).levels[0].image_error <= most


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"seconds": -1.0}, "`seconds` is -1"),
        ({"image_error": 1.0}, "`image_error` is 1"),
        pytest.param({"image_error": 1e-5}, "the least that", marks=pytest.mark.night),
        ({"preset": "great"}, "draft, balanced, final"),
        ({"seconds": 5.0, "preset": "draft"}, "give one of them"),
        ({"image_error": 0.1, "max_billboards": 3}, "`max_billboards` leaves no choice"),
    ],
)
def test_impossible_targets_are_refused(crown: leafcloud.Foliage, options: dict[str, Any], words: str) -> None:
    with pytest.raises(leafcloud.LeafcloudError, match=words):
        leafcloud.build_chain(crown, **SMALL, **options)


def test_a_curve_can_be_cancelled(crown: leafcloud.Foliage) -> None:
    told: list[float] = []
    with pytest.raises(leafcloud.CancelledError):
        leafcloud.cost_curve(crown, quick=True, progress=lambda stage, fraction: told.append(fraction) or len(told) < 5)
    assert told == sorted(told)
    job = leafcloud.start_cost_curve(crown)
    job.cancel()
    with pytest.raises(leafcloud.CancelledError):
        job.result()


def test_predictions_follow_the_measurements(curve: leafcloud.Curve) -> None:
    coarse, fine = (curve.predict(**SMALL, epsilon=e)["image_error"] for e in (0.16, 0.02))
    assert fine < coarse
    few, many = (curve.predict(**{**SMALL, "texture_size": size})["seconds"] for size in (256, 4096))
    assert few < many
    with pytest.raises(leafcloud.LeafcloudError, match="epsilon"):
        curve.predict(epsilon=2.0)
    with pytest.raises(leafcloud.LeafcloudError, match="cost"):
        curve.svg("euro")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"seconds": 0.0}, "`seconds` is 0.0"),
        ({"image_error": 2.0}, "`image_error` is 2.0"),
        ({"preset": "best"}, "draft, balanced, final"),
        ({"samples": 17}, "`samples` is 17"),
        ({"seconds": 9.0, "preset": "draft"}, "`seconds` and `preset` exclude each other"),
        ({"seconds": 9.0, "chain": "both"}, "set without `chain`, because it has to choose `epsilon`"),
        ({"preset": "final", "max_billboards": 9}, "without `max_billboards`"),
    ],
)
def test_contradictory_settings_are_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        BakeSettings(**settings)


def test_the_command_line_writes_a_curve(shrub: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    import_part(shrub)
    source = saved(tmp_path / "shrub.blend")
    done = run("--input", source, "--out", out, "--cost-curve", "quick", "--texture-size", 256)
    assert done.returncode == 0, done.stderr
    assert sorted(file.name for file in out.iterdir()) == [
        f"shrub_curve.{kind}" for kind in ("csv", "json", "png", "svg")
    ]
    content = json.loads((out / "shrub_curve.json").read_text())
    with (out / "shrub_curve.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(content["rows"]) >= 8
    for row, kept in zip(rows, content["rows"], strict=True):
        assert float(row["epsilon"]) == kept["settings"]["epsilon"]
        assert row["method"] == kept["settings"]["method"]
        assert float(row["seconds_total"]) == kept["seconds"]["total"]
        assert float(row["image_error"]) == kept["image_error"]
        assert int(row["billboards"]) == kept["billboards"]
        assert row["front"] == str(kept["front"])
    assert any(row["front"] for row in content["rows"])
    assert set(content["presets"]) == {"draft", "balanced", "final"}
    assert struct.unpack(">II", (out / "shrub_curve.png").read_bytes()[16:24]) == (3 * 800, 560)
    texts = ["".join(element.itertext()).strip() for element in ET.parse(out / "shrub_curve.svg").iter()]
    for label in ("(s)", "(count)", "(MiB)", "mean FLIP"):
        assert any(label in text for text in texts)


def test_a_refused_curve_writes_no_file(shrub: Path, tmp_path: Path) -> None:
    import_part(shrub)
    source = ("--input", saved(tmp_path / "shrub.blend"))
    assert "full" in refusal(tmp_path / "a", *source, "--cost-curve", "slow")
    assert "--plan-only" in refusal(tmp_path / "b", *source, "--cost-curve", "--plan-only")
    assert "--seconds" in refusal(tmp_path / "d", *source, "--cost-curve", "quick", "--seconds", 9)
    assert "--chain pruning" in refusal(tmp_path / "c", *source, "--cost-curve", "quick", "--chain", "pruning")
    taken = tmp_path / "out"
    (taken / "shrub_curve.svg").mkdir(parents=True)
    done = run(*source, "--out", taken, "--cost-curve", "quick", "--texture-size", 256)
    assert done.returncode == 1
    assert "is not a folder" not in done.stderr
    assert [file.name for file in taken.iterdir()] == ["shrub_curve.svg"]


@pytest.mark.night
def test_a_bake_with_a_preset_reports_its_prediction(shrub: Path, tmp_path: Path) -> None:
    small = ("--texture-size", 256, "--levels", 1, "--no-cross")
    import_part(shrub)
    source = saved(tmp_path / "shrub.blend")
    report = bake(source, tmp_path / "out", *small, "--preset", "draft")
    told = report["predicted"]
    level = report["levels"][1]
    assert told["settings"]["epsilon"] >= level["epsilon"]
    assert told["image_error"]["measured"] == level["image_error"]
    assert told["image_error"]["predicted"] > 0.0
    assert told["seconds"]["predicted"] > 0.0
    stages = sum(level["seconds"][stage] for stage in ("fit", "pack", "bake", "look"))
    assert told["seconds"]["measured"] >= stages
    assert bake(source, tmp_path / "plain", *small)["predicted"] is None


@pytest.fixture
def _selected(_fresh_scene: None, shrub: Path) -> Iterator[None]:
    """A part of the shrub, selected, in a scene with the add-on."""
    addon.register()
    import_part(shrub)
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = bpy.data.objects["leaves"]
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.cross = 256, 1, False
    yield
    addon.unregister()


class Layout:
    """Stand-in for a panel layout. It records labels and buttons."""

    def __init__(self, drawn: list[tuple[str, str]]) -> None:
        self.drawn = drawn

    def operator(self, name: str, text: str = "", depress: bool = False) -> SimpleNamespace:
        self.drawn.append((name, text))
        if depress:
            self.drawn.append(("pressed", text))
        return SimpleNamespace()

    def label(self, text: str) -> None:
        self.drawn.append(("label", text))

    def template_icon(self, icon_value: int, scale: float) -> None:
        self.drawn.append(("chart", str(scale)))

    def prop(self, owner: object, name: str) -> None:
        assert hasattr(owner, name)
        self.drawn.append(("prop", name))

    def row(self, align: bool = False) -> Layout:
        return self

    column = row


def drawn() -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    panel.LEAFCLOUD_PT_curve.draw(SimpleNamespace(layout=Layout(found)), bpy.context)
    return found


@pytest.mark.usefixtures("_selected")
def test_the_panel_measures_a_curve_and_applies_an_offer() -> None:
    assert [kind for kind, _ in drawn()] == ["leafcloud.curve", "prop", "prop"]
    assert not bpy.ops.leafcloud.pick.poll()
    assert bpy.ops.leafcloud.curve() == {"FINISHED"}
    last = measured.last()
    assert last is not None
    width, height = last.previews["chart"].image_size
    assert (width, height) == measured.CHART_SIZE
    buttons = [text for name, text in drawn() if name == "leafcloud.pick"]
    assert buttons[:3] == ["Draft", "Balanced", "Final"]
    assert len(buttons) == 3 + len(last.shown) <= 3 + 11
    assert all(offer in last.shown for offer in (last.offers[0], last.offers[-1], *last.presets.values()))
    assert all(" s, error 0." in text for text in buttons[3:])
    assert any(kind == "chart" for kind, _ in drawn())
    settings, chosen = bpy.context.scene.leafcloud, last.offers[-1]["settings"]
    assert bpy.ops.leafcloud.pick(index=len(last.offers) - 1) == {"FINISHED"}
    assert settings.epsilon == pytest.approx(chosen["epsilon"])
    assert settings.texture_size == chosen["texture_size"]
    assert (settings.samples, settings.effort) == (chosen["samples"], chosen["effort"])
    # The measured seconds decide which offer is the balanced one. It may be the last offer, too.
    presets = [preset.title() for preset, offer in last.presets.items() if offer == last.offers[-1]]
    assert "Final" in presets
    pressed = [text for kind, text in drawn() if kind == "pressed"]
    assert pressed == [*presets, panel.describe(last.offers[-1])]
    said = panel.LEAFCLOUD_OT_pick.description(bpy.context, SimpleNamespace(index=len(last.offers) - 1))
    assert f"error bound {chosen['epsilon']:g}, {chosen['texture_size']} texels" in said
    predicted = last.offers[-1]["predicted"]
    assert f"error {predicted['image_error']:.3f}" in panel.expected(settings)
    with pytest.raises(RuntimeError, match="there is no point 99"):
        bpy.ops.leafcloud.pick(index=99)


@pytest.mark.night
@pytest.mark.usefixtures("_selected")
def test_a_bake_after_a_curve_reports_prediction_and_measurement(tmp_path: Path) -> None:
    bpy.ops.leafcloud.curve()
    settings = bpy.context.scene.leafcloud
    settings.directory = str(tmp_path)
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    told = json.loads((tmp_path / "report.json").read_text())["predicted"]
    assert told["settings"] is None
    assert told["image_error"]["predicted"] == pytest.approx(told["image_error"]["measured"], rel=1.0)
    shown = [text for kind, text in drawn() if kind == "label"]
    came_to = f"error {told['image_error']['measured']:.3f} (expected {told['seconds']['predicted']:.1f} s"
    [baked] = [place for place, text in enumerate(shown) if text.startswith("Baked: ")]
    assert came_to in shown[baked]
    assert shown[baked + 1].startswith("Level 1: ")


@pytest.mark.night
@pytest.mark.usefixtures("_selected")
def test_the_panel_predicts_only_settings_that_the_curve_measured() -> None:
    bpy.ops.leafcloud.curve()
    last, settings = measured.last(), bpy.context.scene.leafcloud
    assert last is not None
    assert panel.expected(settings).startswith(f"{last.title}: expected ")
    settings.max_billboards = 3
    assert panel.expected(settings) == ""
    settings.max_billboards = 0
    settings.image_error = 1.001 * last.offers[-1]["predicted"]["image_error"]
    assert panel.expected(settings).endswith(panel.describe(last.offers[-1]))
    settings.image_error, settings.seconds = 0.0, 1000.0
    assert panel.expected(settings).endswith(panel.describe(last.offers[-1]))


@pytest.mark.night
@pytest.mark.usefixtures("_selected")
def test_the_panel_predicts_only_the_levels_of_the_plan(tmp_path: Path) -> None:
    """For a camera among the leaves, the plan keeps only level 1."""
    add_camera((0.0, 0.0, 0.1))
    settings = bpy.context.scene.leafcloud
    settings.levels, settings.directory, settings.viewer = 2, str(tmp_path), "camera"
    bpy.ops.leafcloud.curve()
    last = measured.last()
    assert last is not None
    near = measured.expected(last, bake_settings(settings))
    settings.viewer = "anywhere"
    assert measured.expected(last, bake_settings(settings))["seconds"] > near["seconds"]
    settings.viewer = "camera"
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    report = json.loads((tmp_path / "report.json").read_text())
    assert len(report["levels"]) == 2
    assert report["predicted"]["seconds"]["predicted"] == near["seconds"]


@pytest.mark.night
@pytest.mark.usefixtures("_selected")
def test_an_offer_keeps_the_aspect_ratio_of_the_atlas() -> None:
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.texture_height = 256, 128
    bpy.ops.leafcloud.curve()
    last = measured.last()
    assert last is not None
    settings.texture_size, settings.texture_height = 512, 256
    bpy.ops.leafcloud.pick(index=0)
    assert settings.texture_height * 2 == settings.texture_size == last.offers[0]["settings"]["texture_size"]
