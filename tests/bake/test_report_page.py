"""report.html, preview.png and the flights: complete, tight, in one file without references, safe for any name."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from apng import durations_of, frames_of
from bakes import folder_of, report_of
from command_line import QUICK, bake
from numpy.typing import NDArray

from addon.export import canvas, flight
from addon.export.preview import MARGIN, LevelFigure, TreeFigures
from addon.export.report_page import TreePage, page, section

HOSTILE = "<script>alert('&\"')</script>"
VOID = {"meta", "img"}


class Page(HTMLParser):
    """A page's tags, text and pictures. Fails for tags that are not closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    @property
    def pictures(self) -> Iterator[bytes]:
        for name, value in self.attributes:
            if name == "src":
                assert value is not None
                yield base64.b64decode(value.removeprefix("data:image/png;base64,"), validate=True)


@pytest.fixture(scope="module")
def baked() -> tuple[Path, dict[str, Any]]:
    return folder_of("quick"), report_of("quick")


# report.html


def test_the_page_is_whole_and_refers_to_nothing_outside(baked: tuple[Path, dict[str, Any]]) -> None:
    out, _ = baked
    text = (out / "report.html").read_text(encoding="utf-8")
    read = Page(text)
    assert not {"script", "link", "iframe", "a"} & set(read.tags)
    assert {name for name, _ in read.attributes} <= {"lang", "charset", "name", "content", "class", "alt", "src"}
    assert "http" not in text
    assert "url(" not in text
    flights = [(out / f"shrub_flight{number}.png").read_bytes() for number in (1, 2, 3)]
    pictures = list(read.pictures)
    assert pictures[:3] == flights
    assert len(pictures) == 3 + 3 + 1, "flights, levels, views"
    assert all(frames_of(picture) for picture in pictures)


def test_the_page_has_the_figures_of_every_level(baked: tuple[Path, dict[str, Any]]) -> None:
    out, report = baked
    read = Page((out / "report.html").read_text(encoding="utf-8"))
    cells = {text.strip() for text in read.texts}
    shown = {"Leaves", "Level 1", "Level 2", "Cross impostor"}
    for level in report["levels"]:
        shown |= {f"{level['triangles']:,}", f"{level['image_error']:.3f}", canvas.number(level["switch_distance"])}
        shown |= {f"{level['drawing'][key]:,.0f}" for key in ("fragments", "trunk_fragments")}
        shown.add(f"{level['drawing']['size']:.1%}")
        size = level["texture_size"]
        shown |= {f"{size[0]} × {size[1]}"} if size else set()
    shown |= {effect["reason"] for effect in report["effects"]} | set(report["files"])
    assert shown <= cells
    figures = next(text for text in read.texts if "with trunk" in text)
    level = report["levels"][1]
    assert f"{level['triangles'] + level['trunk_triangles']:,} triangles with trunk" in figures
    raw = next(text for text in read.texts if text.startswith("{"))
    assert json.loads(raw) == report


def test_texture_sizes_are_those_of_the_pages(baked: tuple[Path, dict[str, Any]]) -> None:
    _, report = baked
    sizes = [level["texture_size"] for level in report["levels"]]
    assert sizes[0] is None
    for level, (width, height) in zip(report["levels"][1:], sizes[1:], strict=True):
        assert level["texels"] <= width * height


def test_hostile_names_stay_text(baked: tuple[Path, dict[str, Any]]) -> None:
    _, report = baked
    content = json.loads(json.dumps(report))
    content["input"]["materials"] = content["files"] = content["warnings"] = [HOSTILE]
    content["effects"][0]["reason"] = content["needs_no_levels"] = HOSTILE
    block = canvas.empty(3, 3)
    levels = tuple(LevelFigure(HOSTILE, (HOSTILE,), block) for _ in report["levels"])
    film = canvas.png(block)
    tree = TreePage(content, TreeFigures(HOSTILE, levels, block), [film] * (len(levels) - 1))
    sections = [section(tree, heading=True)] * 2
    text = page(HOSTILE, content, sections)
    read = Page(text)
    assert not {"script", "iframe"} & set(read.tags)
    assert "<script" not in text
    assert HOSTILE in read.texts
    assert page(HOSTILE, content, sections) == text


# Flights


def test_flights_are_short_and_small(baked: tuple[Path, dict[str, Any]]) -> None:
    out, _ = baked
    for number in (1, 2, 3):
        png = (out / f"shrub_flight{number}.png").read_bytes()
        assert len(png) < 400_000
        frames = frames_of(png)
        assert 12 <= len(frames) <= 24
        assert max(frames[0].shape) <= 256
        assert len(durations_of(png)) == len(frames)
        assert 1.0 < sum(durations_of(png)) < 6.0
        steps = [np.abs(a.astype(int) - b).mean() for a, b in pairwise(frames)]
        assert min(steps) > 0.0, "every frame is another picture"


def test_the_crown_fills_the_picture_at_the_hand_over(baked: tuple[Path, dict[str, Any]]) -> None:
    """The picture above the text is as high as the crown where the next level appears."""
    for number in (1, 2, 3):
        frame = frames_of((baked[0] / f"shrub_flight{number}.png").read_bytes())[flight.APPROACH]
        crown = (np.abs(frame.astype(int) - canvas.GROUND).sum(axis=2) > 10).any(axis=1)
        assert np.flatnonzero(crown)[0] <= 0.2 * len(frame), "a pixel of a small crown is large"


# preview.png


def test_the_preview_has_no_empty_borders(baked: tuple[Path, dict[str, Any]]) -> None:
    (image,) = frames_of((baked[0] / "preview.png").read_bytes())
    assert (image[:MARGIN] == canvas.PAPER).all(axis=2).mean() > 0.99
    drawn = np.abs(image.astype(int) - canvas.PAPER).sum(axis=2) > 30
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    assert rows[0] < 2 * MARGIN, "the title's line has space above its letters"
    assert columns[0] <= MARGIN + 2
    assert image.shape[0] - 1 - rows[-1] <= MARGIN + 2
    assert image.shape[1] - 1 - columns[-1] <= MARGIN + 2
    assert longest_run(~drawn.any(axis=1)) <= 2 * MARGIN, "no empty rows between levels"


def longest_run(mask: NDArray[np.bool_]) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return int((edges[1::2] - edges[::2]).max())


@pytest.mark.fresh
def test_the_same_bake_gives_the_same_bytes_but_for_seconds(
    baked: tuple[Path, dict[str, Any]], shrub: Path, tmp_path: Path
) -> None:
    bake(shrub, tmp_path, *QUICK)
    for name in ("preview.png", "shrub_flight1.png", "shrub_flight2.png", "shrub_flight3.png"):
        assert (tmp_path / name).read_bytes() == (baked[0] / name).read_bytes()
    first, second = (timeless((folder / "report.html").read_text(encoding="utf-8")) for folder in (baked[0], tmp_path))
    assert first == second


def timeless(text: str) -> list[str]:
    """Return the lines of a page without its tables and values of seconds."""
    lines, is_timed = [], False
    for line in text.splitlines():
        is_timed = "</details>" not in line and (is_timed or "<summary>Seconds" in line or "seconds&quot;: {" in line)
        if "}" in line:
            is_timed = False
        if not is_timed and "seconds&quot;:" not in line:
            # The third column of the effects has seconds.
            lines.append(re.sub(r"(<td class=\"text\">(?:on|off)</td><td>)[\d.]+", r"\1", line))
    return lines


@pytest.mark.night
def test_a_shorter_chain_leaves_no_flights_of_a_longer_one(shrub: Path, tmp_path: Path) -> None:
    bake(shrub, tmp_path, *QUICK, "--levels", 2)
    report = bake(shrub, tmp_path, *QUICK, "--levels", 1)
    assert {file.name for file in tmp_path.iterdir()} == set(report["files"])
    assert "shrub_flight3.png" not in report["files"]
