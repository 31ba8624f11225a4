"""Links of the documentation: each leads to a file of the repository, and to a heading of that file."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_TEMPLATES = {ROOT / "bench" / "accuracy.md"}
"""Files that bench/ fills in and writes to another folder: their links start there."""
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_CODE = re.compile(r"^```.*?^```|`[^`\n]*`", flags=re.DOTALL | re.MULTILINE)


def documents() -> list[Path]:
    """Return the Markdown files that belong to the repository."""
    names = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.md"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    paths = (ROOT / name for name in names.stdout.splitlines())
    return [path for path in paths if path.is_file() and path not in _TEMPLATES]


def anchors(text: str) -> set[str]:
    """Return the anchors of a file's headings, by the rule of GitHub. Of headings with one text it knows the first."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    titles = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title) for title in re.findall(r"^#+ (.*)$", prose, re.MULTILINE))
    return {re.sub(r"[^\w\- ]", "", title.strip().lower()).replace(" ", "-") for title in titles}


def broken(document: Path) -> list[str]:
    """Return the links of a document that lead nowhere. Addresses of the internet are not looked up."""
    wrong = []
    for link in _LINK.findall(_CODE.sub("", document.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (document.parent / name).resolve() if name else document
        if not target.exists() or (anchor and anchor not in anchors(target.read_text(encoding="utf-8"))):
            wrong.append(link)
    return wrong


def test_links_lead_to_files_and_headings() -> None:
    wrong = {str(each.relative_to(ROOT)): found for each in documents() if (found := broken(each))}
    assert wrong == {}


def test_a_link_that_leads_nowhere_is_found(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text("# A page\n\n## The wind, `W` & more\n", encoding="utf-8")
    here = tmp_path / "here.md"
    here.write_text(
        "# Here\n[a](page.md) [b](page.md#the-wind-w--more) [c](#here) [d](https://example.org/#x) `[e](code.md)`\n"
        "[f](none.md) [g](page.md#the-sun) [h](#there)\n",
        encoding="utf-8",
    )
    assert broken(here) == ["none.md", "page.md#the-sun", "#there"]
