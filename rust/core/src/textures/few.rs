//! Texels of atlas regions that have become too small on a mip level to keep a share of visible texels each.
//!
//! They keep their visible area together: of all their texels those with the most alpha pass, as many as make up that area on the drawn
//! polygons. Each has the mean of all that it covers, also of several regions. Filters make clusters of passing texels larger than they are
//! and single ones smaller, so all of them get the one alpha with which that area is seen on the polygons. O(texels · log texels).

use glam::{Vec2, Vec4};

use super::halves::{halved, texels};
use super::raster::Canvas;
use crate::atlas::{Atlas, Billboard, Region};
use crate::foliage::Image;

/// Most places on the polygons at which alpha is measured.
const SAMPLES: usize = 1 << 16;

/// Steps from one place in its texel to the next, modulo 1: places are spread evenly (R₂ sequence).
const SPREAD: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

/// Least share of a texel under polygons with which it may pass.
const LEAST_DRAWN: f32 = 0.02;

/// Returns 1 for each texel of the page with its center on a polygon, else 0.
pub fn drawn_texels(atlas: &Atlas) -> Vec<f32> {
    let mut drawn = vec![0.0; atlas.size.texels()];
    for billboard in &atlas.billboards {
        for texel in texels(billboard.region, atlas.size.width) {
            let at = [texel % atlas.size.width, texel / atlas.size.width];
            drawn[texel] = f32::from(u8::from(covers(billboard, at)));
        }
    }
    drawn
}

/// Returns whether a polygon of the billboard covers the center of a texel of its region.
fn covers(billboard: &Billboard, [column, row]: [usize; 2]) -> bool {
    let Region { x, y, width, height } = billboard.region;
    let across = ((column - x) as f64 + 0.5) / width as f64;
    let up = 1.0 - ((row - y) as f64 + 0.5) / height as f64;
    billboard.polygons.iter().any(|polygon| {
        let sides = polygon.iter().zip(polygon.iter().cycle().skip(1));
        let crossed =
            sides.filter(|(a, b)| (a.y > up) != (b.y > up) && across < a.x + (b.x - a.x) * (up - a.y) / (b.y - a.y));
        crossed.count() % 2 == 1
    })
}

/// Everything on a mip level, whatever region it belongs to.
pub struct Few {
    /// Premultiplied.
    means: Canvas,
    /// For each texel the share that polygons cover.
    drawn: Vec<f32>,
    /// Places on the polygons, in shares of the page, evenly spread.
    samples: Vec<Vec2>,
}

impl Few {
    /// Returns level 0. `drawn`: for each texel the share that polygons cover.
    pub fn new(image: &Image, drawn: Vec<f32>) -> Self {
        let size = Vec2::new(image.width() as f32, image.height() as f32);
        let place = |(number, texel): (usize, usize)| {
            let corner = Vec2::new((texel % image.width()) as f32, (texel / image.width()) as f32);
            (corner + (number as f32 * SPREAD).fract()) / size
        };
        let on_polygons: Vec<usize> = (0..drawn.len()).filter(|&texel| drawn[texel] > 0.5).collect();
        let step = on_polygons.len().div_ceil(SAMPLES).max(1);
        let samples = on_polygons.into_iter().step_by(step).enumerate().map(place).collect();
        Self { means: Canvas::of_color(image), drawn, samples }
    }

    /// Returns the share of the polygons on which alpha reaches the cutoff, with alpha interpolated between texel centers.
    pub fn visible(&self, alpha: &[u8], width: usize, cutoff: u8) -> f64 {
        let height = alpha.len() / width;
        let size = Vec2::new(width as f32, height as f32);
        let at = |x: f32, y: f32| {
            let column = x.clamp(0.0, size.x - 1.0) as usize;
            f32::from(alpha[y.clamp(0.0, size.y - 1.0) as usize * width + column])
        };
        let shows = |&&place: &&Vec2| {
            let place = place * size - 0.5;
            let low = place.floor();
            let share = place - low;
            let row = |y: f32| at(low.x, y) + (at(low.x + 1.0, y) - at(low.x, y)) * share.x;
            row(low.y) + (row(low.y + 1.0) - row(low.y)) * share.y >= f32::from(cutoff)
        };
        self.samples.iter().filter(shows).count() as f64 / self.samples.len().max(1) as f64
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

    /// Gives all passing texels one alpha: the one at which the share `visible` of the polygons reaches the cutoff.
    pub fn lifted(&self, level: Image, passing: &[usize], visible: f64, cutoff: u8) -> Image {
        let mut alpha = level.alpha();
        let mut found = |code: u8| {
            for &texel in passing {
                alpha[texel] = code;
            }
            self.visible(&alpha, self.means.width, cutoff)
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
