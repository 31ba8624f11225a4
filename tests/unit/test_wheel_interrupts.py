"""Calls into the wheel from an interrupted or forked process. Each call stops within a second or works."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PREPARE = """
import os, signal, sys, threading, time
import numpy as np
import leafcloud

def squares(count):
    random = np.random.default_rng(1)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.1
    frames = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    positions = random.random((count, 1, 3)) + corners @ frames
    triangles = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(count)[:, None, None]
    return positions.reshape(-1, 3), triangles.reshape(-1, 3)
"""

INTERRUPTED = """
signal.signal(signal.SIGINT, signal.default_int_handler)  # A background process ignores the signal.
threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
begin = time.monotonic()
try:
    call()
except KeyboardInterrupt:
    print(f"interrupted after {time.monotonic() - begin:.2f}", flush=True)
else:
    print(f"finished after {time.monotonic() - begin:.2f}", flush=True)
os._exit(0)
"""

LONG_CALLS = {
    "render": """
foliage = leafcloud.Foliage(*squares(20_000))
call = lambda: [
    leafcloud.render([foliage], (1, 0, 0), 4096, centre=foliage.centre, radius=foliage.radius, samples=16)
    for _ in range(50)
]
""",
    "simplify": """
n = 900
x, y = np.meshgrid(np.arange(n), np.arange(n))
positions = np.column_stack([x.ravel(), y.ravel(), np.random.default_rng(1).random(n * n)])
corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
triangles = np.concatenate([corner[:, None] + [0, 1, n], corner[:, None] + [1, n + 1, n]])
call = lambda: leafcloud.simplify(positions, triangles, pixel=0.05, change=0.01)
""",
    "blend_order": """
positions = np.random.default_rng(1).random((3000, 3))
triangles = np.arange(3000).reshape(-1, 3)
call = lambda: leafcloud.blend_order(positions, triangles, most=10**9)
""",
    "ktx2": """
chain = leafcloud.build_chain(leafcloud.Foliage(*squares(300)), levels=1, cross=False, texture_size=4096, samples=1)
call = lambda: chain.levels[0].ktx2("base_color")
""",
    "build_chain": """
foliage = leafcloud.Foliage(*squares(300))
call = lambda: leafcloud.build_chain(foliage, levels=1, cross=False, texture_size=8192, samples=16)
""",
    "Foliage": """
positions, triangles = squares(1_500_000)
call = lambda: leafcloud.Foliage(positions, triangles)
""",
    "Foliage of many arrays": """
triangles = np.arange(12_000_000).reshape(-1, 3)
positions = np.random.default_rng(1).random((triangles.size, 3))
arrays = {
    name: np.broadcast_to(0.5, (len(triangles), 3, columns))
    for name, columns in {"uvs": 2, "normals": 3, "colors": 4, "back_colors": 3}.items()
}
call = lambda: leafcloud.Foliage(positions, triangles, **arrays)
""",
    "cost_curve": """
foliage = leafcloud.Foliage(*squares(20_000))
call = lambda: leafcloud.cost_curve(foliage)
""",
    "quick cost_curve": """
foliage = leafcloud.Foliage(*squares(20_000))
call = lambda: leafcloud.cost_curve(foliage, quick=True)
""",
    "build_chain with quality": """
foliage = leafcloud.Foliage(*squares(20_000))
call = lambda: leafcloud.build_chain(foliage, levels=3, quality=0.9)
""",
    "Curve.svg": """
curve = leafcloud.cost_curve(leafcloud.Foliage(*squares(20)), quick=True, levels=1, texture_size=64)
title = "x" * 20_000_000
call = lambda: all(curve.svg(title=title) for _ in range(50))
""",
    "Curve.picture": """
curve = leafcloud.cost_curve(leafcloud.Foliage(*squares(20)), quick=True, levels=1, texture_size=64)
call = lambda: all(len(curve.picture(width=8192, height=8192)) for _ in range(50))
""",
}

FORKED = """
foliage = leafcloud.Foliage(*squares(300))
before = leafcloud.fit(foliage).planes
child = os.fork()
if child == 0:
    signal.alarm(60)
    same = np.array_equal(leafcloud.fit(foliage).planes, before)
    levels = len(leafcloud.build_chain(foliage, levels=1, texture_size=256).levels)
    job = leafcloud.start_fit(foliage)
    same &= np.array_equal(job.result().planes, before)
    os._exit(0 if same and levels == 2 else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""

JOB_OF_THE_PARENT = """
foliage = leafcloud.Foliage(*squares(20_000))
job = leafcloud.start_fit(foliage, effort="best")
child = os.fork()
if child == 0:
    signal.alarm(60)
    try:
        job.result()
    except leafcloud.LeafcloudError as error:
        os._exit(0 if job.done and "forked" in str(error) else 1)
    os._exit(2)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
job.cancel()
"""

CANCELLED = """
foliage = leafcloud.Foliage(*squares(300))
job = leafcloud.start_chain(foliage, levels=1, cross=False, texture_size=8192, samples=16)
while job.stage != "bake":
    time.sleep(0.01)
time.sleep(0.5)
before = job.fraction
job.cancel()
try:
    job.result()
except leafcloud.CancelledError:
    print(before, job.fraction)
"""

FORKED_IN_PROGRESS = """
foliage = leafcloud.Foliage(*squares(300))
child = None

def fork_once(stage, fraction):
    global child
    child = os.fork() if child is None else child

try:
    leafcloud.build_chain(foliage, levels=1, texture_size=256, progress=fork_once)
except leafcloud.LeafcloudError as error:
    os._exit(0 if child == 0 and "forked" in str(error) else 1)
for _ in range(600):
    ended, status = os.waitpid(child, os.WNOHANG)
    if ended:
        print(os.waitstatus_to_exitcode(status))
        break
    time.sleep(0.1)
else:
    os.kill(child, signal.SIGKILL)
    print("the child hangs")
"""

FIRST_CALL = """
import os, signal, threading
import leafcloud
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    threading.Timer({delay}, os.kill, (os.getpid(), signal.SIGINT)).start()
    while True:
        leafcloud.read_gltf({path!r}).centre
except KeyboardInterrupt:
    os._exit(130)
"""

INSPECTED = """
from leafcloud.command import main
signal.signal(signal.SIGINT, signal.default_int_handler)
threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
statuses = (main(["inspect", {path!r}, "--against", {path!r}]) for _ in range(1000))
print(next(status for status in statuses if status != 0))
"""

RENDER_STOPS = """
signal.signal(signal.SIGINT, signal.default_int_handler)
foliage = leafcloud.Foliage(*squares(20_000))
threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
try:
    leafcloud.render([foliage], (1, 0, 0), 16384, centre=foliage.centre, radius=foliage.radius, samples=16)
except KeyboardInterrupt:
    begin = time.monotonic()
    leafcloud.fit(leafcloud.Foliage(*squares(10)))
    print(f"{time.monotonic() - begin:.2f}", flush=True)
os._exit(0)
"""


BUSY = 4.0
"""Seconds that a busy machine may take longer."""


def output_of(script: str) -> str:
    """Run a script, which has to end without an error, and return its output."""
    done = subprocess.run([sys.executable, "-c", PREPARE + script], capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


AT_NIGHT = ("ktx2", "Curve.picture", "quick cost_curve", "Foliage of many arrays")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.night] * (name in AT_NIGHT)) for name in LONG_CALLS]
)
def test_an_interrupt_stops_a_call_within_a_second(name: str) -> None:
    """Uninterrupted calls take many seconds."""
    outcome, _, seconds = output_of(LONG_CALLS[name] + INTERRUPTED).rpartition(" after ")
    assert outcome == "interrupted"
    assert float(seconds) < 1.3 + BUSY


def test_a_forked_child_has_its_own_threads() -> None:
    assert output_of(FORKED) == "0"


def test_a_job_of_the_parent_raises_in_a_forked_child() -> None:
    assert output_of(JOB_OF_THE_PARENT) == "0"


def test_cancel_stops_the_bake_of_an_atlas_page() -> None:
    """Most of the page is not baked any more."""
    before, after = map(float, output_of(CANCELLED).split())
    assert 0.0 < before <= after < min(before + 0.1, 1.0)


def test_a_child_forked_in_a_progress_function_is_refused() -> None:
    assert output_of(FORKED_IN_PROGRESS) == "0"


@pytest.mark.parametrize("delay", [0.0, 0.001, 0.01, 0.1])
def test_an_interrupt_of_the_first_calls_is_a_keyboard_interrupt(delay: float, shrub: Path) -> None:
    """The import has loaded numpy: a load inside a call of the core would panic when interrupted."""
    script = FIRST_CALL.format(delay=delay, path=str(shrub))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stderr) == (130, "")


def test_an_interrupted_inspection_returns_a_status(shrub: Path) -> None:
    assert output_of(INSPECTED.format(path=str(shrub))).splitlines()[-1] == "130"


def test_an_interrupted_render_frees_the_threads() -> None:
    """The whole picture would take minutes; the next call needs its threads."""
    assert float(output_of(RENDER_STOPS)) < 1.0 + BUSY
