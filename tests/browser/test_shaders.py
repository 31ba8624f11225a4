"""The functions of leafcloud.glsl and shares.glsl on WebGL 2, compared with the laws in f64.

The bounds follow from the guarantees for single precision in Vulkan ("Precision of GLSL.std.450"): sums and products
are rounded once, quotients are within 2.5 ulp, square roots and their inverses within some 3 ulp, log2 within 3 ulp and
within 2⁻²¹ on [½, 2], exp2(x) within 3 + 2|x| ulp. ULP is 2⁻²³: relative to a number, one ulp is at most that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from browser import ask
from laws import KNOTS, Floats, drawn_share, kept, ramp, stagger, transition, trend

PAGE = "tests/browser/probe.html"
PATIENCE = 120.0
ULP = 2.0**-23
KEEPS = np.float32([0.004, 0.005, 0.02, 0.1, 0.3, 0.5, 0.9, 0.94, 0.95, 0.97, 0.999, 1.0])


@dataclass(frozen=True)
class Table:
    """A GLSL expression, rows of arguments (n, up to 16), the results of the law, and the allowed error."""

    expression: str
    arguments: Floats
    expected: Floats
    bound: Floats | float

    @property
    def rows(self) -> list[list[float]]:
        return np.pad(self.arguments, ((0, 0), (0, 16 - self.arguments.shape[1]))).tolist()


def grid(*axes: Any) -> Floats:
    """Return all combinations of the values, rounded to f32, one in each row."""
    return (
        np.stack(np.meshgrid(*(np.float32(axis) for axis in axes), indexing="ij"), -1)
        .reshape(-1, len(axes))
        .astype(float)
    )


def transition_table() -> Table:
    arguments = grid([0.0, 1.0, 3.7, 99.0, 1e9], [0.0, 1.0, 3.0], [0.0, 1.0, 4.1, 250.0])
    # Two differences and one quotient are rounded. The difference of a close start and end is exact.
    return Table("vec4(lc_transition(x0.x, x0.y, x0.z))", arguments, transition(*arguments.T), 4.0 * ULP)


def stagger_table() -> Table:
    rng = np.random.default_rng(5)
    arguments = np.hstack([rng.uniform(-200.0, 200.0, (200, 3)), np.full((200, 1), 0.1)]).astype("f4").astype(float)
    arguments[0, :3] = 0.0
    # Three products and three sums of turns up to 352, times the slope 0.4 of the wave.
    return Table("vec4(lc_stagger(x0.xyz, x0.w))", arguments, stagger(arguments[:, :3], 0.1), 0.4 * 6.0 * 352.0 * ULP)


def keep_table() -> Table:
    arguments = grid([0.0, 1.0, 10.0, 10.001, 13.0, 40.0, 300.0, 2e4], [1.0, 10.0], [0.5, 0.25, 0.1, 1e-3])
    expected = kept(*arguments.T)
    # log2 of the ratio, log2 of h, their quotient x, and exp2(x). An error e of x changes λ by the fraction e ln 2.
    x = np.abs(np.log2(expected))
    absolute = 2.0**-21 / np.abs(np.log2(arguments[:, 2]))
    bound = expected * (math.log(2.0) * (absolute + x * 10.0 * ULP) + (3.0 + 2.0 * x) * ULP)
    return Table("vec4(lc_keep(x0.x, x0.y, x0.z))", arguments, expected, bound)


def ramp_table() -> Table:
    ranks = np.concatenate([[-1.0, 0.0], np.linspace(0.0, 0.999, 23), KEEPS * 0.97, KEEPS * 0.99999, KEEPS])
    arguments = grid(ranks, KEEPS)
    # Two differences, the constant 0.05, a product, a quotient: 6 roundings.
    return Table("vec4(lc_ramp(x0.x, x0.y))", arguments, ramp(*arguments.T), 6.0 * ULP)


def growth_table() -> Table:
    arguments = grid([-1.0, 0.0, 0.48, 0.49, 0.6], [0.5, 1.0], [1.0, 3.5])
    rank, keep, scale = arguments.T
    expected = np.where(rank < 0.0, 1.0, scale * ramp(rank, keep))
    return Table("vec4(lc_growth(x0.x, x0.y, x0.z))", arguments, expected, 3.5 * 7.0 * ULP)


def share_table(shares: Floats) -> Table:
    ranks = np.concatenate(
        [np.float32(KNOTS), np.nextafter(np.float32(KNOTS), np.float32(0.0)), np.linspace(0.0, 1.0, 200)]
    )
    arguments = grid(ranks)
    # Knots are exact. The place between two knots and the mean have 6 roundings of numbers up to 1.
    expected = np.interp(arguments[:, 0], KNOTS, shares)
    return Table("vec4(lc_share_below(x0.x, lcShares))", arguments, expected, 6.0 * ULP)


def scale_table(shares: Floats) -> Table:
    arguments = grid(KEEPS)
    drawn = drawn_share(arguments[:, 0], shares)
    # λ(1−ρ) is off by 3 ulp of λ, and the slope of C multiplies this. Then the share and the root are rounded.
    slope = np.array([np.max(np.diff(shares) / np.diff(KNOTS))])
    error = (3.0 * slope * arguments[:, 0] + 8.0 * drawn) * ULP
    bound = error / (2.0 * drawn**1.5) + 4.0 * ULP / np.sqrt(drawn)
    return Table("vec4(lc_area_scale(x0.x, lcShares))", arguments, 1.0 / np.sqrt(drawn), bound)


def bent_table() -> Table:
    """Shares that a texture bends at a pivot: the cutoff where the share is the pivot, and linear on either side."""
    share, pivot, cutoff = grid(np.linspace(0.0, 1.0, 21), [0.02, 0.25, 0.5, 0.8], [0.3, 0.5, 0.6]).T
    above = cutoff + (1.0 - cutoff) * (share - pivot) / (1.0 - pivot)
    alpha = np.where(share < pivot, cutoff * share / pivot, above)
    # Alpha is rounded to f32, then two differences, a product, a quotient and a sum. A slope is at most 2.7.
    arguments = np.stack([alpha, pivot, cutoff], -1)
    return Table("vec4(lc_share(x0.x, x0.y, x0.z))", arguments, share, 12.0 * ULP)


def pivot_table() -> Table:
    """Pivots 0, 1/16, 2/16 … of 16 mip levels."""
    arguments = np.array([[0.0], [0.25], [1.0], [7.5], [14.75], [15.0], [15.5], [40.0]])
    pivots = ", ".join(f"{i}.0 / 16.0" for i in range(16))
    expression = f"vec4(lc_pivot(float[16]({pivots}), x0.x))"
    return Table(expression, arguments, np.minimum(arguments[:, 0], 15.0) / 16.0, 4.0 * ULP)


def place_table() -> Table:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(60, 12)).astype("f4")
    ways = grid([0.0, 0.3, 0.998, 1.0], [0.0, 0.5, 1.0, 7.0])
    arguments = np.concatenate([np.hstack([points, np.tile(way, (60, 1))]) for way in ways]).astype(float)
    position, target, pivot, pivot_target = arguments[:, :12].reshape(-1, 4, 3).transpose(1, 0, 2)
    a, growth = arguments[:, 12:13], arguments[:, 13:14]
    point, centre = (1.0 - a) * position + a * target, (1.0 - a) * pivot + a * pivot_target
    expected = np.pad(centre + (point - centre) * growth, ((0, 0), (0, 1)))
    # Each mean is rounded four times, the difference once, and growth multiplies these. Then a product and a sum.
    greatest = np.abs(arguments[:, :12]).max()
    expression = "vec4(lc_place(x0.xyz, vec3(x0.w, x1.xy), vec3(x1.zw, x2.x), x2.yzw, x3.x, x3.y), 0.0)"
    return Table(expression, arguments, expected, 10.0 * ULP * greatest * (1.0 + growth))


def trend_table(expression: str, greatest: float) -> Table:
    """Return a table for measured numbers, for steep trends and for no trend."""
    numbers = np.float32([[0.0485, 0.0004], [0.1147, -0.0688], [-0.2, 0.03], [0.3, 0.0], [0.0, 0.0]])
    keeps = np.tile(KEEPS, len(numbers))[:, None]
    arguments = np.hstack([keeps, np.repeat(numbers, len(KEEPS), axis=0)]).astype(float)
    keep, first, second = arguments.T
    expected = trend(keep, first, second)
    # The slope of the exponent x multiplies the error of ln λ. Two products and a sum give x. Then exp(x) is rounded.
    logarithm = np.abs(np.log(keep))
    slope = np.abs(first) + 2.0 * np.abs(second) * logarithm
    x = np.abs(first) * logarithm + np.abs(second) * logarithm**2
    off = slope * (2.0**-21 + 3.0 * logarithm * ULP) + 3.0 * x * ULP
    return Table(expression, arguments, np.minimum(expected, greatest), expected * (off + (3.0 + 2.0 * x) * ULP))


def mean_table() -> Table:
    rng = np.random.default_rng(4)
    arguments = np.hstack([rng.uniform(size=(20, 6)), np.linspace(0.0, 1.0, 20)[:, None]]).astype("f4").astype(float)
    color, mean, contrast = arguments[:, :3], arguments[:, 3:6], arguments[:, 6:]
    expected = np.pad(mean + (color - mean) * contrast, ((0, 0), (0, 1)))
    return Table("vec4(lc_toward_mean(x0.xyz, vec3(x0.w, x1.xy), x1.z), 0.0)", arguments, expected, 2.0 * ULP)


def shown_table() -> Table:
    """Return a table of 64 × 64 pixels at each share. Its test has the expected values."""
    arguments = grid(np.arange(64) + 0.5, np.arange(64) + 0.5, [0.0, 0.1, 0.25, 0.5, 0.9, 1.0])
    return Table("vec4(lc_shown(x0.z, x0.xy))", arguments, np.zeros(len(arguments)), 1.0)


HEIGHTS = (np.arange(2000) + 0.5) / 1000 - 1.0
"""Cosines of directions that are spread evenly over the sphere."""
OUTLOOKS = [
    (open_, open_ * (1.0 - open_) * 3.0 * narrow)
    for open_ in (0.05, 0.2, 0.5, 0.7, 0.98)
    for narrow in (0.0, 0.1, 0.5, 0.9, 0.98)
]
"""Mean visibility and length of the bent normal, from a uniformly open sky to nearly a cone."""


def sun_table() -> Table:
    """Return a table of suns in all directions. Its test has the expected values."""
    rows = [(*outlook, height) for outlook in OUTLOOKS for height in HEIGHTS]
    arguments = np.float32(rows).astype(float)
    light = "vec3(sqrt(1.0 - x0.z * x0.z), 0.0, x0.z)"
    return Table(f"vec4(lc_sun_share(x0.x, vec3(0.0, 0.0, x0.y), {light}))", arguments, np.zeros(len(rows)), 1.0)


def uneven_shares() -> Floats:
    """Return the area shares of 500 leaves of several sizes, as f32 like in a file."""
    rng = np.random.default_rng(1)
    areas = rng.uniform(0.2, 3.0, 500)
    ranks = np.arange(500) / 500.0
    return np.float32([areas[ranks < knot].sum() / areas.sum() for knot in KNOTS]).astype(float)


@pytest.fixture(scope="module")
def tables() -> dict[str, tuple[Table, Floats]]:
    """Return each table and its results from GLSL (n, 4) by name. One browser evaluates all tables."""
    shares = uneven_shares()
    asked = {
        "transition": transition_table(),
        "stagger": stagger_table(),
        "keep": keep_table(),
        "ramp": ramp_table(),
        "growth": growth_table(),
        "share": share_table(shares),
        "scale": scale_table(shares),
        "bent": bent_table(),
        "pivot": pivot_table(),
        "place": place_table(),
        "trend": trend_table("vec4(lc_trend(x0.x, x0.yz))", np.inf),
        "contrast": trend_table("vec4(lc_contrast(x0.x, x0.yz))", 1.0),
        "mean": mean_table(),
        "shown": shown_table(),
        "sun": sun_table(),
    }
    questions = [{"expression": table.expression, "rows": table.rows} for table in asked.values()]
    answers = ask(PAGE, {"tables": questions, "shares": shares.tolist()}, patience=PATIENCE)["tables"]
    return {name: (asked[name], np.array(answer, float)) for name, answer in zip(asked, answers, strict=True)}


@pytest.mark.parametrize(
    "name",
    [
        *("transition", "stagger", "keep", "ramp", "growth", "share", "scale", "bent", "pivot", "place", "trend"),
        *("contrast", "mean"),
    ],
)
def test_a_function_follows_its_law(tables: dict[str, tuple[Table, Floats]], name: str) -> None:
    table, found = tables[name]
    columns = table.expected if table.expected.ndim == 2 else np.repeat(table.expected[:, None], 4, axis=1)
    bound = np.broadcast_to(np.reshape(table.bound, (-1, 1)), columns.shape)
    off = np.abs(found - columns)
    worst = np.unravel_index(np.argmax(off - bound), off.shape)
    assert np.isfinite(found).all()
    assert (off <= bound).all(), (table.arguments[worst[0]], found[worst], columns[worst], bound[worst])


def test_a_leaf_at_rest_is_unchanged(tables: dict[str, tuple[Table, Floats]]) -> None:
    """Bit for bit: at a = 0 the place is the position without pruning, and the pivot if the leaf is not drawn."""
    table, found = tables["place"]
    a, growth = table.arguments[:, 12], table.arguments[:, 13]
    assert np.array_equal(found[(a == 0.0) & (growth == 1.0), :3], table.arguments[(a == 0.0) & (growth == 1.0), :3])
    assert np.array_equal(found[(a == 0.0) & (growth == 0.0), :3], table.arguments[(a == 0.0) & (growth == 0.0), 6:9])
    for name in ("keep", "scale"):
        table, found = tables[name]
        assert (found[table.expected == 1.0] == 1.0).all()
    for name in ("trend", "contrast"):
        table, found = tables[name]
        assert (found[table.arguments[:, 0] == 1.0] == 1.0).all()


def test_a_fade_shows_its_share_of_the_pixels(tables: dict[str, tuple[Table, Floats]]) -> None:
    table, found = tables["shown"]
    for share in np.unique(table.arguments[:, 2]):
        shown = found[table.arguments[:, 2] == share, 0].mean()
        # The thresholds are spread evenly along each row, so a row is off by a few pixels at most.
        assert shown == pytest.approx(share, abs=0.01 if 0.0 < share < 1.0 else 0.0)


def test_a_sun_share_has_the_moments_of_the_textures(tables: dict[str, tuple[Table, Floats]]) -> None:
    """Over all directions its mean is the open share of the sky. Its first moment, times three, is the bent normal."""
    _, found = tables["sun"]
    for (open_, toward), shares in zip(OUTLOOKS, found[:, 0].reshape(len(OUTLOOKS), -1), strict=True):
        assert shares.min() >= -1e-6
        assert shares.max() <= 1.0 + 1e-6
        assert (np.diff(shares) >= -1e-6).all(), "a more open direction has less light"
        assert shares.mean() == pytest.approx(open_, abs=2e-4)
        assert 3.0 * (shares * HEIGHTS).mean() == pytest.approx(toward, abs=1e-3)
