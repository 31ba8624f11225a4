//! Pairs of pictures: a random change of all parameters at once and the opposite change, with the difference of their errors credited to the
//! parts that each pixel shows.

use glam::{DVec3, Vec3, Vec4};

use super::picture::{at_both_scales, over_gray};
use crate::error::Result;
use crate::foliage::Foliage;
use crate::metrics::{View, shown_points};

/// A picture with a point in the middle of each pixel.
pub struct Picture {
    /// Codes over gray, with alpha.
    codes: Vec<Vec4>,
    /// `u32::MAX` where nothing is drawn.
    triangles: Vec<u32>,
    size: usize,
}

impl Picture {
    /// Draws triangles with their corners at these local places. `tone`: factors on the colors.
    pub fn new(
        foliage: &Foliage,
        corners: impl Fn(usize) -> [DVec3; 3] + Sync,
        tone: Vec3,
        view: &View,
    ) -> Result<Self> {
        let (colors, triangles) = shown_points(foliage, corners, view)?;
        let codes = colors.into_iter().map(|color| over_gray(color * tone.extend(1.0))).collect();
        Ok(Self { codes, triangles, size: view.size })
    }

    /// Returns for each of `count` owners the squared error of the pixels that show it in either picture, less that in the other picture;
    /// `owner` of a triangle. Over all pixels, the differences add up to that of the whole pictures: e(a) − e(b) = (a − b) · K (a + b − 2 w),
    /// where K weighs single pixels and blocks, and w is the target.
    pub fn credits(&self, other: &Self, target: &Self, count: usize, owner: impl Fn(u32) -> usize) -> Vec<f64> {
        let codes = || self.codes.iter().zip(&other.codes);
        let rest: Vec<Vec4> = codes().zip(&target.codes).map(|((a, b), wanted)| *a + *b - *wanted * 2.0).collect();
        let rest = at_both_scales(&rest, self.size);
        let mut credits = vec![0.0; count];
        for (pixel, (a, b)) in codes().enumerate() {
            let worse = f64::from((*a - *b).dot(rest[pixel]));
            let [one, two] = [self, other].map(|picture| picture.triangles[pixel]);
            let [one, two] = [one, two].map(|triangle| (triangle != u32::MAX).then(|| owner(triangle)));
            for owner in [one, two.filter(|_| two != one)].into_iter().flatten() {
                credits[owner] += worse;
            }
        }
        credits
    }

    /// Returns the side of the picture, and the code of a pixel.
    #[cfg(test)]
    pub fn size(&self) -> usize {
        self.size
    }

    #[cfg(test)]
    pub fn code(&self, pixel: usize) -> [f32; 4] {
        self.codes[pixel].to_array()
    }
}
