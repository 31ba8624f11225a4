"""Documents that are measured section by section."""

from __future__ import annotations

from pathlib import Path


def sections_of(document: Path) -> dict[str, str]:
    """Return the sections of a document by their names; none for a missing file."""
    if not document.exists():
        return {}
    text = document.read_text(encoding="utf-8")
    return {each.partition("\n")[0]: f"## {each.rstrip()}\n" for each in text.split("\n## ")[1:]}
