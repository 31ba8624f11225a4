"""The files of a cost curve: its rows as CSV and JSON, its charts as PNG and SVG."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

import leafcloud

from .staging import Staging

COSTS: tuple[leafcloud.Cost, ...] = ("seconds", "billboards", "bytes")
CHART_SIZE = (800, 560)
"""Of each of the three charts that stand side by side, in pixels."""


def write_curve(curve: leafcloud.Curve, name: str, directory: Path) -> tuple[str, ...]:
    """Writes NAME_curve.csv, .json, .png and .svg into `directory`, whole or not at all; gives their names.

    Raises `OSError` for a folder that cannot be written to.
    """
    with Staging(directory) as staging:
        staging.path(f"{name}_curve.csv").write_text(table(curve), encoding="utf-8", newline="")
        staging.write_json(f"{name}_curve.json", content(curve))
        leafcloud.write_png(str(staging.path(f"{name}_curve.png")), charts(curve, name))
        staging.path(f"{name}_curve.svg").write_text(drawing(curve, name), encoding="utf-8", newline="\n")
        staging.commit()
        return staging.files


def content(curve: leafcloud.Curve) -> dict[str, Any]:
    """What the JSON file holds; see `leafcloud.CurveRow` for units."""
    return {
        "leafcloud": leafcloud.__version__,
        "quick": curve.quick,
        "rows": curve.rows,
        "refused": curve.refused,
        "offers": curve.offers,
        "presets": curve.presets,
    }


def table(curve: leafcloud.Curve) -> str:
    """The rows with a column for each figure; those of seconds are called by their stage."""
    rows = [flat(row) for row in curve.rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def flat(row: leafcloud.CurveRow) -> dict[str, Any]:
    """A row without rows in it."""
    seconds = {f"seconds_{stage}": value for stage, value in row["seconds"].items()}
    others = {name: value for name, value in row.items() if name not in ("settings", "seconds")}
    return {**row["settings"], **seconds, **others}


def charts(curve: leafcloud.Curve, name: str) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """(height, 3 · width, 4) the charts side by side."""
    width, height = CHART_SIZE
    title = f"{name}: what accuracy costs"
    pictures = [curve.picture(cost, title=title, width=width, height=height) for cost in COSTS]
    return np.ascontiguousarray(np.hstack(pictures))


def drawing(curve: leafcloud.Curve, name: str) -> str:
    """The same as SVG, each chart one within the whole."""
    width, height = CHART_SIZE
    title = f"{name}: what accuracy costs"
    parts = [
        curve.svg(cost, title=title, width=width, height=height).replace("<svg ", f'<svg x="{place * width}" ', 1)
        for place, cost in enumerate(COSTS)
    ]
    whole = f'<svg width="{3 * width}" height="{height}" xmlns="http://www.w3.org/2000/svg">'
    return "\n".join([whole, *parts, "</svg>\n"])
