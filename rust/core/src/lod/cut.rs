//! The width of the leaves on a page, and the alpha cutoff.
//!
//! One page serves all renderers: those that draw alpha as a share (alpha to coverage, alpha hash), and those that cut it out, either with many
//! samples at the texels themselves or with one sample at box-filtered mip levels. Pictures decide, in the views that tune levels:
//!
//! 1. Alpha is bent ([`crate::textures`]) until shares cover as much as the leaves, on the mip levels that are read where the level
//!    takes over. Leaves become wider or narrower by a fraction of a texel: merged onto planes they hide one another more, or less, and a little of
//!    their outlines lies beside the polygons.
//! 2. The cutoff is the one at which the page itself, cut out, covers as much as the leaves. It is near one half.
//! 3. Means of thin leaves fall below one half on mip levels. If the level becomes too sparse there, the cutoff falls, until the level covers
//!    [`NEAR`] where it takes over.
//! 4. If leaves are so thin or so faint that they cover too little even at the lowest cutoff, alpha is bent to make them wider.
//!
//! Known limit: needles much thinner than a pixel are lost on the last of these mip levels for renderers that cut out.

use super::tune::{COVERAGE_ERROR, least_excess};
use crate::error::Result;
use crate::foliage::{AlphaMode, Foliage, Image};
use crate::metrics::{Layered, Reference};
use crate::textures::{Page, bent, mips};

/// Cutoffs at which coverage is measured; it falls evenly between them.
const CUTOFFS: [f64; 4] = [0.3, 0.4, 0.5, 0.6];

/// Step between the cutoffs to choose from.
const STEP: f64 = 0.01;

/// The cutoff at which a straight outline keeps its place.
const USUAL: f64 = 0.5;

/// Range of the alpha that bending moves to one half, and to the lowest cutoff.
const PIVOTS: (f64, f64) = (0.02, 0.95);
const FAINT_PIVOTS: (f64, f64) = (0.005, CUTOFFS[0]);

/// Greatest coverage where the level takes over, for the sake of the mip levels; the limit is 1.03.
const NEAR: f64 = 1.025;

/// Coverage wanted on the mip levels behind; the limit is 0.93.
const FAR: f64 = 0.945;

/// Coverage where the level takes over below which leaves count as too thin.
const TOO_THIN: f64 = 0.98;

/// Mip levels behind the one with texels of a pixel on which the level should stay dense: down to a quarter of its size.
const BEHIND: usize = 2;

/// Billboards whose page is cut out.
pub struct CutOut<'a> {
    /// The billboards in the views of the leaves.
    layered: Layered<'a>,
    /// The mip level with texels of about a pixel where the level takes over.
    mip: usize,
}

/// Returns the mip level that renderers read if a texel of the page is `pixels_per_texel` pixels wide. Between two levels it is mostly the
/// finer one.
pub fn mip_of(pixels_per_texel: f64) -> usize {
    (0.25 - libm::log2(pixels_per_texel.max(f64::MIN_POSITIVE))).floor().max(0.0) as usize
}

impl<'a> CutOut<'a> {
    /// Prepares billboards to be compared with renderings of the leaves. `mip`: the mip level with texels of about a pixel where the level takes
    /// over.
    ///
    /// # Errors
    /// Those of a render.
    pub fn of(billboards: &Foliage, leaves: &'a Reference, mip: usize) -> Result<Self> {
        Ok(Self { layered: leaves.layered(billboards)?, mip })
    }

    /// Returns the page, its cutoff, and its coverage of the leaves. The coverage is that before leaves that are too thin are widened.
    ///
    /// # Errors
    /// None.
    pub fn settled(&self, page: Page) -> Result<(Page, f32, f64)> {
        let page = self.as_shares(page)?;
        let coverage = self.measured(&page);
        if between(&coverage.near[0], CUTOFFS[0]) < TOO_THIN {
            let covered = between(&coverage.near[0], CUTOFFS[0]);
            return Ok((self.widened(page)?, CUTOFFS[0] as f32, covered));
        }
        let cutoff = coverage.best_cutoff();
        Ok((page, cutoff, between(&coverage.near[0], f64::from(cutoff))))
    }

    /// Returns the best cutoff of a page, without changing its alpha.
    #[must_use]
    pub fn cutoff(&self, page: &Page) -> f32 {
        self.measured(page).best_cutoff()
    }

    /// Returns the page with alpha bent until it covers as much as the leaves if it is drawn as a share.
    fn as_shares(&self, page: Page) -> Result<Page> {
        let with = |pivot: f64| bent(&page.base_color, pivot as f32, USUAL as f32);
        let excess = |pivot: f64| {
            // Billboards that slant are read two thirds of a level coarser on average (bench/read_pages.py).
            let levels = mips::of_alpha(&with(pivot), self.mip + 2).into_iter().skip(self.mip);
            let found: Vec<f64> = levels.map(|level| ln(self.layered.coverage(&level, AlphaMode::Blend))).collect();
            Ok(found.iter().sum::<f64>() / found.len().max(1) as f64)
        };
        let base_color = with(least_excess(USUAL, PIVOTS, COVERAGE_ERROR, excess)?);
        Ok(Page { base_color, ..page })
    }

    /// Returns the page with alpha bent until the lowest cutoff shows as much as the leaves.
    fn widened(&self, page: Page) -> Result<Page> {
        let with = |pivot: f64| bent(&page.base_color, pivot as f32, CUTOFFS[0] as f32);
        let cut = AlphaMode::Mask(CUTOFFS[0] as f32);
        let excess = |pivot: f64| Ok(ln(self.layered.coverage(&with(pivot), cut)));
        let base_color = with(least_excess(0.5 * CUTOFFS[0], FAINT_PIVOTS, COVERAGE_ERROR, excess)?);
        Ok(Page { base_color, ..page })
    }

    /// Measures the coverage of a page that is cut out.
    fn measured(&self, page: &Page) -> Measured {
        let levels = mips::of_alpha(&page.base_color, self.mip + BEHIND + 1);
        let of_level = |level: &Image| self.layered.cut_out(level, CUTOFFS.map(|cutoff| cutoff as f32));
        let seen = self.mip.min(levels.len() - 1);
        let of_page = of_level(&levels[0]);
        let of_mip = if seen == 0 { of_page } else { of_level(&levels[seen]) };
        Measured { near: [of_page, of_mip], behind: levels[seen + 1..].iter().map(of_level).collect() }
    }
}

/// Coverage relative to the leaves, at each of [`CUTOFFS`].
struct Measured {
    /// Where the level takes over: on the page itself, with many samples, and on the mip level with texels of a pixel.
    near: [[f64; CUTOFFS.len()]; 2],
    /// On the mip levels behind that.
    behind: Vec<[f64; CUTOFFS.len()]>,
}

impl Measured {
    /// Returns whether the level is dense enough at a cutoff on all mip levels that are seen.
    fn is_dense(&self, cutoff: f64) -> bool {
        let behind = self.behind.iter().all(|of_level| between(of_level, cutoff) >= FAR);
        behind && between(&self.near[1], cutoff) >= TOO_THIN
    }

    /// Returns the cutoff with the coverage of the leaves, or a lower one for the sake of the mip levels.
    fn best_cutoff(&self) -> f32 {
        let steps = ((CUTOFFS[CUTOFFS.len() - 1] - CUTOFFS[0]) / STEP).round() as usize;
        let cutoff = |step: usize| CUTOFFS[0] + STEP * step as f64;
        let off = |step: usize| (between(&self.near[0], cutoff(step)) - 1.0).abs();
        let most = |step: usize| self.near.iter().map(|of| between(of, cutoff(step))).fold(0.0, f64::max);
        let mut best = (0..=steps).min_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap_or(steps);
        while best > 0 && !self.is_dense(cutoff(best)) && most(best - 1) <= NEAR {
            best -= 1;
        }
        cutoff(best) as f32
    }
}

/// Returns the coverage at a cutoff between those at [`CUTOFFS`].
fn between(coverage: &[f64; CUTOFFS.len()], cutoff: f64) -> f64 {
    let place = (cutoff - CUTOFFS[0]) / (CUTOFFS[1] - CUTOFFS[0]);
    let index = (place.max(0.0) as usize).min(CUTOFFS.len() - 2);
    coverage[index] + (coverage[index + 1] - coverage[index]) * (place - index as f64)
}

fn ln(coverage: f64) -> f64 {
    libm::log(coverage.max(1e-9))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mip_level_has_texels_of_a_pixel_or_somewhat_less() {
        for (pixels_per_texel, mip) in [(2.0, 0), (1.0, 0), (0.5, 1), (0.4, 1), (0.3, 1), (0.25, 2), (0.2, 2)] {
            assert_eq!(mip_of(pixels_per_texel), mip, "{pixels_per_texel}");
        }
    }

    #[test]
    fn coverage_between_cutoffs_is_linear() {
        let falling = [1.1, 1.0, 0.8, 0.5];
        for (cutoff, expected) in [(0.3, 1.1), (0.35, 1.05), (0.5, 0.8), (0.55, 0.65), (0.6, 0.5)] {
            assert!((between(&falling, cutoff) - expected).abs() < 1e-9, "{cutoff}");
        }
    }

    #[test]
    fn the_cutoff_keeps_the_coverage_and_falls_for_the_mip_levels_behind() {
        let even = |at_half: f64, slope: f64| CUTOFFS.map(|cutoff| at_half - slope * (cutoff - 0.5));
        let near = [even(1.0, 0.2), even(1.0, 0.2)];
        let cutoff = |behind: [f64; CUTOFFS.len()]| f64::from(Measured { near, behind: vec![behind] }.best_cutoff());
        assert!((cutoff(even(1.0, 0.2)) - 0.5).abs() < 1e-6, "nothing is lost behind");
        // 0.945 is reached at 0.45, and the level covers 1.01 there.
        assert!((cutoff(even(0.895, 1.0)) - 0.45).abs() < 0.011);
        // Never dense enough: as low as 1.025 allows.
        assert!((cutoff(even(0.2, 0.1)) - 0.38).abs() < 0.011);
    }
}
