//! Stochastic pruning: the laws of λ, the ramp, the scale and the contrast; the pruning order; the kept leaves.
//!
//! After Cook, Halstead, Planck, Ryu, "Stochastic Simplification of Aggregate Detail" (2007), as Gomez applies it to foliage: leaves have
//! one random order, and the first λN are drawn, enlarged so that the covered area stays. Area, not length, grows by 1/λ.

mod clusters;
mod order;
mod pruned;
mod trend;

pub use clusters::{Cluster, Clusters, HALVINGS, clusters};
pub use order::{PROTECTED, order};
pub use pruned::{Kept, Pruned, pruned};
pub use trend::Trend;

use glam::Vec3;

use crate::sums::Total;

/// Greatest share of the drawn leaves that is growing in or shrinking out.
pub const RAMP: f64 = 0.05;

/// Returns λ(d) = min((d₀/d)^(ln ½ / ln h), 1), the share of leaves drawn at `distance` d, with `start` d₀ > 0 and `half` h in (0, ½];
/// λ(d₀/h) = ½. A small h prunes slowly. With a NaN distance (no camera), all leaves are kept.
#[must_use]
pub fn keep(distance: f64, start: f64, half: f64) -> f64 {
    if distance.is_nan() || distance <= start {
        return 1.0;
    }
    let power = libm::log(0.5) / libm::log(half);
    let ratio = start / distance;
    if ratio >= f64::MIN_POSITIVE || distance.is_infinite() {
        libm::pow(ratio, power).min(1.0)
    } else {
        // The ratio is too small for f64; its power may be representable.
        libm::exp(power * (libm::log(start) - libm::log(distance)))
    }
}

/// Returns the ramp r in [0, 1]: 1 for most drawn leaves; over the last share ρ = min(0.05, 1 − λ) of them it falls linearly to 0 at
/// rank = λ.
#[must_use]
pub fn leaf_scale(rank: f64, keep: f64) -> f64 {
    let width = RAMP.min(1.0 - keep) * keep;
    if rank >= keep {
        0.0
    } else if width > 0.0 {
        ((keep - rank) / width).min(1.0)
    } else {
        1.0
    }
}

/// Returns s = √(ΣA / Σ A·r²), the linear scale of all drawn leaves that keeps the covered area. It is 1 if nothing is pruned or no leaf is
/// left to grow. `leaves` yields (rank, area). Leaves with a negative rank are protected: they do not grow and do not count. O(n).
#[must_use]
pub fn area_scale(leaves: impl Iterator<Item = (f64, f64)> + Clone, keep: f64) -> f64 {
    let (mut all, mut drawn) = (Total::default(), Total::default());
    let leaves = leaves.filter(|&(rank, _)| rank >= 0.0);
    let squared = |rank: f64| leaf_scale(rank, keep).powi(2);
    // Relative to the largest, so that no sum overflows or underflows.
    let largest = leaves.clone().map(|(_, area)| area).fold(0.0, f64::max);
    let largest_drawn = leaves.clone().map(|(rank, area)| area * squared(rank)).fold(0.0, f64::max);
    for (rank, area) in leaves {
        all.add(area / largest);
        drawn.add(area * squared(rank) / largest_drawn);
    }
    if drawn.get() > 0.0 { (all.get() / drawn.get()).sqrt() * (largest.sqrt() / largest_drawn.sqrt()) } else { 1.0 }
}

/// Pruning budget of a scene with many models: distant models lose more leaves.
///
/// `λ′ᵢ = λᵢ · (1 − a · w · ((dᵢ − d_min) / d_range)^p)` with `w = min(d_range / z, 1)` and `p = m / n`. The report prints the exponent as
/// n, but means p, which it defines and does not use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneBudget {
    /// n, the number of visible models, ≥ 0. It is counted softly, so that it does not jump when a model enters the view.
    pub models: f64,
    /// `d_min`, the distance of the nearest model.
    pub nearest: f64,
    /// `d_range`, the distance from the nearest to the farthest model, ≥ 0.
    pub range: f64,
    /// z, the far distance, > 0.
    pub far: f64,
    /// m, the model count at which pruning is linear in distance, > 0. Larger scenes prune more.
    pub full_models: f64,
    /// a, the greatest share of leaves that the farthest model loses, in [0, 1].
    pub strength: f64,
}

impl SceneBudget {
    /// Returns λ′ in [0, λ] of a model at `distance` with its own λ = `keep`. It is monotone in the distance. It is λ if the formula has no
    /// value: a single model, all models at one distance, NaN.
    #[must_use]
    pub fn keep(&self, distance: f64, keep: f64) -> f64 {
        let depth = ((distance - self.nearest) / self.range).min(1.0);
        // 0 to the power of 0 would be 1, but the nearest model loses nothing.
        if depth.is_nan() || depth <= 0.0 {
            return keep;
        }
        let power = libm::pow(depth, self.full_models / self.models);
        let loss = self.strength * (self.range / self.far).min(1.0) * power;
        if loss.is_nan() { keep } else { keep * (1.0 - loss).clamp(0.0, 1.0) }
    }
}

/// Returns c̄ + (c − c̄) κ, the color moved toward the mean.
#[must_use]
pub fn toward_mean(color: Vec3, mean: Vec3, contrast: f32) -> Vec3 {
    if contrast == 1.0 { color } else { mean + (color - mean) * contrast }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_the_leaves_at_start_over_half() {
        for h in [0.5, 0.25, 0.1] {
            assert!((keep(10.0 / h, 10.0, h) - 0.5).abs() < 1e-12);
        }
        assert_eq!([keep(0.0, 10.0, 0.5), keep(10.0, 10.0, 0.5), keep(f64::NAN, 1.0, 0.5)], [1.0; 3]);
        assert_eq!(keep(f64::INFINITY, 10.0, 0.5), 0.0);
        assert!((keep(40.0, 10.0, 0.5) - 0.25).abs() < 1e-12);
    }

    #[test]
    fn the_ramp_is_the_last_twentieth() {
        assert_eq!(leaf_scale(0.0, 0.4), 1.0);
        assert_eq!(leaf_scale(0.37, 0.4), 1.0);
        assert!((leaf_scale(0.39, 0.4) - 0.5).abs() < 1e-12);
        assert_eq!(leaf_scale(0.4, 0.4), 0.0);
        assert_eq!(leaf_scale(0.999, 1.0), 1.0);
        assert_eq!(leaf_scale(0.0, 0.0), 0.0);
    }

    #[test]
    fn area_stays() {
        let leaves: Vec<(f64, f64)> = (0..1000).map(|i| (f64::from(i) / 1000.0, 1.0 + f64::from(i % 7))).collect();
        let total: f64 = leaves.iter().map(|l| l.1).sum();
        for lambda in [1.0, 0.97, 0.5, 0.1, 0.01] {
            let s = area_scale(leaves.iter().copied(), lambda);
            let drawn: f64 = leaves.iter().map(|&(rank, area)| area * (s * leaf_scale(rank, lambda)).powi(2)).sum();
            assert!((drawn / total - 1.0).abs() < 1e-12);
        }
        assert_eq!(area_scale(leaves.iter().copied(), 1.0), 1.0);
        assert_eq!(area_scale(leaves.iter().copied(), 0.0), 1.0);
    }
}
