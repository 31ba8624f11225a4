"""The document of `refine.py`: docs/bench/refine.md with its tables, and the chart of errors against seconds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from fidelity import lines_of
from matplotlib import pyplot
from numpy.typing import NDArray
from refine_checks import REFINED, SIZES, summary

matplotlib.use("Agg")  # Without a display.

Row = dict[str, Any]
EFFORTS = ("off", *REFINED)
CHARTED = (256, 64)
"""Sizes of the pictures in the chart."""
ALL_SIZES = ", ".join(f"{size}²" for size in SIZES)

INTRODUCTION = """# Refinement

Made by `make bench-refine`: level 1 against the leaves, with `refine` `off`, `short` and `long`. Billboards and texels
are those of the published method (*literal*), as in [fidelity.md](fidelity.md). FLIP is the mean over 8 views that no
refinement uses, rendered by the metrics with 16 × 16 samples in each pixel (8 × 8 at 512²). In the tables the column
*literal* has the error of the published method with its own textures; *off*, *short* and *long* are divided by it. A
refined level should have at most 1.01 of the error of *off* at each size, and a coverage of 0.985 to 1.015
(`bench/refine_checks.py`). `birch` and `walnut` are trees that no setting was chosen by (`bench/unseen_trees.py`).
Trees with more than 200,000 triangles are left out, as in fidelity.md. To measure one, name it: `make bench-refine
ARGS=../shared/foliage/maple_1m.glb`.

{checks}

![leaves of the pine, level 1 as baked, level 1 refined](refine.png)

The leaves of the pine at 256², level 1 as it is baked, level 1 after `--refine long`.

![error against seconds](refine_seconds.png)

FLIP of level 1 against the seconds of its fit, its bake and its refinement, on as many cores as the machine has: *off*,
*short*, *long* from the left. Dotted: the same levels in Cycles.
"""

CYCLES = """## In Cycles

The same levels and views in Cycles, flat-lit, with 4 × 4 samples in each pixel at 512² and more in smaller pictures:
`make bench-refine ARGS=--cycles`. *off*: FLIP at {sizes}; *short*, *long*: relative to *off*."""

SUNS = """## Under suns

Level 1 under 6 suns: at 128², and of the same pictures at 32². `make bench-refine ARGS=--suns`. *normals*,
*self-shadowed*: the luminance error in Cycles from 4 views, as in [relit.md](relit.md). Leaves are white there, so only
their outlines count. *colors*: FLIP by the metrics from 8 views, with the leaves' colors, normals and shadows."""

HAND_OVERS = """## Hand-overs

FLIP between the leaves as they lie on their billboards where level 1 takes over, and level 1, in pictures of the size
nearest to the crown's there: the change that a cross-fade hides. It is not the error against the leaves. A refined
level looks more like the leaves, and so less like the leaves on their billboards
([why](../decisions/refinement.md))."""

FLIGHT = """## On a flight

The pop at each switch of a whole bake with default settings and every level, as [flight.md](flight.md) measures it: the
largest FLIP between neighboring frames, divided by the median of the frames around them. *leaves*: the same of the
leaves alone at the frames of *off*. `make bench-refine ARGS=--flight`."""

ABLATION = """## Ablation

*paper's fit*: the planes of the published method, found by its search for at most as many billboards, with our bake.
*texels*, *planes*: a long refinement of these alone. *a quarter*: with a quarter of the texels. FLIP relative to
*literal*, the published method with its own textures. `make bench-refine ARGS=--ablation`."""

COSTS = """## Seconds and coverage

*build*: fit, bake and refinement of level 1. *measured in*: what `make bench-refine` takes for the tree. Coverage is
alpha relative to the leaves."""


def ratio_table(rows: Sequence[Row], size: int) -> str:
    """Return the table of FLIP relative to that of the published method."""
    key = str(size)
    ratios = np.array([[row["levels"][name][key] / row["levels"]["literal"][key] for name in EFFORTS] for row in rows])
    body = [
        [row["tree"], f"{row['levels']['literal'][key]:.4f}", *(f"{ratio:.2f}" for ratio in each)]
        for row, each in zip(rows, ratios, strict=True)
    ]
    body.append(["mean", "", *(f"**{ratio:.2f}**" for ratio in ratios.mean(axis=0))])
    return lines_of([f"FLIP at {size}², relative to literal", "literal", *EFFORTS], body)


def cycles_part(rows: Sequence[Row]) -> str:
    """Return the section of errors at all sizes in Cycles, of the refined levels relative to `off`."""

    def cells(name: str, errors: Row, places: int, base: Row | None = None) -> str:
        values = [errors[name][str(size)] / (1.0 if base is None else base["off"][str(size)]) for size in SIZES]
        return ", ".join(f"{value:.{places}f}" for value in values)

    found = [row["cycles"] for row in rows]
    body = [
        [row["tree"], cells("off", each, 3), *(cells(name, each, 2, each) for name in REFINED)]
        for row, each in zip(rows, found, strict=True)
    ]
    ratios = np.array(
        [[[each[name][str(s)] / each["off"][str(s)] for s in SIZES] for name in REFINED] for each in found]
    )
    means = [f"**{', '.join(f'{value:.2f}' for value in each)}**" for each in ratios.mean(axis=0)]
    table = lines_of(["FLIP, Cycles", *EFFORTS], [*body, ["mean", "", *means]])
    return f"{CYCLES.format(sizes=ALL_SIZES)}\n\n{table}"


def suns_part(rows: Sequence[Row]) -> str:
    """Return the table under suns: `off` at both sizes, and the refined levels relative to it."""
    ways = list(rows[0]["suns"]["off"])
    errors = np.array([[[row["suns"][name][way] for name in EFFORTS] for way in ways] for row in rows])
    ratios = errors[:, :, 1:] / errors[:, :, :1]

    def cells(off: Sequence[str], relative: NDArray[np.float64], mark: str = "") -> list[str]:
        words = [[f"{mark}{a:.2f}, {b:.2f}{mark}" for a, b in way] for way in relative]
        return [cell for first, way in zip(off, words, strict=True) for cell in (first, *way)]

    head = [column for way in ways for column in (f"{way}: off", *(f"{name} / off" for name in REFINED))]
    body = [
        [row["tree"], *cells([f"{a:.3f}, {b:.3f}" for a, b in each[:, 0]], relative)]
        for row, each, relative in zip(rows, errors, ratios, strict=True)
    ]
    body.append(["mean", *cells([""] * len(ways), ratios.mean(axis=0), "**")])
    return f"{SUNS}\n\n{lines_of(['errors under suns', *head], body)}"


def hand_over_part(rows: Sequence[Row]) -> str:
    changes = np.array([[row["levels"][name]["hand_over"] for name in EFFORTS] for row in rows])
    crowns = [f"{row['levels']['takes_over']:.0f} pixels" for row in rows]
    body = [
        [row["tree"], crown, *(f"{value:.4f}" for value in each)]
        for row, crown, each in zip(rows, crowns, changes, strict=True)
    ]
    body.append(["mean", "", *(f"**{value:.4f}**" for value in changes.mean(axis=0))])
    return f"{HAND_OVERS}\n\n{lines_of(['change', 'takes over at', *EFFORTS], body)}"


def flight_part(rows: Sequence[Row]) -> str:
    def cell(flown: Sequence[dict[str, float]], i: int) -> str:
        return f"{flown[i]['pop']:.2f} at {flown[i]['at']:.1f} R" if i < len(flown) else "–"

    ways = ("off", "long", "leaves")
    body = [
        [row["tree"], f"{i} → {i + 1}", *(cell(row["flight"][way], i) for way in ways)]
        for row in rows
        for i in range(max(len(row["flight"][way]) for way in ways))
    ]
    return f"{FLIGHT}\n\n{lines_of(['pops', 'switch', *ways], body)}"


def ablation_part(rows: Sequence[Row]) -> str:
    """Return the tables of the ablation beside the levels as they are."""

    def of(row: Row) -> Row:
        own, parts = row["levels"], {name: value for name, value in row["ablation"].items() if isinstance(value, dict)}
        paper = {name: value for name, value in parts.items() if name.startswith("paper")}
        return {**paper, "off": own["off"], **{n: v for n, v in parts.items() if n not in paper}, "long": own["long"]}

    names = list(of(rows[0]))
    tables = []
    for size in (256, 64):
        key = str(size)
        ratios = np.array([[of(row)[name][key] / row["levels"]["literal"][key] for name in names] for row in rows])
        body = [[row["tree"], *(f"{x:.2f}" for x in each)] for row, each in zip(rows, ratios, strict=True)]
        body.append(["mean", *(f"**{x:.2f}**" for x in ratios.mean(axis=0))])
        tables.append(lines_of([f"FLIP at {size}², relative to literal", *names], body))
    times = [[row["tree"], *(f"{of(row)[name]['refine']:.1f}" for name in names)] for row in rows]
    counts = [[row["tree"], *(str(of(row)[name].get("billboards", "")) for name in names)] for row in rows]
    rest = [lines_of(["seconds of the refinement", *names], times), lines_of(["billboards", *names], counts)]
    return "\n\n".join([ABLATION, *tables, *rest])


def cost_part(rows: Sequence[Row]) -> str:
    head = ["seconds", "build, off", *(f"refinement, {name}" for name in REFINED), "measured in"]
    times = [
        [
            row["tree"],
            f"{row['levels']['off']['seconds']:.1f}",
            *(f"{row['levels'][name]['refine']:.1f}" for name in REFINED),
            f"{row['levels']['took']:.0f}",
        ]
        for row in rows
    ]
    covered = [[row["tree"], *(f"{row['levels'][name]['coverage']:.3f}" for name in EFFORTS)] for row in rows]
    return "\n\n".join([COSTS, lines_of(head, times), lines_of(["coverage", *EFFORTS], covered)])


PARTS: dict[str, Callable[[Sequence[Row]], str]] = {
    "cycles": cycles_part,
    "suns": suns_part,
    "flight": flight_part,
    "ablation": ablation_part,
}
"""Sections of the document for measurements on request, by the name of the results."""


def write_chart(rows: Sequence[Row], path: Path) -> None:
    """Write the chart of errors against seconds, a panel for each of CHARTED."""
    figure, panels = pyplot.subplots(1, len(CHARTED), figsize=(10, 5.2), sharex=True)
    for panel, size in zip(panels, CHARTED, strict=True):
        for row, color in zip(rows, pyplot.colormaps["tab10"].colors, strict=False):
            seconds = [row["levels"][name]["seconds"] for name in EFFORTS]
            lines = {"-": row["levels"], ":": row.get("cycles")}
            for style, found in lines.items():
                if found is not None:
                    shown = [found[name][str(size)] for name in EFFORTS]
                    label = row["tree"] if style == "-" else None
                    panel.plot(
                        seconds, shown, style, color=color, marker="o", markersize=3.5, linewidth=1.2, label=label
                    )
        panel.set(title=f"{size}²", xlabel="seconds", ylabel="FLIP", xscale="log", ylim=(0.0, None))
        panel.grid(True, which="both", color="0.92", linewidth=0.6)
        ticks = [second for second in (1, 2, 5, 10, 20, 50, 100, 200, 500) if panel.get_xlim()[0] < second]
        panel.set_xticks(ticks, [str(second) for second in ticks])
        panel.minorticks_off()
    for panel in panels:
        panel.set_xlim(right=1.1 * max(row["levels"]["long"]["seconds"] for row in rows))
    figure.legend(*panels[0].get_legend_handles_labels(), loc="lower center", ncols=4, frameon=False)
    figure.tight_layout(rect=(0.0, 0.03 + 0.045 * -(-len(rows) // 4), 1.0, 1.0))
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def write_page(rows: Sequence[Row], path: Path) -> None:
    """Write the document and its chart."""
    parts = [INTRODUCTION.format(checks=summary(rows)).rstrip()]
    if rows:
        write_chart(rows, path.with_name(f"{path.stem}_seconds.png"))
        parts += [ratio_table(rows, size) for size in SIZES]
        parts.append(hand_over_part(rows))
        for name, part in PARTS.items():
            measured = [row for row in rows if name in row]
            if measured:
                parts.append(part(measured))
        parts.append(cost_part(rows))
    path.write_text("\n\n".join(parts) + "\n")
