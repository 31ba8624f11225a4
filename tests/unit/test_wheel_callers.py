"""Several callers of the wheel at once: a short call does not wait for the end of a long one."""

from __future__ import annotations

import pytest
from test_wheel_interrupts import output_of

SHORT_CALLS = """
small = leafcloud.Foliage(*squares(100))

def short_calls():
    leafcloud.fit(small)
    leafcloud.render([small], (1, 0, 0), 128, centre=small.centre, radius=small.radius)
"""

BESIDE_A_JOB = """
foliage = leafcloud.Foliage(*squares(300))
job = leafcloud.start_chain(foliage, levels=1, cross=False, texture_size=8192, samples=16)
while job.stage != "bake":
    time.sleep(0.01)
begin, longest = job.fraction, 0.0
while job.fraction < begin + 0.05:
    before = job.fraction
    short_calls()
    longest = max(longest, job.fraction - before)
print(longest, job.done, flush=True)
os._exit(0)
"""

BESIDE_A_RENDER = """
foliage = leafcloud.Foliage(*squares(20_000))
view = {"centre": foliage.centre, "radius": foliage.radius, "samples": 16}
thread = threading.Thread(target=lambda: leafcloud.render([foliage], (1, 0, 0), 16384, **view), daemon=True)
thread.start()
time.sleep(1)
for _ in range(100):
    short_calls()
print(thread.is_alive(), flush=True)
os._exit(0)
"""


@pytest.mark.night
def test_a_short_call_takes_a_small_part_of_a_long_job() -> None:
    """The job takes minutes, a short call some milliseconds.

    Rayon's threads leave a job only now and then, so some calls may be lucky: the calls go on for a twentieth of it.
    """
    longest, done = output_of(SHORT_CALLS + BESIDE_A_JOB).split()
    assert done == "False"
    assert float(longest) < 0.02


def test_short_calls_end_before_a_render_that_began_earlier() -> None:
    """The render takes minutes."""
    assert output_of(SHORT_CALLS + BESIDE_A_RENDER) == "True"
