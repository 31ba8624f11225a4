"""The wind in leafcloud.glsl on WebGL 2, compared with the law in f64. Cases at rest have to be equal bit for bit.

Vulkan guarantees sines and cosines of angles in [−π, π] within 2⁻¹¹. This exceeds all other rounding errors by far.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from browser import ask
from laws import Air, Floats, blown, carried, fluttered

PAGE = "tests/browser/probe.html"
SINE = 2.0**-11
ULP = 2.0**-23
AIR = Air(
    direction=np.zeros(3),
    up=np.array([0.0, 1.0, 0.0]),
    foot=np.array([0.25, -1.0, 0.5]),
    height=4.0,
    spread=1.5,
    strength=0.0,
    gusts=0.75,
    turns=0.0,
    sway=0.125,
    branches=0.1875,
    flutter=0.375,
)
WIND = (
    "LcWind(vec3(x1.zw, x2.x), vec3(0.0, 1.0, 0.0), vec3(0.25, -1.0, 0.5), 4.0, 1.5, lc_wind_force(x2.y), 0.75, x2.z, "
    "0.125, 0.1875, 0.375)"
)
POINT, PIVOT, CARRIER = "x0.xyz", "vec3(x0.w, x1.xy)", "vec3(x3.yzw)"
DIRECTIONS = np.float32([[1.0, 0.0, 0.0], [0.6, 0.0, -0.8], [0.48, 0.64, 0.6], [0.0, 1.0, 0.0]]).astype(float)


def rows() -> Floats:
    """Return f32 rows (n, 16): point, pivot, direction, strength, turns, a, 0, the billboard's pivot."""
    rng = np.random.default_rng(8)
    found = []
    for direction in DIRECTIONS:
        for strength in (0.0, 1.0, -3.0, 40.0):
            for a in (0.0, 0.25, 1.0):
                near = rng.uniform(-1.0, 3.0, (4, 3))
                for point, pivot, carrier in zip(near, near + 0.1, near[::-1], strict=True):
                    turns = rng.uniform(-20.0, 20.0)
                    found.append([*point, *pivot, *direction, strength, turns, a, 0.0, *carrier])
    return np.float32(found).astype(float)


def airs(arguments: Floats) -> list[Air]:
    return [replace(AIR, direction=row[6:9], strength=row[9], turns=row[10]) for row in arguments]


def reach(arguments: Floats) -> Floats:
    """Return the largest factor of a sine (n,): the lean, the swing and its waves, at the farthest pivot."""
    y = np.maximum(
        np.linalg.norm(arguments[:, 3:6] - AIR.foot, axis=1), np.linalg.norm(arguments[:, 13:] - AIR.foot, axis=1)
    )
    beyond = np.maximum(
        np.linalg.norm(arguments[:, :3] - arguments[:, 3:6], axis=1),
        np.linalg.norm(arguments[:, :3] - arguments[:, 13:], axis=1),
    )
    eta, rho = y / AIR.height, y / AIR.spread
    lean = AIR.sway * AIR.height * (eta**2 + 2.0 * eta * beyond / AIR.height)
    waves = 2.0 * np.sqrt(2.0)
    swing = AIR.branches * AIR.spread * (rho**2 * (1.0 + waves * beyond / AIR.spread) + 2.0 * rho * beyond / AIR.spread)
    return lean + swing


@pytest.fixture(scope="module")
def computed() -> dict[str, Floats]:
    """Return GLSL's results for the rows, (n, 4), by the name of the function."""
    arguments = rows()
    expressions = {
        "force": "vec4(lc_wind_force(x2.y))",
        "turns": "vec4(lc_wind_turns(x0.x, 2.5, vec3(x0.w, x1.xy)))",
        "sway": f"vec4(lc_sway({POINT}, {PIVOT}, {WIND}), 0.0)",
        "flutter": f"vec4(lc_flutter({POINT}, {PIVOT}, abs(x3.y) * 0.25, 0.5, x2.w, {WIND}), 0.0)",
        "blown": f"vec4(lc_blown({POINT}, {PIVOT}, {CARRIER}, x2.w, {WIND}), 0.0)",
    }
    tables = [{"expression": expression, "rows": arguments.tolist()} for expression in expressions.values()]
    answers = ask(PAGE, {"tables": tables, "shares": [0.0] * 65}, patience=120.0)["tables"]
    return {name: np.array(answer, float) for name, answer in zip(expressions, answers, strict=True)}


def test_the_force_and_the_turns_follow_their_laws(computed: dict[str, Floats]) -> None:
    arguments = rows()
    force = [air.force for air in airs(arguments)]
    np.testing.assert_allclose(computed["force"][:, 0], force, rtol=0.0, atol=4.0 * ULP)
    # The same place in Blender's coordinates: (x, −z, y).
    place = arguments[:, [3, 5, 4]] * [1.0, -1.0, 1.0]
    turns = arguments[:, 0] / 2.5 + place @ [0.1732, 0.1414, 0.2236]
    np.testing.assert_allclose(computed["turns"][:, 0], turns, rtol=0.0, atol=16.0 * ULP)


def test_the_sway_follows_its_law(computed: dict[str, Floats]) -> None:
    arguments = rows()
    expected = np.concatenate(
        [carried(row[None, :3], row[None, 3:6], air) for row, air in zip(arguments, airs(arguments), strict=True)]
    )
    off = np.linalg.norm(computed["sway"][:, :3] - expected, axis=1)
    assert (off <= 2.0 * SINE * reach(arguments) + 1e-6).all()


def test_flutter_follows_its_law(computed: dict[str, Floats]) -> None:
    arguments = rows()
    expected = np.concatenate(
        [
            fluttered(row[None, :3], row[None, 3:6], np.abs(row[13:14]) * 0.25, np.array([0.5]), row[11], air)
            for row, air in zip(arguments, airs(arguments), strict=True)
        ]
    )
    # The axis has the error of two sines, and so has the angle. Then the rotation has two more sines.
    arm = np.linalg.norm(arguments[:, :3] - arguments[:, 3:6], axis=1)
    off = np.linalg.norm(computed["flutter"][:, :3] - expected, axis=1)
    assert (off <= 6.0 * SINE * arm + 1e-6).all()


def test_the_whole_wind_follows_its_law(computed: dict[str, Floats]) -> None:
    arguments = rows()
    expected = np.concatenate(
        [
            blown(row[None, :3], row[None, 3:6], row[None, 13:], row[11], air)
            for row, air in zip(arguments, airs(arguments), strict=True)
        ]
    )
    off = np.linalg.norm(computed["blown"][:, :3] - expected, axis=1)
    assert (off <= 2.0 * SINE * reach(arguments) + 1e-6).all()
    assert np.linalg.norm(expected - arguments[:, :3], axis=1).max() > 0.3


def test_without_wind_nothing_moves_bit_for_bit(computed: dict[str, Floats]) -> None:
    arguments = rows()
    still = arguments[:, 9] == 0.0
    assert still.any()
    for name in ("flutter", "blown"):
        assert np.array_equal(computed[name][still, :3], arguments[still, :3])


def test_leaves_do_not_flutter_on_billboards(computed: dict[str, Floats]) -> None:
    arguments = rows()
    flat = arguments[:, 11] == 1.0
    assert np.array_equal(computed["flutter"][flat, :3], arguments[flat, :3])


def test_a_leaf_on_its_billboard_moves_with_the_billboard(computed: dict[str, Floats]) -> None:
    """At a = 1 the leaf's own pivot has no influence. The result equals that of the billboard's pivot at a = 0."""
    arguments = rows()
    flat = arguments[:, 11] == 1.0
    lying = arguments[flat].copy()
    lying[:, 3:6], lying[:, 11] = lying[:, 13:], 0.0
    [answer] = ask(
        PAGE,
        {
            "tables": [
                {
                    "expression": f"vec4(lc_blown({POINT}, {PIVOT}, {CARRIER}, x2.w, {WIND}), 0.0)",
                    "rows": lying.tolist(),
                }
            ],
            "shares": [0.0] * 65,
        },
        patience=120.0,
    )["tables"]
    assert np.abs(np.array(answer)[:, :3] - computed["blown"][flat, :3]).max() <= 16.0 * ULP * 4.0
