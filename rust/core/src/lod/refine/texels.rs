//! The texels of a page while it is refined.

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::credit::{Credit, Credits};
use super::picture::box_sums;
use crate::atlas::{Atlas, Region};
use crate::color::quantise;
use crate::foliage::Image;
use crate::groups::Groups;
use crate::textures::{LightGrid, light};

/// Base color in linear light, and alpha.
pub struct Texels {
    grid: LightGrid,
    fields: Vec<Field>,
    /// The billboard of each texel; their number where there is none.
    owners: Vec<u32>,
    /// The page at the start, and the factors on its colors since.
    start: Image,
    factors: Vec3,
    /// The cutoff at the start, and the factors by which differences of alpha from it are smaller than on the page.
    cutoff: f32,
    slopes: Vec<f32>,
}

/// How far texels move in a step.
#[derive(Clone, Copy)]
pub struct Rates {
    /// Share of the way to the color that the leaves have.
    color: f32,
    /// Share of the drawn texels that appear or vanish.
    edges: f32,
}

/// Returns a factor that falls with the steps, so that they come to rest although each has other views.
pub fn slower(step: usize) -> f32 {
    1.0 / (1.0 + 0.25 * step as f32)
}

impl Rates {
    /// Returns the rates of a step.
    pub fn of_step(step: usize) -> Self {
        let slower = slower(step);
        Self { color: 0.8 * slower, edges: 0.06 * slower }
    }
}

/// A texel takes the mean credit of all texels within this distance along rows and columns, because few views show a single texel.
const REACH: usize = 2;

/// Weight of staying as it is, beside the credits around a texel.
pub const PRIOR: f32 = 2.0;

/// Greatest factor on a color, and the light that it may always gain.
const FARTHEST: f32 = 2.5;
const FAINT: f32 = 0.01;

/// Share of the difference between alpha and the cutoff that stays at an edge.
const AT_EDGES: f32 = 0.1;

/// Greatest change of alpha in a step.
const MOST: f32 = 0.3;

/// Rates of alpha to choose from, as shares of [`MOST`].
const CHOICES: usize = 64;

impl Texels {
    /// Returns the texels of a page, with the edges of its leaves widened: the less alpha differs from the cutoff, the nearer an edge is.
    /// Outlines stay, because they are where there is no difference. So edges can move by several texels, as with textures of distances
    /// (Green, "Improved Alpha-Tested Magnification for Vector Textures and Special Effects", 2007).
    pub fn of(image: &Image, atlas: &Atlas, cutoff: f32) -> Self {
        let grid = LightGrid::of(image);
        let fields: Vec<Field> = atlas.regions().map(|region| Field { region, width: grid.0.width }).collect();
        let owners = owners(&fields, grid.0.pixels.len());
        let slopes = vec![1.0; grid.0.pixels.len()];
        let (start, factors) = (image.clone(), Vec3::ONE);
        let mut page = Self { grid, fields, owners, start, factors, cutoff, slopes };
        let slopes: Vec<Vec<f32>> = page.fields.par_iter().map(|field| page.slopes(field)).collect();
        for (field, slopes) in page.fields.iter().zip(slopes) {
            for (texel, slope) in field.texels().zip(slopes) {
                page.slopes[texel] = slope;
                page.grid.0.pixels[texel].w = cutoff + (page.grid.0.pixels[texel].w - cutoff) * slope;
            }
        }
        page
    }

    /// Returns the slopes of a billboard's alpha: small near edges, 1 far from them.
    fn slopes(&self, field: &Field) -> Vec<f32> {
        // The number of drawn texels around a texel, with the number of all.
        let is_drawn = |texel: usize| f32::from(u8::from(self.grid.0.pixels[texel].w >= self.cutoff));
        let mut drawn: Vec<Vec2> = field.texels().map(|texel| Vec2::new(is_drawn(texel), 1.0)).collect();
        for _ in 0..2 {
            drawn = box_sums(&drawn, field.region.width, REACH);
        }
        let slope = |drawn: &Vec2| AT_EDGES + (1.0 - AT_EDGES) * (2.0 * drawn.x / drawn.y - 1.0).abs();
        drawn.iter().map(slope).collect()
    }

    /// Multiplies all colors. Rounded to codes, colors keep their mean only if they vary in fractions of a code, as these do.
    pub fn scale(&mut self, factors: Vec3) {
        self.grid.0.pixels.par_iter_mut().for_each(|texel| *texel *= factors.extend(1.0));
        self.factors *= factors;
    }

    /// Returns the colors, and alpha with widened edges.
    pub fn grid(&self) -> &LightGrid {
        &self.grid
    }

    /// Returns an image of alpha alone, with widened edges.
    pub fn widened(&self) -> Image {
        let code = |texel: &Vec4| [0, 0, 0, quantise(texel.w)];
        let pixels: Vec<[u8; 4]> = self.grid.0.pixels.par_iter().map(code).collect();
        Image::new(self.grid.0.width, self.grid.0.height, pixels).expect("as many texels as before")
    }

    /// Returns the page's image, with edges as steep as they were at the start.
    pub fn page(&self) -> Image {
        self.grid.image(|index, texel| self.cutoff + (texel.w - self.cutoff) / self.slopes[index])
    }

    /// Moves the texels of all billboards that have credits nearby.
    pub fn move_by(&mut self, credits: &Credits, rates: Rates) {
        let colors = self.grouped(&credits.colors);
        let alpha = self.grouped(&credits.alpha);
        let usual = mean_credit(&credits.alpha);
        let step = |(number, field): (usize, &Field)| {
            let (colors, alpha) = (colors.get(number), alpha.get(number));
            let texels = colors.iter().map(|&index| credits.colors[index as usize].texel);
            let Some(part) = field.around(texels.chain(alpha.iter().map(|&index| credits.alpha[index as usize].texel)))
            else {
                return Vec::new();
            };
            let both = part.sums(&credits.colors, colors).into_iter().zip(part.sums(&credits.alpha, alpha));
            let credited = part.texels().zip(both).filter(|(_, (color, alpha))| color.w > 0.0 || alpha.y > 0.0);
            let moved = |(texel, (color, alpha))| Move { texel, to: self.step(texel, color, alpha, usual, rates) };
            credited.map(moved).collect::<Vec<Move>>()
        };
        let moves: Vec<Vec<Move>> = self.fields.par_iter().enumerate().map(step).collect();
        let most = self.alpha_rate(&moves, rates.edges);
        for Move { texel, to } in moves.into_iter().flatten() {
            let value = &mut self.grid.0.pixels[texel];
            // A texel without alpha stays so: gutters, and places far from all leaves.
            let alpha = if value.w > 0.0 { (value.w + most * to.w).clamp(1.0 / 255.0, 1.0) } else { 0.0 };
            *value = to.truncate().extend(alpha);
        }
    }

    /// Returns a texel's color after a step, and the direction of its alpha, from -1 to 1. `color` and `alpha` are sums of credits with
    /// their weights.
    fn step(&self, texel: usize, color: Vec4, alpha: Vec2, usual: f32, rates: Rates) -> Vec4 {
        let start = light(self.start.pixels()[texel]).truncate() * self.factors;
        let step = color.truncate() / (color.w + PRIOR) * rates.color;
        let brightest = (start * FARTHEST + FAINT).min(Vec3::ONE);
        let rgb = (self.grid.0.pixels[texel].truncate() + step).clamp((start / FARTHEST).min(brightest), brightest);
        rgb.extend(direction(alpha, usual))
    }

    /// Returns the change of alpha at which a share of the drawn texels appear or vanish, at most [`MOST`]: leaves on cards have much more
    /// edges than modelled ones, and the same change moves many more of their texels.
    fn alpha_rate(&self, moves: &[Vec<Move>], share: f32) -> f32 {
        let of_field = |(field, moves): (&Field, &Vec<Move>)| {
            let lack = |texel: usize| self.cutoff - self.grid.0.pixels[texel].w;
            let drawn: u32 = field.texels().map(|texel| u32::from(lack(texel) <= 0.0)).sum();
            let mut moved = [0u32; CHOICES];
            for Move { texel, to } in moves {
                // The rate at which the texel changes sides.
                let rate = lack(*texel) / (MOST * to.w);
                if rate > 0.0 && rate < 1.0 && self.grid.0.pixels[*texel].w > 0.0 {
                    moved[(rate * CHOICES as f32) as usize] += 1;
                }
            }
            (drawn, moved)
        };
        let all: Vec<(u32, [u32; CHOICES])> = self.fields.par_iter().zip(moves).map(of_field).collect();
        let drawn: u64 = all.iter().map(|(drawn, _)| u64::from(*drawn)).sum();
        let mut most = (f64::from(share) * drawn as f64) as u64;
        let of_choice = |choice: usize| all.iter().map(|(_, moved)| u64::from(moved[choice])).sum::<u64>();
        let fits = |choice: &usize| {
            let moved = of_choice(*choice);
            let fits = moved <= most;
            most = most.saturating_sub(moved);
            fits
        };
        let choices = (0..CHOICES).take_while(fits).count();
        MOST * choices.max(1) as f32 / CHOICES as f32
    }

    /// Returns the credits of each billboard.
    fn grouped<T>(&self, credits: &[Credit<T>]) -> Groups {
        let owners: Vec<u32> = credits.iter().map(|credit| self.owners[credit.texel as usize]).collect();
        Groups::by_key(&owners, self.fields.len() + 1)
    }
}

/// Returns the billboard of each texel. The rim of a polygon may touch a texel of the gutter, which belongs to none.
fn owners(fields: &[Field], texels: usize) -> Vec<u32> {
    let mut owners = vec![fields.len() as u32; texels];
    for (number, field) in fields.iter().enumerate() {
        field.texels().for_each(|texel| owners[texel] = number as u32);
    }
    owners
}

/// Returns the direction of alpha, from -1 to 1, for the sum of a texel's credits with their weight. `usual`: the mean absolute credit.
pub fn direction(alpha: Vec2, usual: f32) -> f32 {
    let mean = alpha.x / (alpha.y + PRIOR);
    mean / (mean.abs() + usual).max(f32::MIN_POSITIVE)
}

/// Returns the mean absolute credit.
pub fn mean_credit(credits: &[Credit<Vec2>]) -> f32 {
    let sum: f64 = credits.iter().map(|credit| f64::from(credit.value.x.abs())).sum();
    (sum / credits.len().max(1) as f64) as f32
}

/// A step of a texel: its color after it, and the direction of its alpha, from -1 to 1.
struct Move {
    texel: usize,
    to: Vec4,
}

/// A rectangle of texels: those of one billboard, or a part of them.
#[derive(Clone, Copy)]
struct Field {
    region: Region,
    /// Width of the page.
    width: usize,
}

impl Field {
    /// Returns the indices of the texels on the page, row by row.
    fn texels(self) -> impl Iterator<Item = usize> {
        let Region { x, y, width, height } = self.region;
        (y..y + height).flat_map(move |row| (row * self.width + x..).take(width))
    }

    /// Returns the part within [`REACH`] of these texels; `None` without any.
    fn around(self, texels: impl Iterator<Item = u32>) -> Option<Self> {
        let place = |texel: u32| [texel as usize % self.width, texel as usize / self.width];
        let union = |(low, high): ([usize; 2], [usize; 2]), place: [usize; 2]| {
            ([0, 1].map(|i| place[i].min(low[i])), [0, 1].map(|i| place[i].max(high[i])))
        };
        let (low, high) = texels.map(place).map(|place| (place, place)).reduce(|sum, (place, _)| union(sum, place))?;
        let Region { x, y, width, height } = self.region;
        let [left, top] = [low[0].saturating_sub(REACH).max(x), low[1].saturating_sub(REACH).max(y)];
        let [right, bottom] = [(high[0] + 1 + REACH).min(x + width), (high[1] + 1 + REACH).min(y + height)];
        Some(Self { region: Region { x: left, y: top, width: right - left, height: bottom - top }, ..self })
    }

    /// Returns the sums of the credits with these indices around each texel.
    fn sums<T: Copy + Default + std::ops::AddAssign>(self, credits: &[Credit<T>], indices: &[u32]) -> Vec<T> {
        let Region { x, y, width, height } = self.region;
        let mut own = vec![T::default(); width * height];
        for &index in indices {
            let Credit { texel, value } = credits[index as usize];
            let (column, row) = (texel as usize % self.width - x, texel as usize / self.width - y);
            own[row * width + column] += value;
        }
        box_sums(&own, width, REACH)
    }
}
