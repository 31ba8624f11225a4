"""Names that a setting may have, with what each means."""

from __future__ import annotations

from typing import Literal

Form = Literal["auto", "billboards", "leaves"]

ENGINES = ("generic", "three", "babylon", "godot", "unity", "unreal", "bevy")
CHAINS = {
    "billboards": "all leaves until the first cloud takes over",
    "pruning": "fewer leaves with distance, then the cross impostor, without clouds",
    "both": "fewer leaves with distance, then a first cloud made of the remaining leaves",
}
FORMS: dict[Form, str] = {
    "auto": "simplified leaves, before the clouds, where leaves have several triangles and the tree gets cheaper to "
    "draw; else a cloud",
    "billboards": "a cloud",
    "leaves": "simplified leaves, before the clouds, however little they save",
}
