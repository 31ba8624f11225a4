"""The progress of a job in the panel and in the status bar."""

from __future__ import annotations

import time

import bpy

from ..bake.job import stage_words

_FEWEST_SECONDS, _LEAST_FRACTION = 2.0, 0.1
"""Before them, the time that is left is a guess."""

_MINUTES = 90.0
"""Seconds from which minutes are told."""

_began: list[float] = []
"""The start of the running job on the clock of `time.monotonic`, or empty."""

_PAUSE = 0.25
"""Least seconds between two drawings of a stage. Without a graphics card each takes a processor 40 ms from the bake."""

_drawn: list[tuple[str, float]] = []
"""The stage that was drawn last and when, on the same clock; or empty."""


def show(context: bpy.types.Context, stage: str, fraction: float) -> None:
    """Show the stage and its progress. An empty stage hides them."""
    now = time.monotonic()
    if stage and _drawn and _drawn[0][0] == stage and now - _drawn[0][1] < _PAUSE:
        return
    _drawn[:] = [(stage, now)] if stage else []
    status = context.window_manager.leafcloud
    if not stage:
        _began.clear()
    elif not _began:
        _began.append(now)
    left = time_left(now - _began[0], fraction) if stage else ""
    words = stage_words(stage)
    status.stage, status.fraction = words, fraction
    status.left = left
    if context.workspace is not None:
        told = f"Leafcloud: {words}, {fraction:.0%}{left}, Esc cancels" if stage else None
        context.workspace.status_text_set(told)
    views = [area for area in context.screen.areas if area.type == "VIEW_3D"] if context.screen else []
    for region in [region for view in views for region in view.regions]:
        if region.type == "UI":  # Only the sidebar shows the job. A view with a large tree takes long to draw.
            region.tag_redraw()


def time_left(seconds: float, fraction: float) -> str:
    """Return the time that is left of a job in words; empty while it is not known."""
    if seconds < _FEWEST_SECONDS or fraction < _LEAST_FRACTION:
        return ""
    left = seconds * (1.0 / fraction - 1.0)
    return f", {left:.0f} s left" if left < _MINUTES else f", {left / 60.0:.0f} min left"
