"""Draw sentences of the project at random, to test with a stranger whether they are clear:

    python tools/draw_sentences.py [--seed 1] [--count 10]

Prints `count` sentences of each kind with their places: tooltips and labels, messages, docstrings, guides. The stranger
says the meaning of each without a look at the code.
"""

from __future__ import annotations

import argparse
import ast
import random
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TEXTS = {"name", "description", "bl_label", "bl_description", "about", "text"}
"""Names of arguments and attributes that hold labels and tooltips."""

Found = tuple[str, str]
"""A sentence and its place."""


def labels() -> Iterator[Found]:
    """Yield the labels and tooltips of the interface and of the settings."""
    for path, tree in _trees("addon"):
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and _name_of(node.func) == "Setting" and node.args:
                yield _text(node.args[0]), path
            elif (
                isinstance(node, ast.keyword) and node.arg in TEXTS and path.startswith(("addon/ui", "addon/settings"))
            ) or (isinstance(node, ast.Assign) and _name_of(node.targets[0]) in TEXTS):
                yield _text(node.value), path


def messages() -> Iterator[Found]:
    """Yield the messages of exceptions, and those that the core refuses input with."""
    for path, tree in _trees("addon", "bake.py"):
        for node in ast.walk(tree):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
                yield _text(node.exc.args[0]), path
    for file in sorted((ROOT / "rust").glob("*/src/**/*.rs")):
        for found in re.findall(r'Error::invalid\(\s*(?:format!\(\s*)?"((?:[^"\\]|\\.)*)"', file.read_text("utf-8")):
            yield re.sub(r"\{[^}]*\}", "…", re.sub(r"\\\n\s*", "", found)), str(file.relative_to(ROOT))


def docstrings() -> Iterator[Found]:
    """Yield the first sentence of each docstring, and of each doc comment in Rust."""
    for path, tree in _trees("addon", "bake.py", "bench", "tools"):
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
                yield _first(text), path
    for file in sorted((ROOT / "rust").glob("*/src/**/*.rs")):
        for block in re.findall(r"(?:^[ \t]*/// .*\n)+", file.read_text("utf-8"), re.MULTILINE):
            yield _first(re.sub(r"^[ \t]*/// ", "", block, flags=re.MULTILINE)), str(file.relative_to(ROOT))


def guides() -> Iterator[Found]:
    """Yield the sentences of README and guides, without tables, code and pictures."""
    for file in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        text = re.sub(r"```.*?```", "", file.read_text("utf-8"), flags=re.DOTALL)
        lines = [
            re.sub(r"^\s*- ", "\n", line)
            for line in text.splitlines()
            if not line.lstrip().startswith(("|", "#", "!", "<"))
        ]
        for paragraph in re.split(r"\n\s*\n", "\n".join(lines)):
            for sentence in re.split(r"(?<=[.!?])\s+(?=[A-Z`*])", " ".join(paragraph.split())):
                yield sentence, str(file.relative_to(ROOT))


def main() -> None:
    parser = argparse.ArgumentParser(description="Draw sentences of the project at random.")
    parser.add_argument("--seed", type=int, default=1, help="random seed (default: 1)")
    parser.add_argument("--count", type=int, default=10, help="sentences of each kind (default: 10)")
    options = parser.parse_args()
    drawing = random.Random(options.seed)
    number = 0
    for kind in (labels, messages, docstrings, guides):
        print(f"\n{kind.__name__}")
        sentences = sorted({(text, place) for text, place in kind() if len(re.findall(r"[A-Za-z]+", text)) > 4})
        for text, place in drawing.sample(sentences, options.count):
            number += 1
            print(f"{number:3}. {text}  [{place}]")


def _trees(*places: str) -> Iterator[tuple[str, ast.Module]]:
    for place in places:
        path = ROOT / place
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            yield str(file.relative_to(ROOT)), ast.parse(file.read_text("utf-8"))


def _name_of(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def _text(node: ast.expr) -> str:
    """Return the text of a string; `…` stands for each value that is filled in."""
    if isinstance(node, ast.JoinedStr):
        return "".join(_text(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return "…"
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def _first(text: str) -> str:
    paragraph = " ".join(text.split("\n\n")[0].split("# ")[0].split())
    return re.split(r"(?<=\.)\s", paragraph)[0]


if __name__ == "__main__":
    main()
