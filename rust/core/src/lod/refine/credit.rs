//! The credit of texels: what each contributes to the difference between the pictures of a level and those of its leaves.

use glam::{Vec2, Vec4};

use super::picture::{Target, at_both_scales, over_gray};
use crate::error::Result;
use crate::foliage::Foliage;
use crate::metrics::{View, texture_points};
use crate::textures::{LightGrid, Samples};

/// A texel's share in the difference, at one point of a picture.
#[derive(Clone, Copy)]
pub struct Credit<T> {
    /// Index of the texel on the page.
    pub texel: u32,
    /// What should change, times the weight; the last component is the weight.
    pub value: T,
}

/// Credits in the order of views and points.
#[derive(Default)]
pub struct Credits {
    /// Of colors: towards the leaves' color, in linear light.
    pub colors: Vec<Credit<Vec4>>,
    /// Of alpha: the fall of the squared error if the texel is drawn.
    pub alpha: Vec<Credit<Vec2>>,
}

impl Credits {
    /// Returns the credits of all views, in their order.
    pub fn joined(each: Vec<Self>) -> Self {
        let mut all = Self::default();
        for credits in each {
            all.colors.extend(credits.colors);
            all.alpha.extend(credits.alpha);
        }
        all
    }
}

/// A level at its cutoff, and at a lower and a higher one.
pub struct Drawn {
    pub here: Foliage,
    pub denser: Foliage,
    pub sparser: Foliage,
}

/// Texture coordinates at the points of a picture, with 1; zeros where nothing is drawn.
type TexturePoints = Vec<Vec4>;

impl Drawn {
    /// Returns the credits of one view, with so many points along the side of a pixel.
    pub fn credits(&self, texels: &LightGrid, target: &Target, view: &View, points: usize) -> Result<Credits> {
        // Textures are read at points, as renderers do from nearby: a filter needs pyramids, and each step has another page.
        let fine = View { size: view.size * points, samples: Samples::new(1)?.unfiltered(), ..*view };
        let grid = Grid { size: view.size, points };
        let [here, denser, sparser] = [&self.here, &self.denser, &self.sparser].map(|part| texture_points(part, &fine));
        let (here, denser, sparser) = (here?, denser?, sparser?);
        let shown: Vec<Vec4> = here.iter().map(|point| texels.color_at(point)).collect();
        let Difference { colors, all } = grid.difference(target, &shown);
        let mut credits = Credits { colors: of_colors(texels, &grid, &here, &colors), alpha: Vec::new() };
        for (index, point) in here.iter().enumerate() {
            let rest = all[grid.pixel(index)];
            let change = |other: &Vec4| gain(over_gray(shown[index]), over_gray(texels.color_at(other)), rest, &grid);
            let mut credit = |point: &Vec4, value: f32| {
                credits.alpha.push(Credit { texel: texels.nearest(point), value: Vec2::new(value, 1.0) });
            };
            if differs(&denser[index], point) {
                credit(&denser[index], change(&denser[index]));
            }
            if point.w > 0.0 && differs(&sparser[index], point) {
                credit(point, -change(&sparser[index]));
            }
        }
        Ok(credits)
    }
}

fn differs(a: &Vec4, b: &Vec4) -> bool {
    (a.x, a.y, a.w) != (b.x, b.y, b.w)
}

fn of_colors(texels: &LightGrid, grid: &Grid, here: &TexturePoints, colors: &[Vec4]) -> Vec<Credit<Vec4>> {
    let visible = here.iter().enumerate().filter(|(_, point)| point.w > 0.0);
    visible.map(|(index, point)| Credit { texel: texels.nearest(point), value: colors[grid.pixel(index)] }).collect()
}

/// Returns the fall of the squared error if a point shows `to` in place of `from`; `rest` is what the picture lacks there.
fn gain(from: Vec4, to: Vec4, rest: Vec4, grid: &Grid) -> f32 {
    let change = to - from;
    rest.dot(change) - 0.5 * change.length_squared() * grid.share() / (1.0 + super::picture::BLOCK_WEIGHT)
}

/// A square picture of pixels, with a grid of points in each pixel.
struct Grid {
    size: usize,
    points: usize,
}

/// What a picture lacks.
struct Difference {
    /// Of straight colors where both pictures show something, weighted; with the weights.
    colors: Vec<Vec4>,
    /// Of colors over gray, and of alpha.
    all: Vec<Vec4>,
}

impl Grid {
    /// Returns the pixel of a point.
    fn pixel(&self, point: usize) -> usize {
        let row = self.size * self.points;
        point / row / self.points * self.size + point % row / self.points
    }

    /// Returns the share of a point in its pixel.
    fn share(&self) -> f32 {
        1.0 / (self.points * self.points) as f32
    }

    fn difference(&self, target: &Target, shown: &[Vec4]) -> Difference {
        let (mut colors, mut all) = (Vec::new(), Vec::new());
        for (index, wanted) in target.pixels.iter().enumerate() {
            let found = self.mean(shown, index);
            let weight = wanted.w * found.w;
            colors.push(((wanted - found).truncate() * weight).extend(weight));
            all.push(over_gray(*wanted) - over_gray(found));
        }
        Difference { colors: at_both_scales(&colors, self.size), all: at_both_scales(&all, self.size) }
    }

    /// Returns the mean of a pixel: straight linear light, with alpha.
    fn mean(&self, shown: &[Vec4], pixel: usize) -> Vec4 {
        let (x, y) = (pixel % self.size * self.points, pixel / self.size * self.points);
        let rows = (y..y + self.points).map(|y| y * self.size * self.points + x);
        let points = rows.flat_map(|first| &shown[first..first + self.points]);
        let sum: Vec4 = points.sum();
        (sum.truncate() / sum.w.max(1.0)).extend(sum.w * self.share())
    }
}
