"""Text of several lines in a panel. Blender cuts off a label that is wider than the sidebar."""

from __future__ import annotations

import textwrap

import bpy

_MARGINS, _LETTER = 80.0, 6.6
"""Width of a panel's margins and of a letter, in pixels at 100 % interface scale."""
_FEWEST, _USUAL = 16, 280


def add_text(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "BLANK1") -> None:
    """Add the text as labels that are as wide as the region. The icon stands before the first one."""
    width = _USUAL if context.region is None else context.region.width / context.preferences.system.ui_scale
    letters = max(int((width - _MARGINS) / _LETTER), _FEWEST)
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, letters)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1")
