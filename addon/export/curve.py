"""Files of a cost curve: its rows as CSV and JSON, its charts as PNG and SVG."""

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
"""Width and height of each of the three charts in pixels."""


def write_curve(curve: leafcloud.Curve, name: str, directory: Path) -> tuple[str, ...]:
    """Write NAME_curve.csv, .json, .png and .svg into `directory`, all or none, and return their names.

    Raises `OSError` for a folder that is not writable.
    """
    with Staging(directory) as staging:
        staging.path(f"{name}_curve.csv").write_text(table(curve), encoding="utf-8", newline="")
        staging.write_json(f"{name}_curve.json", content(curve))
        leafcloud.write_png(str(staging.path(f"{name}_curve.png")), charts(curve, name))
        staging.path(f"{name}_curve.svg").write_text(drawing(curve, name), encoding="utf-8", newline="\n")
        staging.commit()
        return staging.files


def content(curve: leafcloud.Curve) -> dict[str, Any]:
    """Return the content of the JSON file; see `leafcloud.CurveRow` for units."""
    return {
        "leafcloud": leafcloud.__version__,
        "quick": curve.quick,
        "rows": curve.rows,
        "refused": curve.refused,
        "offers": curve.offers,
        "presets": curve.presets,
    }


def table(curve: leafcloud.Curve) -> str:
    """Return the rows as CSV. Each stage has its own column of seconds."""
    rows = [flat(row) for row in curve.rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def flat(row: leafcloud.CurveRow) -> dict[str, Any]:
    """Return a row without nested values."""
    seconds = {f"seconds_{stage}": value for stage, value in row["seconds"].items()}
    others = {name: value for name, value in row.items() if name not in ("settings", "seconds")}
    return {**row["settings"], **seconds, **others}


def charts(curve: leafcloud.Curve, name: str) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return the charts side by side, (height, 3 · width, 4)."""
    width, height = CHART_SIZE
    title = f"{name}: the cost of accuracy"
    pictures = [curve.picture(cost, title=title, width=width, height=height) for cost in COSTS]
    return np.ascontiguousarray(np.hstack(pictures))


def drawing(curve: leafcloud.Curve, name: str) -> str:
    """Return the charts as SVG, each nested in one image."""
    width, height = CHART_SIZE
    title = f"{name}: the cost of accuracy"
    parts = [
        curve.svg(cost, title=title, width=width, height=height).replace("<svg ", f'<svg x="{place * width}" ', 1)
        for place, cost in enumerate(COSTS)
    ]
    whole = f'<svg width="{3 * width}" height="{height}" xmlns="http://www.w3.org/2000/svg">'
    return "\n".join([whole, *parts, "</svg>\n"])
