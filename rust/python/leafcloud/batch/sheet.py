"""The contact sheet of a batch: `index.html` with a picture, the levels, and the warnings or the error of each tree."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any
from urllib.parse import quote

from .run import Row

_STYLE = """
body { font: 15px/1.4 system-ui, sans-serif; margin: 2rem; color: #222; background: #fff; }
main { display: grid; grid-template-columns: repeat(auto-fill, minmax(22rem, 1fr)); gap: 1.5rem; align-items: start; }
article { border: 1px solid #ccc; border-radius: 6px; padding: 1rem; overflow: hidden; }
article.failed { border-color: #b00; }
h2 { font-size: 1.1rem; margin: 0 0 .5rem; overflow-wrap: anywhere; }
img { width: 100%; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
td, th { text-align: right; padding: .1rem .4rem; font-weight: normal; } th { color: #666; }
.failed p { color: #b00; } .warning { color: #865600; }
@media (prefers-color-scheme: dark) { body { color: #ddd; background: #1b1b1b; } article { border-color: #444; } }
"""


def sheet(rows: Sequence[Row], title: str) -> str:
    """Return the page. Trees that failed come first, the others in the order of `rows`. Pictures are not embedded."""
    failed = [row for row in rows if not row.outcome.done]
    done = [row for row in rows if row.outcome.done]
    head = f"{len(rows):,} trees, {len(failed):,} failed" if failed else f"{len(rows):,} trees"
    articles = "\n".join(map(_article, [*failed, *done]))
    return (
        f'<!doctype html>\n<html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style>\n"
        f"<h1>{escape(title)}</h1><p>{head}</p>\n<main>\n{articles}\n</main></html>"
    )


def _article(row: Row) -> str:
    name, folder = escape(row.tree.name), quote(row.tree.name)
    if not row.outcome.done:
        return f'<article class="failed"><h2>{name}</h2><p>{escape(row.outcome.reason)}</p></article>'
    links = f'<a href="{folder}/report.html">report</a>'
    warnings = "".join(f'<p class="warning">{escape(each)}</p>' for each in row.outcome.warnings)
    levels = "".join(map(_levels, _trees_in(row.report)))
    return (
        f'<article><h2>{name}</h2><a href="{folder}/report.html"><img loading="lazy" alt="levels of {name}" '
        f'src="{folder}/preview.png"></a>{levels}{warnings}<p>{row.outcome.seconds:,.1f} s, '
        f"{row.outcome.memory / 2**20:,.0f} MiB, {links}</p></article>"
    )


def _trees_in(report: dict[str, Any] | None) -> list[dict[str, Any]]:
    if report is None:
        return []
    trees: list[dict[str, Any]] = report.get("trees", [report])
    return trees


def _levels(tree: dict[str, Any]) -> str:
    rows = "".join(
        f"<tr><td>{escape(str(level['method']))}</td><td>{level['triangles'] + level['trunk_triangles']:,}</td>"
        f"<td>{level['switch_distance']:,.4g}</td><td>{level['drawing']['cheaper']:,.1f} ×</td></tr>"
        for level in tree["levels"]
    )
    return f"<table><tr><th>level</th><th>triangles</th><th>from</th><th>cheaper</th></tr>{rows}</table>"
