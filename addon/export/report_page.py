"""report.html: the content of report.json as tables, with the pictures, in one file without scripts and links."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import leafcloud

from . import canvas
from .preview import LevelFigure, TreeFigures

PADDING = 10
"""Pixels of paper around a picture."""

Row = Mapping[str, Any]

STYLE = """
:root { color-scheme: light dark; }
body { margin: 0 auto; max-width: 90rem; padding: 1.5rem; color: light-dark(#1c2128, #e6e9ed);
  background: light-dark(#f7f8fa, #15181c);
  font: 15px/1.45 system-ui, sans-serif; }
h1 { font-size: 1.7rem; margin: 0; } h2 { font-size: 1.4rem; margin: 2rem 0 .5rem; }
h3 { font-size: 1.1rem; margin: 1.5rem 0 .4rem; } p { margin: .2rem 0; } .soft { color: light-dark(#5c6672, #a3adb8); }
.films { display: flex; flex-wrap: wrap; gap: .75rem; align-items: flex-start; }
img { max-width: 100%; height: auto; border-radius: 6px; } .film { image-rendering: pixelated; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; background: light-dark(#fff, #1f2429); font-size: .9rem; }
th, td { padding: .3rem .6rem; border: 1px solid light-dark(#d5dae0, #373e46); text-align: right; }
td { white-space: nowrap; }
th { font-weight: 600; } td.text, th.text { text-align: left; white-space: normal; }
details { margin: .8rem 0; } summary { cursor: pointer; font-weight: 600; }
pre { overflow-x: auto; background: light-dark(#fff, #1f2429);
  border: 1px solid light-dark(#d5dae0, #373e46); padding: .6rem; font-size: .8rem; }
.warning { border-left: 4px solid #d08700; padding-left: .6rem; }
"""


@dataclass(frozen=True)
class TreePage:
    """A tree's row of the report, its pictures, and one film (APNG) for each level after LOD 0, or none."""

    content: Row
    figures: TreeFigures
    films: Sequence[bytes]


def page(name: str, content: Row, sections: Sequence[str]) -> str:
    """Return the HTML text. `name`: base name of the files. `content`: that of report.json. `sections`: one a tree."""
    title = _escaped(name)
    parts = [
        f"<h1>{title}</h1>",
        f'<p class="soft">Levels of detail, made by Leafcloud {_escaped(content["leafcloud"])} in Blender '
        f"{_escaped(content['blender'])}</p>",
    ]
    parts += sections
    parts.append(_details("Seconds of the bake", stages_table(content["seconds"])))
    parts.append(_details("Files", _list(content["files"])))
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    parts.append(_details("All values, as in report.json", f"<pre>{_escaped(text)}</pre>"))
    body = "\n".join(parts)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}: levels of detail</title>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def section(tree: TreePage, *, heading: bool) -> str:
    """Return a tree's part of the page. `heading`: whether its name is above it."""
    content, figures = tree.content, tree.figures
    parts = [f"<h2>{_escaped(figures.name)}</h2>"] if heading else []
    parts += [f'<p class="warning">{_escaped(warning)}</p>' for warning in content["warnings"]]
    if content["needs_no_levels"]:
        parts.append(f"<p>{_escaped(content['needs_no_levels'])}</p>")
    parts += [f"<p>{_escaped(each['reason'])}</p>" for each in content["left_out"]]
    names = [level.name for level in figures.levels]
    parts.append(levels_table(names, content["levels"], content["input"]["radius"]))
    if content["quality"]:
        parts += ["<h3>Where levels take over, and why there</h3>", looks_table(names[1:], content["quality"])]
        parts.append(_tried(content["quality"]["tried"]))
    if tree.films:
        parts += ["<h3>Flights across the hand-overs</h3>", _films(figures.levels[1:], tree.films)]
    for level in figures.levels[1:]:
        parts += _level(level)
    parts += ["<h3>All levels from five directions</h3>", _picture(figures.views, "All levels from five directions")]
    parts.append(_details("Cost of drawing where each level takes over", drawing_table(names, content["levels"])))
    parts.append(_details("Effects", effects_table(content["effects"])))
    parts.append(_details("Input", _input(content)))
    parts.append(_details("Seconds of the levels", seconds_table(names, content["levels"])))
    return "\n".join(parts)


def _films(levels: Sequence[LevelFigure], films: Sequence[bytes]) -> str:
    images = (
        _image(film, f"Flight across the hand-over to: {level.name}", "film")
        for level, film in zip(levels, films, strict=True)
    )
    return f'<div class="films">{"".join(images)}</div>'


def _level(level: LevelFigure) -> list[str]:
    return [
        f"<h3>{_escaped(level.name)}</h3>",
        f'<p class="soft">{_escaped("  ·  ".join(level.figures))}</p>',
        "" if level.panel is None else _picture(level.panel, f"{level.name} beside the leaves"),
    ]


def levels_table(names: Sequence[str], levels: Sequence[Row], radius: float) -> str:
    """Return the table of the levels. `radius`: R of the leaves."""
    heads = [
        "Level", "Triangles", "Trunk triangles", "Billboards", "Texture", "Image error (128 pixels)", "LOD distance",
        "in R", "Maximum deviation (R)", "Times cheaper to draw", "GPU MB",
    ]  # fmt: skip
    rows = []
    for name, level in zip(names, levels, strict=True):
        size = level["texture_size"]
        rows.append([
            name, f"{level['triangles']:,}", f"{level['trunk_triangles']:,}", f"{level['billboards']:,}",
            "" if size is None else f"{size[0]} × {size[1]}", f"{level['image_error']:.3f}",
            canvas.number(level["switch_distance"]), canvas.number(level["switch_distance"] / radius),
            f"{level['max_deviation_leaves']:.3f}", f"{level['drawing']['cheaper']:.1f}",
            f"{level['drawing']['gpu_bytes'] / 1e6:.2f}",
        ])  # fmt: skip
    return _table(heads, rows)


def looks_table(names: Sequence[str], quality: Row) -> str:
    """Return the table of how each level after LOD 0 looks where it takes over. `quality`: of the report."""
    heads = [
        "Level", "Takes over at", "Pixels", "Looks like the leaves", "Closest to its limit",
        "Difference (1: a light breeze)", "Places (1: a light breeze)", "Contrast, fine to coarse", "Coverage",
        "Color off by",
    ]  # fmt: skip
    rows = []
    for name, level in zip(names, quality["levels"], strict=True):
        judged = level["judged"]
        rows.append([
            name, f"{level['size']:.1%} of the picture's height", f"{level['crown_pixels']:.0f}",
            _verdict(level),
            f"{judged['by']}, {judged['excess']:.0%} of what is allowed", f"{judged['difference']:.2f}",
            f"{judged['places']:.2f}" if judged["places"] else "",
            " ".join(f"{each:.2f}" for each in judged["contrast"]),
            f"{judged['coverage']:.3f}", f"{judged['color']:.3f}",
        ])  # fmt: skip
    return _table(heads, rows, {0, 1, 3, 4})


def _verdict(level: Row) -> str:
    if level["passes"]:
        return "yes"
    return "too small to tell" if level["crown_pixels"] <= leafcloud.UNJUDGED_CROWN else "no"


def _tried(tried: Sequence[Row]) -> str:
    """Return a sentence on the error bounds that were tried."""
    if not tried:
        return "<p>The error bound was given.</p>"
    said = [f"{each['epsilon']:.3f} R ({each['billboards']} billboards, {each['excess']:.0%})" for each in tried]
    return (
        f"<p>Tried error bounds, with their share of the allowed difference, before textures: "
        f"{_escaped(', '.join(said))}. The last one was chosen.</p>"
    )


def drawing_table(names: Sequence[str], levels: Sequence[Row]) -> str:
    """Return the table of the costs of drawing."""
    heads = [
        "Level", "Crown's height, of the picture", "Fragments", "of the level before", "of the leaves", "of the trunk",
        "Layers",
    ]  # fmt: skip
    keys = ["fragments", "fragments_before", "fragments_leaves", "trunk_fragments"]
    rows = [
        [
            name,
            f"{level['drawing']['size']:.1%}",
            *(f"{level['drawing'][key]:,.0f}" for key in keys),
            f"{level['drawing']['layers']:.2f}",
        ]
        for name, level in zip(names, levels, strict=True)
    ]
    return _table(heads, rows)


def effects_table(effects: Sequence[Row]) -> str:
    """Return the table of the effects with their reasons."""
    states = {True: "on", False: "off", None: "auto"}
    rows = [
        [each["name"], states[each["on"]], f"{each['seconds']:.2f}", f"{each['bytes'] / 1e6:.2f}", each["reason"]]
        for each in effects
    ]
    return _table(["Effect", "State", "Seconds", "MB", "Reason"], rows, {0, 1, 4})


def stages_table(seconds: Mapping[str, float]) -> str:
    """Return the table of the seconds of all stages, and their sum."""
    rows = [[stage, f"{value:.2f}"] for stage, value in (*seconds.items(), ("all", sum(seconds.values())))]
    return _table(["Stage", "Seconds"], rows)


def seconds_table(names: Sequence[str], levels: Sequence[Row]) -> str:
    """Return the table of the seconds of each level and stage."""
    stages = list(levels[0]["seconds"])
    rows = [
        [name, *(f"{level['seconds'][stage]:.2f}" for stage in stages)]
        for name, level in zip(names, levels, strict=True)
    ]
    return _table(["Level", *stages], rows)


def _input(content: Row) -> str:
    given = content["input"]
    rows = [
        ["Triangles of the leaves", f"{given['triangles']:,}"],
        ["Leaves", f"{given['leaves']:,}"],
        ["Triangles hidden by the crown, in no level", f"{content['hidden_triangles']:,}"],
        ["Radius R of the leaves", canvas.number(given["radius"])],
        ["Choice of the leaves", given["choice"]],
        ["Materials", ", ".join(given["materials"])],
        ["Dropped", ", ".join(map(str, given["dropped"])) or "nothing"],
    ]
    return _table([], rows, {0, 1})


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], texts: Iterable[int] = (0,)) -> str:
    """Return a table. `texts`: columns aligned to the left."""
    left = set(texts)

    def cells(tag: str, values: Sequence[str]) -> str:
        opened = (f'<{tag} class="text">' if column in left else f"<{tag}>" for column in range(len(values)))
        shown = (f"{start}{_escaped(value)}</{tag}>" for start, value in zip(opened, values, strict=True))
        return f"<tr>{''.join(shown)}</tr>"

    head = [cells("th", heads)] if heads else []
    lines = "\n".join([*head, *(cells("td", row) for row in rows)])
    return f'<div class="wide"><table>\n{lines}\n</table></div>'


def _list(items: Iterable[str]) -> str:
    return f"<ul>{''.join(f'<li>{_escaped(item)}</li>' for item in items)}</ul>"


def _details(summary: str, content: str) -> str:
    return f"<details><summary>{_escaped(summary)}</summary>\n{content}\n</details>"


def _picture(block: canvas.Block, description: str) -> str:
    return _image(canvas.png(canvas.framed(block, PADDING)), description, "still")


def _image(png: bytes, description: str, kind: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    return f'<img class="{kind}" alt="{_escaped(description)}" src="data:image/png;base64,{data}">'


def _escaped(text: str) -> str:
    return html.escape(str(text))
