"""A Blender in a window of a virtual screen, driven by mouse, keys and programs.

It needs Xvfb, xdotool and ImageMagick, and the command of a Blender in the environment variable BLENDER.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

WIDTH, HEIGHT = 1600, 1000
START, ANSWER = 90.0, 60.0
"""Most seconds until Blender answers first, and until it answers later."""
TOOLS = ("Xvfb", "xdotool", "import")


def missing() -> str:
    """Return what these tests lack on this machine; empty if nothing."""
    if "BLENDER" not in os.environ:
        return "the environment variable BLENDER, the command of a Blender 5.2"
    return ", ".join(tool for tool in TOOLS if shutil.which(tool) is None)


def command() -> list[str]:
    return shlex.split(os.environ["BLENDER"])


@dataclass
class Window:
    """A running Blender. `folder`: programs and answers. `pictures`: the captures."""

    folder: Path
    pictures: Path
    environment: dict[str, str]
    process: subprocess.Popen[bytes]
    count: int = field(default=0)

    def run(self, program: str, seconds: float = ANSWER) -> Any:
        """Run a program in Blender; return its `result`. Raise `AssertionError` with its traceback if it fails."""
        self.count += 1
        unfinished = self.folder / f"{self.count}.part"
        unfinished.write_text(program)
        unfinished.rename(self.folder / f"{self.count}.py")
        answer = self.folder / f"{self.count}.json"
        self.wait(answer.is_file, seconds, "an answer")
        said = json.loads(answer.read_text())
        assert "error" not in said, said["error"]
        return said["result"]

    def wait(self, holds: Any, seconds: float, what: str) -> None:
        """Wait until `holds()` is true. Raise `AssertionError` after the time, or if Blender has ended."""
        end = time.monotonic() + seconds
        while not holds():
            assert self.process.poll() is None, f"Blender ended with {self.process.returncode}"
            assert time.monotonic() < end, f"no {what} within {seconds:g} s"
            time.sleep(0.02)

    def keys(self, *names: str) -> None:
        """Press keys, such as "F3" or "ctrl+z"."""
        for name in names:
            self._xdotool("key", name)
            time.sleep(0.15)

    def type(self, text: str) -> None:
        self._xdotool("type", "--delay", "40", text)

    def click(self, x: int, y: int) -> None:
        """Click at a place, counted from the upper left corner of the screen."""
        self._xdotool("mousemove", str(x), str(y))
        time.sleep(0.2)
        self._xdotool("click", "1")
        time.sleep(0.2)

    def zoom_out(self, steps: int) -> None:
        """Turn the wheel where the mouse is."""
        for _ in range(steps):
            self._xdotool("click", "5")
            time.sleep(0.05)

    def move(self, x: int, y: int) -> None:
        self._xdotool("mousemove", str(x), str(y))
        time.sleep(0.2)

    def click_in_sidebar(self, right: int, down: int) -> None:
        """Click at a place in the 3D view's sidebar, counted from its upper left corner."""
        left, top = self.run(
            """
view = next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")
sidebar = next(region for region in view.regions if region.type == "UI")
result = (sidebar.x, sidebar.y + sidebar.height)
"""
        )
        self.click(left + right, HEIGHT - top + down)

    def search(self, words: str) -> None:
        """Find a menu entry by Blender's search, as F3 does, and choose it."""
        self.keys("F3")
        time.sleep(0.4)
        self.type(words)
        time.sleep(0.6)
        self.keys("Return")

    def capture(self, name: str) -> Path:
        """Save a picture of the screen."""
        path = self.pictures / f"{name}.png"
        subprocess.run(["import", "-window", "root", str(path)], env=self.environment, check=True, timeout=30)
        return path

    def settle(self, seconds: float = 2.0) -> None:
        """Let Blender draw, as after a change of the shading."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.run("")
            time.sleep(0.1)

    def _xdotool(self, *arguments: str) -> None:
        subprocess.run(["xdotool", *arguments], env=self.environment, check=True, timeout=30)


@contextmanager
def opened(work: Path, pictures: Path, *, display: int = 77) -> Iterator[Window]:
    """Start Blender with its own configuration below `work`, and end it with the block."""
    folder = work / "programs"
    folder.mkdir()
    pictures.mkdir(parents=True, exist_ok=True)
    agent = work / "agent.py"
    agent.write_text((Path(__file__).parent / "blender_agent.py").read_text())
    environment = environment_of(work) | {"DISPLAY": f":{display}"}
    screen = subprocess.Popen(
        ["Xvfb", f":{display}", "-screen", "0", f"{WIDTH}x{HEIGHT}x24", "-nolisten", "tcp"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        time.sleep(1.0)
        geometry = ["--window-geometry", "0", "0", str(WIDTH), str(HEIGHT)]
        with (work / "blender.log").open("wb") as log:
            process = subprocess.Popen(
                [*command(), *geometry, "--python", str(agent), "--", str(folder)],
                env=environment,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        try:
            window = Window(folder, pictures, environment, process)
            window.run("result = bpy.app.version_string", START)
            yield window
        finally:
            process.kill()
            process.wait()
    finally:
        screen.kill()
        screen.wait()


def environment_of(work: Path) -> dict[str, str]:
    """Return the environment of a Blender with its configuration below `work`."""
    resources = work / "resources"
    resources.mkdir(exist_ok=True)
    return {**os.environ, "BLENDER_USER_RESOURCES": str(resources), "HOME": str(work), "LIBGL_ALWAYS_SOFTWARE": "1"}
