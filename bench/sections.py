"""Documents that are measured section by section."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def sections_of(document: Path) -> dict[str, str]:
    """Return the sections of a document by their names; none for a missing file."""
    if not document.exists():
        return {}
    text = document.read_text(encoding="utf-8")
    return {each.partition("\n")[0]: f"## {each.rstrip()}\n" for each in text.split("\n## ")[1:]}


def table(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown with a head of `names`."""
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"
