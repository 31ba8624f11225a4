//! The laws of pruning and transition at the ends of their ranges.

use glam::Vec3;
use leafcloud::prune::{SceneBudget, Trend, area_scale, keep, leaf_scale, toward_mean};
use leafcloud::transition::{switch_distance, transition};

use crate::common::exact::{sum, ulps};
use crate::common::random::Random;
use crate::common::stability::{case, worse};

const GROUP: &str = "Values";
const CLOSED: &str = "closed form";

#[test]
fn the_share_of_leaves() {
    case(GROUP, "λ at d = 0, at d₀, at a distance of NaN", "closed form: 1")
        .equals([keep(0.0, 10.0, 0.5), keep(10.0, 10.0, 0.5), keep(f64::NAN, 10.0, 0.5)], [1.0; 3]);
    case(GROUP, "λ at d → ∞", "closed form: 0")
        .equals([keep(f64::INFINITY, 10.0, 0.5), keep(f64::MAX, 1e-300, 0.5)], [0.0; 2]);
    // h = ½ is d₀/d itself.
    let halves = (1..60).map(|i| 10.0 * 2f64.powi(i)).map(|d| ulps(keep(d, 10.0, 0.5), 10.0 / d)).fold(0.0, worse);
    case(GROUP, "λ for h = ½, in ulps", "closed form: d₀/d").holds(halves, 1.0);
    let at_half = [0.5, 0.25, 1e-3, 1e-8, 1e-30, f64::MIN_POSITIVE];
    let worst = at_half.map(|h| (keep(3.0 / h, 3.0, h) - 0.5).abs()).into_iter().fold(0.0, worse);
    // ln h is rounded, and d₀/h is raised to ln ½ / ln h: the errors of both logarithms, each an ulp at up to 709, relative to 1.
    case(GROUP, "λ(d₀/h) for h down to 10⁻³⁰⁸", "closed form: ½").holds(worst, 4.0 * f64::EPSILON);
    let slow = keep(1e6, 1.0, 1e-300);
    case(GROUP, "λ for h → 0 prunes slowly", "closed form: (10⁻⁶)^(ln ½ / ln h)")
        .holds((slow - (-6.0 * 0.5f64.ln() / -300.0).exp()).abs(), 1e-14);
    // d₀/d underflows f64, but its power does not: exp(−616 ln 10 · ln ½ / ln 10⁻³⁰⁰).
    let vast = keep(1e308, 1e-308, 1e-300);
    case(GROUP, "λ where d₀/d underflows", "closed form: 2^(−616/300)")
        .holds((vast - 2f64.powf(-616.0 / 300.0)).abs(), 1e-12);
    let mut falls = true;
    for i in 0..10_000 {
        falls &= keep(f64::from(i + 1) * 0.01, 3.0, 0.3) <= keep(f64::from(i) * 0.01, 3.0, 0.3);
    }
    case(GROUP, "λ never grows with distance", "definition").equals(falls, true);
}

#[test]
fn the_ramp_and_the_scale() {
    let equal = |n: u32| (0..n).map(move |i| (f64::from(i) / f64::from(n), 1.0));
    case(GROUP, "ramp and scale at λ = 1", "definition: nothing changes")
        .equals([area_scale(equal(7), 1.0), leaf_scale(0.999_999, 1.0), leaf_scale(0.0, 1.0)], [1.0; 3]);
    case(GROUP, "λ·N < 1: nothing is left to grow", "definition: the scale is finite")
        .equals(area_scale(equal(3).skip(1), 0.2), 1.0);
    case(GROUP, "λ·N < 1: the first of three equal leaves replaces all", "closed form: √3")
        .holds((area_scale(equal(3), 0.2) - 3f64.sqrt()).abs(), 4e-16);
    case(GROUP, "one leaf at λ·N < 1 is on its ramp's top", "closed form: 1").equals(leaf_scale(0.0, 1e-3), 1.0);
    let vast = [0.0, 0.3, 0.6].map(|rank| (rank, 1e308));
    case(GROUP, "areas whose sum is beyond f64", "closed form: three leaves, two of them drawn, at λ = ½")
        .holds((area_scale(vast.into_iter(), 0.5) - 1.5f64.sqrt()).abs(), 4e-16);
    let unlike = [(0.6, 1e308), (0.3, 1e-20)];
    case(GROUP, "a tiny leaf drawn in place of one with 10³²⁸ times its area, relative error", "closed form: 10¹⁶⁴")
        .holds((area_scale(unlike.into_iter(), 0.5) / 1e164 - 1.0).abs(), 1e-14);
    case(GROUP, "no leaves at all", "definition: 1").equals(area_scale(std::iter::empty(), 0.3), 1.0);
    let mut random = Random(3);
    let leaves: Vec<(f64, f64)> =
        (0..5000).map(|i| (f64::from(i) / 5000.0, 10f64.powf(random.signed() * 6.0))).collect();
    let mut worst: f64 = 0.0;
    for lambda in [1.0, 1.0 - 1e-16, 0.999, 0.5, 0.05, 1e-3, 2.1e-4] {
        let s = area_scale(leaves.iter().copied(), lambda);
        let drawn = sum(leaves.iter().map(|&(rank, area)| area * leaf_scale(rank, lambda).powi(2)));
        worst = worse(worst, (s * s * drawn / sum(leaves.iter().map(|l| l.1)) - 1.0).abs());
    }
    case(GROUP, "area kept by pruning, sizes over twelve orders of magnitude", "exact sums").holds(worst, 1e-12);
    let steps = (0..=10_000).map(|i| leaf_scale(0.4, f64::from(i) / 10_000.0)).collect::<Vec<_>>();
    let jump = steps.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, worse);
    // At λ just above 0.4 the ramp is 0.05 · 0.4 wide.
    case(GROUP, "a leaf grows in without a jump as λ rises by 10⁻⁴", "closed form: the ramp's slope")
        .holds(jump, 1e-4 / (0.05 * 0.4) * 1.01);
}

#[test]
fn the_transition() {
    let a = |d: f64| transition(d, 2.0, 4.0);
    case(GROUP, "a before its start, after its end, at ±∞", "closed form: 0 and 1")
        .equals([a(-1.0), a(f64::NEG_INFINITY), a(5.0), a(f64::INFINITY)], [0.0, 0.0, 1.0, 1.0]);
    case(GROUP, "a for a camera at NaN", "definition: the leaves")
        .equals([a(f64::NAN), transition(f64::NAN, 4.0, 2.0)], [0.0; 2]);
    case(GROUP, "a where start and end meet, and where they cross", "definition: a step at the end").equals(
        [transition(1.0, 2.0, 2.0), transition(2.0, 2.0, 2.0), transition(1.9, 3.0, 2.0), transition(2.0, 3.0, 2.0)],
        [0.0, 1.0, 0.0, 1.0],
    );
    let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, 3.0];
    let mut within = true;
    for distance in odd {
        for start in odd {
            within &= odd.iter().all(|&end| (0.0..=1.0).contains(&transition(distance, start, end)));
        }
    }
    case(GROUP, "a for distances and limits that are infinite or NaN", "definition: within [0, 1]")
        .equals(within, true);
    let (low, high) = (-1e308, 1.7e308);
    case(GROUP, "a between limits whose difference is beyond f64", "closed form: 1/2.7, 2/2.7").holds(
        (transition(0.0, low, high) - 1.0 / 2.7).abs().max((transition(1e308, low, high) - 2.0 / 2.7).abs()),
        1e-15,
    );
    let inside = (0..1000).map(|i| a(f64::from(i) * 0.01)).all(|a| (0.0..=1.0).contains(&a));
    case(GROUP, "a stays within [0, 1]", "definition").equals(inside, true);
    let worst = [1e-30, 1e-6, 1.0, 1e30].map(|deviation| {
        let d = switch_distance(deviation, 8.0, 1000.0, std::f64::consts::FRAC_PI_2);
        (d / (deviation * 1000.0 / 16.0) - 1.0).abs()
    });
    case(GROUP, "switch distance over sixty orders of magnitude", CLOSED)
        .holds(worst.into_iter().fold(0.0, worse), 4.0 * f64::EPSILON);
}

#[test]
fn the_scene_budget() {
    let scene =
        SceneBudget { models: 100.0, nearest: 10.0, range: 90.0, far: 100.0, full_models: 100.0, strength: 0.5 };
    case(GROUP, "one model, or all models at one distance", "definition: λ′ = λ").equals(
        [
            SceneBudget { range: 0.0, models: 1.0, ..scene }.keep(10.0, 0.7),
            SceneBudget { range: 0.0, ..scene }.keep(10.0, 0.3),
        ],
        [0.7, 0.3],
    );
    case(GROUP, "the nearest model loses nothing, whatever n and m are", "closed form: λ′ = λ").equals(
        [1e-9, 1.0, 1e9, f64::INFINITY].map(|models| SceneBudget { models, ..scene }.keep(10.0, 0.8)),
        [0.8; 4],
    );
    let farthest = [1e-9, 1.0, 100.0, 1e9]
        .map(|models| (SceneBudget { models, ..scene }.keep(100.0, 0.8) - 0.8 * (1.0 - 0.5 * 0.9)).abs());
    case(GROUP, "the farthest model loses a·w, n ≫ m or not", "closed form")
        .holds(farthest.into_iter().fold(0.0, worse), 1e-15);
    case(GROUP, "w in a scene deeper than z", "definition: at most 1")
        .equals(SceneBudget { far: 1.0, strength: 1.0, ..scene }.keep(100.0, 0.8), 0.0);
    let not_numbers = [f64::NAN, f64::INFINITY, -5.0].map(|d| scene.keep(d, 0.6)).into_iter().chain([
        SceneBudget { far: 0.0, ..scene }.keep(50.0, 0.6),
        SceneBudget { models: 0.0, ..scene }.keep(50.0, 0.6),
        SceneBudget { full_models: 0.0, ..scene }.keep(50.0, 0.6),
        SceneBudget { nearest: f64::NAN, ..scene }.keep(50.0, 0.6),
    ]);
    let within = not_numbers.into_iter().all(|l| (0.0..=0.6).contains(&l));
    case(GROUP, "distances and counts of 0, ∞ and NaN", "definition: 0 ≤ λ′ ≤ λ").equals(within, true);
    let values: Vec<f64> = (0..=900).map(|i| scene.keep(10.0 + f64::from(i) * 0.1, 0.8)).collect();
    case(GROUP, "λ′ never grows with distance", "definition").equals(values.windows(2).all(|w| w[1] <= w[0]), true);
}

#[test]
fn contrast_kept() {
    let wild = Trend { first: -3.0, second: 0.7 };
    case(GROUP, "γ and κ at λ = 1, and everywhere with coefficients of 0", "closed form: 1")
        .equals([wild.factor(1.0), Trend::default().factor(0.005), Trend::default().factor(1e-300)], [1.0; 3]);
    case(GROUP, "γ and κ at λ down to the cut-off, however steep", "definition: finite, not negative")
        .equals([1.0, 0.3, 0.005].map(|keep| wild.factor(keep).is_finite() && wild.factor(keep) >= 0.0), [true; 3]);
    let color = Vec3::new(0.1, 0.7, 0.3);
    case(GROUP, "contrast with one leaf, or all leaves of one color", "definition: nothing changes")
        .equals([toward_mean(color, color, 0.0), toward_mean(color, color, 0.37)], [color; 2]);
    case(GROUP, "contrast at κ = 1 and κ = 0", "closed form: the color, the mean")
        .equals([toward_mean(color, Vec3::ONE, 1.0), toward_mean(color, Vec3::ONE, 0.0)], [color, Vec3::ONE]);
}
