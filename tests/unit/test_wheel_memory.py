"""Memory of the process after large results of the wheel are gone."""

from __future__ import annotations

import sys

import pytest
from night import rest_at_night
from test_wheel_interrupts import output_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

MOST_LEFT = 50e6
"""Bytes that may stay resident after a result is gone."""
LEAST_HELD = 60e6
"""Bytes that each result and its inputs in the core must hold, or the test shows nothing."""

MEASURED = """
import gc

def resident():
    gc.collect()
    return int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

leafcloud.fit(leafcloud.Foliage(*squares(10)))
before = resident()
result = call()
held = resident()
del result
print(held - before, resident() - before)
"""

LARGE_RESULTS = {
    "blend_order": """
positions = np.random.default_rng(1).random((1800, 3))
triangles = np.arange(1800).reshape(-1, 3)

def call():
    order = leafcloud.blend_order(positions, triangles)
    return order, order.weights, order.sources, order.triangles, order.planes
""",
    "Foliage and fit": """
arrays = squares(300_000)

def call():
    foliage = leafcloud.Foliage(*arrays)
    cloud = leafcloud.fit(foliage, epsilon=0.2)
    return foliage, foliage.leaf_ids, cloud, cloud.parents, cloud.deviations
""",
    "build_chain and ktx2": """
foliage = leafcloud.Foliage(*squares(300))
small = leafcloud.build_chain(foliage, levels=1, cross=False, texture_size=256).levels[0]
small.ktx2("base_color")  # Makes the encoder's tables.

def call():
    chain = leafcloud.build_chain(foliage, levels=1, cross=False, texture_size=2048, samples=1, normals=0.5, orm=True)
    [level] = chain.levels
    return chain, level.base_color, level.normal, level.orm, level.ktx2("base_color")
""",
    "render": """
foliage = leafcloud.Foliage(*squares(300))

def call():
    return leafcloud.render(
        [foliage], (1, 0, 0), 4096, centre=foliage.centre, radius=foliage.radius, samples=1, sun=(0, 0, 1)
    )
""",
    "compressed rows": """
rows = np.random.default_rng(1).integers(0, 255, (3_000_000, 16), dtype=np.uint8)

def call():
    stream = leafcloud.compress_rows(rows)
    return stream, leafcloud.decompress(stream, len(rows), 16)
""",
    "encode_png": """
image = np.random.default_rng(1).integers(0, 255, (4096, 4096, 4), dtype=np.uint8)

def call():
    return leafcloud.encode_png([image])
""",
}


@pytest.mark.parametrize("name", rest_at_night(LARGE_RESULTS, 2))
def test_memory_returns_after_large_results(name: str) -> None:
    held, left = map(int, output_of(LARGE_RESULTS[name] + MEASURED).split())
    assert held > LEAST_HELD
    assert left <= MOST_LEFT


SIMPLIFIED = """
import resource

n = 400
x, y = np.meshgrid(np.arange(n), np.arange(n))
positions = np.column_stack([x.ravel(), y.ravel(), np.random.default_rng(1).random(n * n)])
corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
triangles = np.concatenate([corner[:, None] + [0, 1, n], corner[:, None] + [1, n + 1, n]])

def call():
    leafcloud.simplify(positions, triangles, pixel=10, change=0.0)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
"""


@pytest.mark.night
def test_memory_returns_after_simplifying() -> None:
    """The result is small; the work needs memory."""
    measured = MEASURED.replace("held = resident()", "held = 1024 * result")
    needed, left = map(int, output_of(SIMPLIFIED + measured).split())
    assert needed > LEAST_HELD
    assert left <= MOST_LEFT
