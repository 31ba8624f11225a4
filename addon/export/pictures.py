"""Writer of the files for people: preview.png, report.html and the flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..bake.values import Baked
from . import canvas
from .flight import flights
from .preview import Pictures, preview_image, tree_figures
from .report_page import TreePage, page
from .staging import Staging


def film_names(trees: Sequence[Baked]) -> list[str]:
    """Return the file names of the flights across all hand-overs."""
    return [_film_name(tree, number) for tree in trees for number in range(1, len(tree.levels))]


def _film_name(tree: Baked, number: int) -> str:
    """Return the file name of the flight across the hand-over to level `number`."""
    return f"{tree.collection.name}_flight{number}.png"


def write_pictures(
    staging: Staging,
    name: str,
    content: Mapping[str, Any],
    trees: Sequence[tuple[Baked, Mapping[str, Any], Pictures]],
    *,
    films: bool,
) -> None:
    """Write preview.png, report.html and, with `films`, one film for each level after LOD 0.

    name: base name of the files. content: that of report.json. trees: each tree with its own report and pictures.
    """
    pages = [
        TreePage(report, tree_figures(tree, report["levels"], pictures), flights(tree) if films else [])
        for tree, report, pictures in trees
    ]
    staging.path("preview.png").write_bytes(canvas.png(preview_image([each.figures for each in pages])))
    for (tree, _, _), each in zip(trees, pages, strict=True):
        for number, film in enumerate(each.films, 1):
            staging.path(_film_name(tree, number)).write_bytes(film)
    staging.path("report.html").write_text(page(name, content, pages), encoding="utf-8", newline="\n")
