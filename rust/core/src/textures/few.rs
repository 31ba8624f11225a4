//! Texels of atlas regions that have become too small on a mip level to keep a share of visible texels each.
//!
//! They keep their visible area together: of all their texels those with the most alpha pass, as many as make up that area on the drawn
//! polygons. Each has the mean of all that it covers, also of several regions. Filters make clusters of passing texels larger than they are
//! and single ones smaller, so all of them get the one alpha with which that area is seen on the polygons. O(texels · log texels).

use glam::Vec4;

use super::halves::{halved, texels};
use super::on_polygons::OnPolygons;
use super::raster::Canvas;
use crate::atlas::Region;
use crate::foliage::Image;

/// Least share of a texel under polygons with which it may pass.
const LEAST_DRAWN: f32 = 0.02;

/// Everything on a mip level, whatever region it belongs to.
pub struct Few {
    /// Premultiplied.
    means: Canvas,
    /// For each texel the share that polygons cover.
    drawn: Vec<f32>,
}

impl Few {
    /// Returns level 0. `drawn`: for each texel the share that polygons cover.
    pub fn new(image: &Image, drawn: Vec<f32>) -> Self {
        Self { means: Canvas::of_color(image), drawn }
    }

    /// Goes on to the next level.
    pub fn halve(&mut self) {
        let shares = self.drawn.iter().map(|&share| Vec4::splat(share)).collect();
        let shares = Canvas { width: self.means.width, height: self.means.height, pixels: shares };
        self.drawn = halved(&shares).pixels.into_iter().map(|share| share.x).collect();
        self.means = halved(&self.means);
    }

    /// Returns the texels of the regions `small` that no region of `large` has.
    pub fn texels(&self, small: &[Region], large: &[Region]) -> Vec<usize> {
        let mut wanted = vec![false; self.drawn.len()];
        for (regions, mark) in [(small, true), (large, false)] {
            regions.iter().flat_map(|region| texels(*region, self.means.width)).for_each(|texel| wanted[texel] = mark);
        }
        (0..wanted.len()).filter(|&texel| wanted[texel]).collect()
    }

    /// Returns `owned`, the means of each region for itself, with the means of everything in some texels.
    pub fn mixed(&self, owned: &Canvas, texels: &[usize]) -> Canvas {
        let mut mixed = owned.clone();
        for &texel in texels {
            mixed.pixels[texel] = self.means.pixels[texel];
        }
        mixed
    }

    /// Returns the texels with the most alpha: together they cover `visible` texels of the polygons, at least one. Texels of the same alpha
    /// are sorted by a hash of their position.
    pub fn passing(&self, level: &Image, texels: &[usize], visible: f64) -> Vec<usize> {
        let key = |texel: usize| (std::cmp::Reverse(level.pixels()[texel][3]), scattered(texel), texel);
        let mut order: Vec<usize> = texels.iter().copied().filter(|&texel| self.drawn[texel] > LEAST_DRAWN).collect();
        order.sort_unstable_by_key(|&texel| key(texel));
        let mut sum = 0.0;
        order
            .into_iter()
            .take_while(|&texel| {
                let (before, share) = (sum, f64::from(self.drawn[texel]));
                sum += share;
                before == 0.0 && visible > 0.0 || before + 0.5 * share <= visible // The nearest number of texels.
            })
            .collect()
    }

    /// Gives all passing texels one alpha: the one at which the share `visible` of the polygons shows.
    pub fn lifted(&self, level: Image, passing: &[usize], polygons: &OnPolygons, visible: f64, cutoff: u8) -> Image {
        let mut alpha = level.alpha();
        let mut found = |code: u8| {
            for &texel in passing {
                alpha[texel] = code;
            }
            polygons.share(&alpha, self.means.width, cutoff)
        };
        let (mut low, mut high) = (cutoff, u8::MAX);
        while high - low > 1 {
            let middle = u8::midpoint(low, high);
            if found(middle) < visible {
                low = middle;
            } else {
                high = middle;
            }
        }
        for &texel in passing {
            alpha[texel] = high;
        }
        level.with_alpha(alpha)
    }
}

/// Returns a hash of a texel's position.
pub fn scattered(texel: usize) -> u32 {
    (texel as u32).wrapping_mul(0x9E37_79B1).rotate_left(13).wrapping_mul(0x85EB_CA6B)
}
