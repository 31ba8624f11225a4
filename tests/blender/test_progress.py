"""The progress of a job in the interface: the time that is left, and the clicks that pass during the job."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from addon.ui.job_operator import is_over_tab
from addon.ui.progress import time_left


@pytest.mark.parametrize(
    ("seconds", "fraction", "words"),
    [
        (0.5, 0.5, ""),
        (5.0, 0.05, ""),
        (3.0, 0.25, ", 9 s left"),
        (30.0, 0.9, ", 3 s left"),
        (8.0, 1.0, ", 0 s left"),
        (100.0, 0.1, ", 15 min left"),
    ],
)
def test_the_time_left_is_told_once_it_is_known(seconds: float, fraction: float, words: str) -> None:
    assert time_left(seconds, fraction) == words


def region(kind: str, x: int, category: str = "") -> SimpleNamespace:
    return SimpleNamespace(type=kind, x=x, y=100, width=200, height=300, active_panel_category=category)


def over(x: int, y: int, category: str = "Leafcloud") -> bool:
    areas = [
        SimpleNamespace(type="OUTLINER", regions=[region("UI", 0, "Leafcloud")]),
        SimpleNamespace(type="VIEW_3D", regions=[region("WINDOW", 500), region("UI", 800, category)]),
    ]
    return is_over_tab(SimpleNamespace(areas=areas), SimpleNamespace(mouse_x=x, mouse_y=y))


def test_clicks_pass_over_the_tab_alone() -> None:
    assert over(800, 100)
    assert over(999, 399)
    assert not over(799, 100)
    assert not over(1000, 100)
    assert not over(800, 400)
    assert not over(600, 200), "the 3D view"
    assert not over(50, 200), "another editor"
    assert not over(900, 200, "Item"), "another tab"
