//! The texels of a page while it is refined.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::credit::{Credit, Credits};
use super::picture::{light, sums};
use crate::atlas::{Atlas, Region};
use crate::color::{encode, quantise};
use crate::foliage::Image;
use crate::groups::Groups;

/// Base color in linear light, and alpha.
pub struct Texels {
    width: usize,
    height: usize,
    /// Straight colors, and alpha.
    values: Vec<Vec4>,
    /// The colors at the start.
    start: Vec<Vec3>,
    /// The cutoff at the start, and the factors by which differences of alpha from it are smaller than on the page.
    cutoff: f32,
    slopes: Vec<f32>,
}

/// How far texels move in a step.
#[derive(Clone, Copy)]
pub struct Rates {
    /// Share of the way to the color that the leaves have.
    color: f32,
    /// Greatest change of alpha.
    alpha: f32,
}

impl Rates {
    /// Returns rates that fall with the steps, so that the steps come to rest although each has other views.
    pub fn of_step(step: usize) -> Self {
        let slower = 1.0 / (1.0 + 0.25 * step as f32);
        Self { color: 0.8 * slower, alpha: 0.1 * slower }
    }
}

/// A texel takes the mean credit of all texels within this distance along rows and columns, because few views show a single texel.
const REACH: usize = 2;

/// Weight of staying as it is, beside the credits around a texel.
const PRIOR: f32 = 2.0;

/// Greatest factor on a color, and the light that it may always gain.
const FARTHEST: f32 = 2.5;
const FAINT: f32 = 0.01;

/// Share of the difference between alpha and the cutoff that stays at an edge.
const AT_EDGES: f32 = 0.1;

impl Texels {
    /// Returns the texels of a page, with the edges of its leaves widened: the less alpha differs from the cutoff, the nearer an edge is.
    /// Outlines stay, because they are where there is no difference. So edges can move by several texels, as with textures of distances
    /// (Green, "Improved Alpha-Tested Magnification for Vector Textures and Special Effects", 2007).
    pub fn of(image: &Image, atlas: &Atlas, cutoff: f32) -> Self {
        let values: Vec<Vec4> = image.pixels().iter().copied().map(light).collect();
        let start = values.iter().map(|texel| texel.truncate()).collect();
        let slopes = vec![1.0; values.len()];
        let mut page = Self { width: image.width(), height: image.height(), values, start, cutoff, slopes };
        let fields = atlas.regions().map(|region| Field { region, width: page.width }).collect::<Vec<_>>();
        let slopes: Vec<Vec<f32>> = fields.par_iter().map(|field| page.slopes(field)).collect();
        for (field, slopes) in fields.iter().zip(slopes) {
            for (place, slope) in slopes.into_iter().enumerate() {
                let texel = field.texel(place);
                page.slopes[texel] = slope;
                page.values[texel].w = cutoff + (page.values[texel].w - cutoff) * slope;
            }
        }
        page
    }

    /// Returns the slopes of a billboard's alpha: small near edges, 1 far from them.
    fn slopes(&self, field: &Field) -> Vec<f32> {
        let Region { width, height, .. } = field.region;
        // The share of drawn texels around a texel, with the number of all.
        let is_drawn = |place: usize| f32::from(u8::from(self.values[field.texel(place)].w >= self.cutoff));
        let mut drawn: Vec<Vec4> = (0..width * height).map(|place| Vec4::new(is_drawn(place), 0.0, 0.0, 1.0)).collect();
        for _ in 0..2 {
            drawn = around(&drawn, width, height);
        }
        let slope = |drawn: &Vec4| AT_EDGES + (1.0 - AT_EDGES) * (2.0 * drawn.x / drawn.w - 1.0).abs();
        drawn.iter().map(slope).collect()
    }

    /// Multiplies all colors. Rounded to codes, colors keep their mean only if they vary in fractions of a code, as these do.
    pub fn scale(&mut self, factors: Vec3) {
        self.values.par_iter_mut().for_each(|texel| *texel *= factors.extend(1.0));
        self.start.par_iter_mut().for_each(|start| *start *= factors);
    }

    /// Returns the image with widened edges, for drawing the steps.
    pub fn widened(&self) -> Image {
        self.image(|_, alpha| alpha)
    }

    /// Returns the page's image, with edges as steep as they were at the start.
    pub fn page(&self) -> Image {
        self.image(|texel, alpha| self.cutoff + (alpha - self.cutoff) / self.slopes[texel])
    }

    fn image(&self, alpha: impl Fn(usize, f32) -> f32 + Sync) -> Image {
        let pixel = |(index, texel): (usize, &Vec4)| {
            [encode(texel.x), encode(texel.y), encode(texel.z), quantise(alpha(index, texel.w))]
        };
        let pixels: Vec<[u8; 4]> = self.values.par_iter().enumerate().map(pixel).collect();
        Image::new(self.width, self.height, pixels).expect("as many texels as before")
    }

    /// Returns the index of the texel at a point.
    pub fn nearest(&self, point: &Vec4) -> usize {
        let column = (point.x * self.width as f32) as usize;
        let row = ((1.0 - point.y) * self.height as f32) as usize;
        row.min(self.height - 1) * self.width + column.min(self.width - 1)
    }

    /// Returns the color at a point, between its four texels, with 1; zeros where nothing is drawn.
    pub fn color_at(&self, point: &Vec4) -> Vec4 {
        if point.w == 0.0 {
            return Vec4::ZERO;
        }
        let place = |coordinate: f32, size: usize| (coordinate * size as f32 - 0.5).clamp(0.0, (size - 1) as f32);
        let (x, y) = (place(point.x, self.width), place(1.0 - point.y, self.height));
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let texel = |column: usize, row: usize| self.values[row * self.width + column];
        let across = |row: usize| texel(left, row).lerp(texel(right, row), x - left as f32);
        across(top).lerp(across(bottom), y - top as f32).truncate().extend(1.0)
    }

    /// Moves the texels of all billboards.
    pub fn move_by(&mut self, credits: &Credits, atlas: &Atlas, rates: Rates) {
        let owners = self.owners(atlas);
        let colors = grouped(&credits.colors, &owners, atlas.billboards.len());
        let alpha = grouped(&credits.alpha, &owners, atlas.billboards.len());
        let usual = mean_credit(&credits.alpha);
        let moved = |(number, region): (usize, Region)| {
            let field = Field { region, width: self.width };
            let colors = field.sums(colors.get(number).iter().map(|&i| credits.colors[i as usize]));
            let of_alpha = |credit: &Credit<f32>| Credit {
                texel: credit.texel,
                weight: credit.weight,
                value: Vec3::splat(credit.value),
            };
            let alpha = field.sums(alpha.get(number).iter().map(|&i| of_alpha(&credits.alpha[i as usize])));
            let texel = |(place, (color, alpha)): (usize, (Vec4, Vec4))| {
                let index = field.texel(place);
                self.moved(index, color, alpha, usual, rates)
            };
            (field, colors.into_iter().zip(alpha).enumerate().map(texel).collect::<Vec<Vec4>>())
        };
        let regions: Vec<(usize, Region)> = atlas.regions().enumerate().collect();
        let all: Vec<_> = regions.into_par_iter().map(moved).collect();
        for (field, moved) in all {
            for (place, texel) in moved.into_iter().enumerate() {
                self.values[field.texel(place)] = texel;
            }
        }
    }

    /// Returns a texel after a step; `color` and `alpha` are sums of credits with their weights.
    fn moved(&self, index: usize, color: Vec4, alpha: Vec4, usual: f32, rates: Rates) -> Vec4 {
        let (texel, start) = (self.values[index], self.start[index]);
        let step = color.truncate() / (color.w + PRIOR) * rates.color;
        let brightest = (start * FARTHEST + FAINT).min(Vec3::ONE);
        let rgb = (texel.truncate() + step).clamp(start / FARTHEST, brightest);
        let mean = alpha.x / (alpha.w + PRIOR);
        let change = rates.alpha * mean / (mean.abs() + usual).max(f32::MIN_POSITIVE);
        // A texel without alpha stays so: gutters, and places far from all leaves.
        let w = if texel.w > 0.0 { (texel.w + change).clamp(1.0 / 255.0, 1.0) } else { 0.0 };
        rgb.extend(w)
    }

    /// Returns the billboard of each texel.
    fn owners(&self, atlas: &Atlas) -> Vec<u32> {
        let mut owners = vec![u32::MAX; self.values.len()];
        for (number, region) in atlas.regions().enumerate() {
            for row in region.y..region.y + region.height {
                owners[row * self.width + region.x..][..region.width].fill(number as u32);
            }
        }
        owners
    }
}

/// Returns the credits of each billboard.
fn grouped<T>(credits: &[Credit<T>], owners: &[u32], billboards: usize) -> Groups {
    // The rim of a polygon may touch a texel of the gutter.
    let owner = |credit: &Credit<T>| owners[credit.texel as usize].min(billboards as u32);
    Groups::by_key(&credits.iter().map(owner).collect::<Vec<u32>>(), billboards + 1)
}

/// Returns the mean absolute credit.
fn mean_credit(credits: &[Credit<f32>]) -> f32 {
    let sum: f64 = credits.iter().map(|credit| f64::from(credit.value.abs())).sum();
    (sum / credits.len().max(1) as f64) as f32
}

/// The texels of one billboard.
#[derive(Clone, Copy)]
struct Field {
    region: Region,
    /// Width of the page.
    width: usize,
}

impl Field {
    /// Returns the index on the page of a texel with this index in the field.
    fn texel(&self, place: usize) -> usize {
        let Region { x, y, width, .. } = self.region;
        (y + place / width) * self.width + x + place % width
    }

    /// Returns the sums of values and weights around each texel.
    fn sums(&self, credits: impl Iterator<Item = Credit<Vec3>>) -> Vec<Vec4> {
        let Region { x, y, width, height } = self.region;
        let mut own = vec![Vec4::ZERO; width * height];
        for Credit { texel, weight, value } in credits {
            let (column, row) = (texel as usize % self.width - x, texel as usize / self.width - y);
            own[row * width + column] += value.extend(weight);
        }
        around(&own, width, height)
    }
}

/// Returns the sums over the squares of texels around each texel, in a field of this width and height.
fn around(values: &[Vec4], width: usize, height: usize) -> Vec<Vec4> {
    sums(&sums(values, width, 1, REACH), height, width, REACH)
}
