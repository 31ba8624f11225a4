"""Names that a setting may have, with what each means."""

from __future__ import annotations

from typing import Literal

Form = Literal["auto", "billboards", "leaves"]
Last = Literal["auto", "cross", "octahedral"]

ENGINES = ("generic", "three", "babylon", "godot", "unity", "unreal", "bevy")
DRAW_OCTAHEDRAL = ("generic", "three")
"""Engines for which octahedral impostors are chosen by cost; Blender's own scenes count as generic. Babylon.js cuts
them out, which looks coarser, so it gets them only if asked for."""
DRAW_SHARES = ("three", "babylon", "godot", "unity", "unreal", "bevy")
"""Engines whose packages draw alpha as a share of a pixel. Blender and readers of generic files cut it out."""
COMPRESSED_ENGINES = ("generic", "three", "unity")
"""Engines that can read `EXT_meshopt_compression`; the reader of generic files is its user's."""
LEVEL_FILE_ENGINES = ("unity", "unreal")
"""Engines for which each level always gets a file of its own: their scripts read these files."""
FILES = {
    "chain": f"one GLB with all levels; for {' and '.join(LEVEL_FILE_ENGINES)} also one for each level",
    "levels": "also a GLB for each level",
    "all": "also a GLB for each level, and an animation of each hand-over",
}
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
LASTS: dict[Last, str] = {
    "auto": "an octahedral impostor where it is cheaper to draw than the level before, if its target draws it "
    "and `quality` decides; else a cross impostor",
    "cross": "a cross impostor",
    "octahedral": "an octahedral impostor in Blender, and a cross impostor in files for readers without its shader",
}
VIEWERS = {
    "auto": "the scene's cameras over all frames if the cameras or the trees move and no engine is set, "
    "else all distances, because the place of a still camera is often an accident",
    "anywhere": "all distances, so all levels are made",
    "camera": "the scene's cameras, moving or still, so only the levels that they see are made",
}
