//! What the levels of a tree cost to draw.
//!
//! Of trunks only thin branches count, because some clouds show them ([`crate::twigs`]) and others leave them to their trunks. Trunks are simplified
//! later, beside the levels: to about half beside leaves, and to as many triangles as a cloud has.

use glam::DVec3;
use leafcloud::error::Result;
use leafcloud::lod::LEAST_SAVING;
use leafcloud::metrics::{DrawingCost, drawing_cost};
use leafcloud::{Foliage, Progress};

use crate::scene::Scene;

/// Diameter of the crown in pixels where a level takes over at the latest.
pub const LEAST_CROWN: f64 = 16.0;

/// Fragments that a level may draw over the leaves', for crowns of at least [`FEW_PIXELS`]. Triangles cost more than fragments in smaller ones.
const MOST_FRAGMENTS: f64 = 1.25;
const FEW_PIXELS: f64 = 100.0;

/// Fewest triangles of a simplified trunk.
pub const FEWEST_OF_TRUNKS: usize = 250;

/// What a level costs in each ring of a scene.
#[derive(Clone, Debug)]
pub struct Prices {
    /// Diameters of the crown in pixels, descending.
    sizes: Vec<f64>,
    fragments: Vec<f64>,
    /// In fragments, with all triangles.
    pub totals: Vec<f64>,
}

impl Prices {
    /// Returns the prices of parts of a tree with this radius.
    ///
    /// # Errors
    /// Those of [`drawing_cost`].
    pub fn of(parts: &[&Foliage], radius: f64, up: DVec3, scene: &Scene) -> Result<Self> {
        let cost = |size: f64| drawing_cost(parts, 0.5 * size / radius, up, Progress::silent());
        let sizes: Vec<f64> = scene.sizes().collect();
        let costs = sizes.iter().map(|&size| cost(size)).collect::<Result<Vec<_>>>()?;
        let fragments = costs.iter().map(|cost| cost.fragments).collect();
        Ok(Self { sizes, fragments, totals: costs.iter().map(DrawingCost::total).collect() })
    }

    /// Returns fragments and total where the crown is `size` pixels large: linear in the logarithm of the size between the rings.
    fn at(&self, size: f64) -> (f64, f64) {
        let after = self.sizes.partition_point(|&larger| larger > size).clamp(1, self.sizes.len() - 1);
        let [near, far] = [self.sizes[after - 1], self.sizes[after]];
        let share = (libm::log(near / size) / libm::log(near / far)).clamp(0.0, 1.0);
        let between = |values: &[f64]| values[after - 1] + share * (values[after] - values[after - 1]);
        (between(&self.fragments), between(&self.totals))
    }

    /// Returns the largest diameter of the crown in pixels, up to `crown`, at which a level is cheaper to draw than the level before it, and, where
    /// fragments cost most, draws at most [`MOST_FRAGMENTS`] times those of the tree's own leaves. Between two sizes the cost over the allowed one is
    /// taken as linear in the logarithm of the size.
    #[must_use]
    pub fn cheaper_from(&self, crown: f64, before: &Self, leaves: &Self) -> f64 {
        let (mut size, mut larger) = (crown, None);
        while size > LEAST_CROWN {
            let [own, before, leaves] = [self, before, leaves].map(|prices| prices.at(size));
            let of_fragments = if size < FEW_PIXELS { 0.0 } else { own.0 / (MOST_FRAGMENTS * leaves.0) };
            let excess = f64::max(own.1 / ((1.0 - LEAST_SAVING) * before.1), of_fragments);
            if excess <= 1.0 {
                let between =
                    |(above, over): (f64, f64)| size * libm::pow(above / size, (1.0 - excess) / (over - excess));
                return larger.map_or(size, between);
            }
            larger = Some((size, excess));
            size /= std::f64::consts::SQRT_2;
        }
        size.max(LEAST_CROWN.min(crown))
    }

    /// Returns whether the level costs at most half of another one where the crown is `size` pixels large.
    #[must_use]
    pub fn is_half_of(&self, other: &Self, size: f64) -> bool {
        self.at(size).1 <= 0.5 * other.at(size).1
    }
}

/// Returns at most `most` of the triangles, from all over the trunk.
#[must_use]
pub fn some(triangles: &[u32], most: usize) -> Vec<u32> {
    triangles.iter().copied().step_by(triangles.len().div_ceil(most.max(1)).max(1)).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Prices of a level that draws `fragments` for each pixel of the crown's square.
    pub fn prices(fragments: f64, triangles: f64) -> Prices {
        let sizes: Vec<f64> = Scene::to(300.0).unwrap().sizes().collect();
        let fragments: Vec<f64> = sizes.iter().map(|size| fragments * size * size).collect();
        let totals = fragments.iter().map(|fragments| fragments + 8.0 * triangles).collect();
        Prices { sizes, fragments, totals }
    }

    #[test]
    fn a_level_takes_over_where_it_is_a_tenth_cheaper() {
        // 3 d² + 8 · 100 = 0.9 · (2 d² + 8 · 2000), so d = 107.
        let (leaves, level) = (prices(2.0, 2000.0), prices(3.0, 100.0));
        let exact = f64::sqrt(8.0 * (0.9 * 2000.0 - 100.0) / (3.0 - 1.8));
        let found = level.cheaper_from(80.0, &leaves, &leaves);
        assert_eq!(found, 80.0);
        // Above 100 pixels its fragments, 1.5 times the leaves', are too many.
        let found = level.cheaper_from(540.0, &leaves, &leaves);
        assert!(exact > 100.0 && (90.0..=107.0).contains(&found), "{found}");
        assert!(level.is_half_of(&leaves, 40.0) && !level.is_half_of(&leaves, 540.0));
    }

    #[test]
    fn some_triangles_are_from_all_over() {
        let all: Vec<u32> = (0..100).collect();
        assert_eq!(some(&all, 4), [0, 25, 50, 75]);
        assert_eq!(some(&all, 100), all);
        assert_eq!(some(&all[..3], 2), [0, 2]);
        assert!(some(&[], 5).is_empty() && some(&all, 0).len() == 1);
    }
}
