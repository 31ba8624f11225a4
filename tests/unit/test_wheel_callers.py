"""Several callers of the wheel at once: a short call does not wait for the end of a long one."""

from __future__ import annotations

import pytest
from test_wheel_interrupts import output_of

MOST_SECONDS = 15.0
"""For a call that takes some milliseconds on an idle machine. The long works take minutes."""

SECONDS = 20.0
"""Duration of the short calls. Rayon's threads leave a long work only now and then, so a few calls may be lucky."""

BESIDE = f"""
SECONDS = {SECONDS}
small = leafcloud.Foliage(*squares(100))

def longest_of_short_calls():
    longest, end = 0.0, time.monotonic() + SECONDS
    while time.monotonic() < end:
        for call in (
            lambda: leafcloud.fit(small),
            lambda: leafcloud.render([small], (1, 0, 0), 128, centre=small.centre, radius=small.radius),
        ):
            begin = time.monotonic()
            call()
            longest = max(longest, time.monotonic() - begin)
    return longest

begin_long()
print(longest_of_short_calls(), still_works(), flush=True)
os._exit(0)
"""

LONG_WORKS = {
    "start_chain": """
def begin_long():
    global job
    foliage = leafcloud.Foliage(*squares(3000))
    job = leafcloud.start_chain(foliage, levels=1, cross=False, texture_size=8192, samples=16)
    while job.stage != "bake":
        time.sleep(0.01)
    time.sleep(1)

def still_works():
    return not job.done
""",
    "render": """
def begin_long():
    global thread
    foliage = leafcloud.Foliage(*squares(20_000))
    view = {"centre": foliage.centre, "radius": foliage.radius, "samples": 16}
    thread = threading.Thread(target=lambda: leafcloud.render([foliage], (1, 0, 0), 16384, **view), daemon=True)
    thread.start()
    time.sleep(1)

def still_works():
    return thread.is_alive()
""",
}


@pytest.mark.parametrize("name", LONG_WORKS)
def test_short_calls_do_not_wait_for_a_long_one(name: str) -> None:
    seconds, still_works = output_of(LONG_WORKS[name] + BESIDE).split()
    assert still_works == "True"
    assert float(seconds) < MOST_SECONDS
