"""Runs inside Blender: executes the programs that a test puts into a folder, one at a time, from a timer.

usage: blender --python blender_agent.py -- FOLDER

Program N is the file N.py. Its last statement may set `result`, which goes to N.json. A failure goes there, too.
Between programs Blender handles the events that the test sends to its window.

A program also sees `looks`: the times of the last looks for a program, in seconds. A gap between two is a time during
which Blender's main thread was busy and drew nothing.
"""

from __future__ import annotations

import json
import sys
import time
import traceback
from collections import deque
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
SECONDS = 0.02
_done = [0]
looks: deque[float] = deque(maxlen=20_000)


def answer() -> float:
    """Run the next program if it is there. Return the seconds until the next look."""
    looks.append(time.monotonic())
    number = _done[0] + 1
    program = FOLDER / f"{number}.py"
    if program.is_file():
        _done[0] = number
        names: dict[str, object] = {"bpy": bpy, "looks": looks, "result": None}
        try:
            exec(compile(program.read_text(), program.name, "exec"), names)
            said = {"result": names["result"]}
        except Exception:
            said = {"error": traceback.format_exc()}
        unfinished = FOLDER / f"{number}.part"
        unfinished.write_text(json.dumps(said))
        unfinished.rename(FOLDER / f"{number}.json")
    return SECONDS


bpy.app.timers.register(answer, first_interval=0.5, persistent=True)
