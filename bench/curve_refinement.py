"""What a second of refinement buys, beside a second of better settings: points, table and chart for `curves.py`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
from commits import measured_commit
from fidelity import lines_of
from matplotlib import pyplot

import leafcloud

matplotlib.use("Agg")  # Without a display.

EFFORTS: tuple[leafcloud.Refine, ...] = ("off", "short", "long")

TEXT = """Refinement at three points of the curve, measured on {commit}: seconds of level 1 with its refinement, and its
error. *per second*: the error that a further second takes away, in thousandths. *curve*: the least error of the curve
within as many seconds without refinement, with any number of billboards and with at most as many as the point."""


def ends_and_middle(rows: Sequence[leafcloud.CurveRow]) -> list[leafcloud.CurveRow]:
    """Return the first, the middle and the last of the rows, or all of fewer."""
    return [rows[i] for i in sorted({0, len(rows) // 2, len(rows) - 1})]


def measure(foliage: leafcloud.Foliage, rows: Sequence[leafcloud.CurveRow]) -> dict[str, Any]:
    """Build level 1 with the settings of the rows and each effort; return its seconds and image errors."""
    points = []
    for row in rows:
        point: dict[str, Any] = {"settings": row["settings"], "billboards": row["billboards"]}
        for effort in EFFORTS:
            options: dict[str, Any] = {**row["settings"], "levels": 1, "cross": False, "refine": effort}
            chain = leafcloud.build_chain(foliage, **options)
            point[effort] = {"seconds": chain.seconds, "image_error": chain.levels[0].image_error}
        points.append(point)
    return {"commit": measured_commit(), "points": points}


def front(rows: Sequence[leafcloud.CurveRow]) -> list[tuple[float, float]]:
    """Return seconds and errors of the front, the fastest first."""
    return sorted((row["seconds"]["total"], row["image_error"]) for row in rows if row["front"])


def least_error(rows: Sequence[leafcloud.CurveRow], seconds: float, billboards: float = math.inf) -> str:
    """Return the least error of the curve within so many seconds and billboards, in words."""
    fast = [row for row in rows if row["seconds"]["total"] <= seconds and row["billboards"] <= billboards]
    return f"{min(row['image_error'] for row in fast):.3f}" if fast else "–"


def table(refined: dict[str, Any], rows: Sequence[leafcloud.CurveRow]) -> str:
    body = []
    for point in refined["points"]:
        settings, base = point["settings"], point["off"]
        cells = [f"{settings['epsilon']:g}, {settings['texture_size']}", str(point["billboards"])]
        cells.append(f"{base['seconds']:.1f}")
        cells.append(f"{base['image_error']:.3f}")
        for effort in EFFORTS[1:]:
            seconds, error = point[effort]["seconds"], point[effort]["image_error"]
            bought = 1000.0 * (base["image_error"] - error) / max(seconds - base["seconds"], 1e-9)
            alike = least_error(rows, seconds, point["billboards"])
            cells += [f"{seconds:.1f}", f"{error:.3f}", f"{bought:.2f}", f"{least_error(rows, seconds)}, {alike}"]
        body.append(cells)
    columns = [f"{effort}: {name}" for effort in EFFORTS[1:] for name in ("s", "error", "per second", "curve")]
    return lines_of(["ε / R, page", "billboards", "off: s", "error", *columns], body)


def write_chart(refined: dict[str, Any], rows: Sequence[leafcloud.CurveRow], title: str, path: Path) -> None:
    """Write a chart of error over seconds: the front of the curve, and each refined point beside it."""
    figure, panel = pyplot.subplots(figsize=(8.0, 5.0))
    seconds, errors = zip(*front(rows), strict=True)
    panel.step(seconds, errors, where="post", color="0.6", linewidth=1.2, label="front of the curve")
    for number, point in enumerate(refined["points"], start=1):
        shown = [point[effort] for effort in EFFORTS]
        panel.plot(
            [each["seconds"] for each in shown],
            [each["image_error"] for each in shown],
            "o-",
            markersize=4.0,
            linewidth=1.2,
            label=f"point {number}: off, short, long",
        )
    panel.set(title=title, xlabel="seconds", ylabel="error", xscale="log", ylim=(0.0, None))
    panel.grid(True, which="both", color="0.92", linewidth=0.6)
    panel.legend(frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
