"""Writer of the pictures for people: preview.png, those of report.html, and the flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ..bake.values import Baked
from . import canvas
from .flight import flights
from .preview import Pictures, preview_image, tree_figures
from .report_page import TreePage, section
from .staging import Staging


def film_names(trees: Sequence[Baked]) -> list[str]:
    """Return the file names of the flights across all hand-overs."""
    return [_film_name(tree, number) for tree in trees for number in range(1, len(tree.levels))]


def _film_name(tree: Baked, number: int) -> str:
    """Return the file name of the flight across the hand-over to level `number`."""
    return f"{tree.collection.name}_flight{number}.png"


def write_pictures(
    staging: Staging, trees: Sequence[tuple[Baked, Mapping[str, Any], Pictures]], *, films: bool
) -> list[str]:
    """Write preview.png and, with `films`, one film for each level after LOD 0. Return the sections of report.html.

    trees: each tree with its own report and pictures.
    """
    pages = [
        TreePage(report, tree_figures(tree, report["levels"], pictures), flights(tree) if films else [])
        for tree, report, pictures in trees
    ]
    with ThreadPoolExecutor(max_workers=1) as beside:
        preview = beside.submit(lambda: canvas.png(preview_image([each.figures for each in pages])))
        sections = [section(each, heading=len(pages) > 1) for each in pages]
        staging.path("preview.png").write_bytes(preview.result())
    for (tree, _, _), each in zip(trees, pages, strict=True):
        for number, film in enumerate(each.films, 1):
            staging.path(_film_name(tree, number)).write_bytes(film)
    return sections
