//! What the polygons of an atlas page show at an alpha cutoff, on any mip level: looked up at places that are spread evenly over them.

use glam::Vec2;

use super::few::scattered;
use super::halves::texels;
use crate::atlas::{Atlas, Billboard, Region};

/// Steps from one place in its texel to the next, modulo 1: places are spread evenly (R₂ sequence).
const SPREAD: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

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

/// Places on the polygons, in shares of the page.
pub struct OnPolygons(Vec<Vec2>);

impl OnPolygons {
    /// `drawn`: for each texel of a page of this width the share that polygons cover. `most`: number of places.
    pub fn new(drawn: &[f32], width: usize, most: usize) -> Self {
        let size = Vec2::new(width as f32, (drawn.len() / width) as f32);
        let place = |(number, texel): (usize, usize)| {
            let corner = Vec2::new((texel % width) as f32, (texel / width) as f32);
            (corner + (number as f32 * SPREAD).fract()) / size
        };
        let on_polygons: Vec<usize> = (0..drawn.len()).filter(|&texel| drawn[texel] > 0.5).collect();
        let step = on_polygons.len().div_ceil(most).max(1);
        // One texel of each stride, not always the same: strides may fit the rows of the page.
        let texel = |stride: &[usize], number: usize| stride[scattered(number) as usize % stride.len()];
        Self(
            on_polygons
                .chunks(step)
                .enumerate()
                .map(|(number, stride)| place((number, texel(stride, number))))
                .collect(),
        )
    }

    /// Returns the share of the polygons on which alpha reaches the cutoff, with alpha interpolated between texel centers.
    pub fn share(&self, alpha: &[u8], width: usize, cutoff: u8) -> f64 {
        let [share] = self.shares(|place| filtered(alpha, width, place), [cutoff]);
        share
    }

    /// Returns the share for each cutoff halfway between two mip levels, each alpha and width: for trilinear filters.
    pub fn shares_between<const N: usize>(&self, [fine, coarse]: [(&[u8], usize); 2], cutoffs: [u8; N]) -> [f64; N] {
        let mean = |place| 0.5 * (filtered(fine.0, fine.1, place) + filtered(coarse.0, coarse.1, place));
        self.shares(mean, cutoffs)
    }

    /// Returns the mean of the shares for surfaces seen from the front and from two slanting directions: anisotropic filters take the mean
    /// of two places a texel apart there.
    pub fn shares_slanting<const N: usize>(&self, alpha: &[u8], width: usize, cutoffs: [u8; N]) -> [f64; N] {
        let height = alpha.len() / width;
        let mean =
            |place, half: Vec2| 0.5 * (filtered(alpha, width, place - half) + filtered(alpha, width, place + half));
        let halves = [Vec2::ZERO, Vec2::new(0.5 / width as f32, 0.0), Vec2::new(0.0, 0.5 / height as f32)];
        let of_each = halves.map(|half| self.shares(|place| mean(place, half), cutoffs));
        std::array::from_fn(|n| of_each.iter().map(|shares| shares[n]).sum::<f64>() / of_each.len() as f64)
    }

    /// Returns for each cutoff the share of the polygons that is shown either by the page, at its own cutoff, or by a level, but not by both.
    pub fn differences<const N: usize>(
        &self,
        (page, width, own): (&[u8], usize, u8),
        level: (&[u8], usize),
        cutoffs: [u8; N],
    ) -> [f64; N] {
        let shown = |&place: &Vec2| filtered(page, width, place) >= f32::from(own);
        let found: Vec<(bool, f32)> =
            self.0.iter().map(|place| (shown(place), filtered(level.0, level.1, *place))).collect();
        cutoffs.map(|cutoff| {
            let differs = |(shown, alpha): &&(bool, f32)| *shown != (*alpha >= f32::from(cutoff));
            found.iter().filter(differs).count() as f64 / found.len().max(1) as f64
        })
    }

    /// Returns for each cutoff the share of the places where a value reaches it.
    fn shares<const N: usize>(&self, value: impl Fn(Vec2) -> f32, cutoffs: [u8; N]) -> [f64; N] {
        let mut counts = [0usize; N];
        for &place in &self.0 {
            let found = value(place);
            for (count, cutoff) in counts.iter_mut().zip(cutoffs) {
                *count += usize::from(found >= f32::from(cutoff));
            }
        }
        counts.map(|count| count as f64 / self.0.len().max(1) as f64)
    }
}

/// Returns alpha at a place, in shares of the page, interpolated between texel centers.
fn filtered(alpha: &[u8], width: usize, place: Vec2) -> f32 {
    let size = Vec2::new(width as f32, (alpha.len() / width) as f32);
    let at = |x: f32, y: f32| {
        let column = x.clamp(0.0, size.x - 1.0) as usize;
        f32::from(alpha[y.clamp(0.0, size.y - 1.0) as usize * width + column])
    };
    let place = place * size - 0.5;
    let low = place.floor();
    let share = place - low;
    let row = |y: f32| at(low.x, y) + (at(low.x + 1.0, y) - at(low.x, y)) * share.x;
    row(low.y) + (row(low.y + 1.0) - row(low.y)) * share.y
}
