//! Mip levels of base color that keep its coverage.
//!
//! Box filtering makes thin leaves fall below the alpha cutoff, so that crowns dissolve in the distance. Here colors are means weighted by
//! alpha, in linear light. Alpha is the mean, then moved, region by region, so that the share of texels that reach the cutoff stays that of
//! level 0 (Castaño, "Computing Alpha Mipmaps", 2010): within 1 % or one texel, whichever is more, as long as the region has texels of
//! its own at that level. Transparent texels have the color of their surroundings at every level.
//!
//! Scaling alpha by a factor cannot do that if many texels have the same alpha. So the texels of a region are sorted by alpha, then by a
//! hash of their position; as many as required get alpha at or above the cutoff, and the others less. This works for any distribution of
//! alpha. Texels barely above the cutoff leave gaps between them when filtered. So alpha on both sides of the cutoff is raised, by one
//! exponent for each level, until as much area reaches the cutoff as at level 0 (see `foliage::mask`). O(texels · log texels).
//!
//! Gutters are too narrow for small levels: a texel there would be a mean of adjacent regions, so each texel averages only its own region.
//! A renderer's filter mixes regions there, too. So texels on a region's rim have either no alpha or less than twice the cutoff: the mean
//! of two of them reaches the cutoff only if both do, and no large billboard shows the rim of another large one. Regions of few texels keep
//! their area together (`few`). Tight polygons are made around box-filtered alpha in such regions: raised alpha would widen them.

use std::collections::HashMap;

use glam::Vec3;
use rayon::prelude::*;

use super::channels::Channel;
use super::dilate;
use super::few::{Few, scattered};
use super::halves::{Owned, half_size, halved, smaller, texels};
use super::on_polygons::OnPolygons;
use super::parts::{PagePart, apart, together};
use super::raster::Canvas;
use crate::atlas::Region;
use crate::color::quantise;
use crate::error::Result;
use crate::foliage::{Image, mask};

/// Mip levels of an image, level 0 first; each has half the side, down to one texel.
pub type Levels = Vec<Image>;

/// Returns the mip levels of base color on a page that several trees share: each part as if it had the page for itself. `settled` changes the
/// mip levels of a part, given by its place; changed levels may have other areas and rims.
///
/// # Errors
/// Those of `settled`.
pub fn of_parts(
    image: &Image,
    parts: &[PagePart],
    settled: impl Fn(usize, Levels) -> Result<Levels>,
) -> Result<Levels> {
    let of_page = |(number, (page, part)): (usize, (Image, &PagePart))| {
        Ok(settled(number, of_part(&page, part, usize::MAX))?.into_iter())
    };
    let pages = apart(image, parts).into_iter().zip(parts);
    let mut levels = pages.enumerate().map(of_page).collect::<Result<Vec<_>>>()?;
    let level = |number: usize| {
        let of_each: Vec<Image> = levels.iter_mut().filter_map(Iterator::next).collect();
        (!of_each.is_empty()).then(|| together(of_each, parts, number))
    };
    Ok((0..).map_while(level).collect())
}

/// Returns the mip levels of base color with alpha that keeps the share of each region at or above the cutoff. Polygons cover the regions.
#[must_use]
pub fn of_color(image: &Image, regions: &[Region], alpha_cutoff: f32) -> Levels {
    let mut drawn = vec![0.0; image.pixels().len()];
    regions.iter().flat_map(|region| texels(*region, image.width())).for_each(|texel| drawn[texel] = 1.0);
    let regions = regions.to_vec();
    of_part(image, &PagePart { regions, gutter: 0, alpha_cutoff, drawn, first_seen: 0 }, usize::MAX)
}

/// Returns the image and its first `most` mip levels, for one tree's part of a page.
pub(super) fn of_part(image: &Image, part: &PagePart, most: usize) -> Levels {
    let polygons = part.polygons(image.width(), PLACES);
    let few = Few::new(image, part.drawn.clone());
    levels_of_color(image, &part.regions, part.alpha_cutoff, most, Some((few, polygons)))
}

/// Returns the image and its first `most` mip levels, as [`of_color`] does, with box-filtered alpha in regions of few texels; fewer levels
/// for a small image.
pub(crate) fn first_of_color(image: &Image, regions: &[Region], alpha_cutoff: f32, most: usize) -> Levels {
    levels_of_color(image, regions, alpha_cutoff, most, None)
}

/// Without `few` regions of few texels keep box-filtered alpha.
fn levels_of_color(
    image: &Image,
    regions: &[Region],
    alpha_cutoff: f32,
    most: usize,
    mut few: Option<(Few, OnPolygons)>,
) -> Levels {
    let cutoff = code_at_least(alpha_cutoff);
    let shares: Vec<f64> = regions.iter().map(|region| share(image, *region, cutoff)).collect();
    let area = area(image, alpha_cutoff);
    let seen = |(_, polygons): &(_, OnPolygons)| polygons.share(&image.alpha(), image.width(), cutoff);
    let on_polygons = few.as_ref().map_or(0.0, seen);
    let mut owned = Owned::new(Canvas::of_color(image), regions);
    let mut levels = vec![image.clone()];
    let mut scale = 1;
    while levels.len() <= most && (owned.means.width > 1 || owned.means.height > 1) {
        scale *= 2;
        let (width, height) = half_size(&owned.means);
        let at_level: Vec<Region> = regions.iter().map(|region| smaller(*region, scale, width, height)).collect();
        owned = owned.halved(&at_level);
        let is_large = |number: &usize| at_level[*number].width.min(at_level[*number].height) >= FEW;
        let (large, small): (Vec<usize>, Vec<usize>) = (0..regions.len()).partition(is_large);
        let order = |level: &Image, number: usize| Order::of(level, at_level[number], shares[number]);
        let orders = |level: &Image| large.par_iter().map(|&number| order(level, number)).collect::<Vec<Order>>();
        let Some((few, polygons)) = &mut few else {
            let level = filled(&owned.means);
            levels.push(lifted(&level, &orders(&level), cutoff, area));
            continue;
        };
        few.halve();
        let texels = few.texels(&picked(&at_level, &small), &picked(&at_level, &large));
        let level = filled(&few.mixed(&owned.means, &texels));
        let visible = |numbers: &[usize]| -> f64 { numbers.iter().map(|&i| shares[i] * size(regions[i])).sum() };
        let of_small = visible(&small) / (visible(&small) + visible(&large)).max(f64::MIN_POSITIVE);
        let passing = few.passing(&level, &texels, of_small * area * (width * height) as f64);
        let orders = orders(&level);
        let large = lifted(&cleared(level, &texels), &orders, cutoff, (1.0 - of_small) * area);
        levels.push(few.lifted(large, &passing, polygons, on_polygons, cutoff));
    }
    levels
}

fn picked(regions: &[Region], numbers: &[usize]) -> Vec<Region> {
    numbers.iter().map(|&number| regions[number]).collect()
}

/// Returns the number of a region's texels.
fn size(region: Region) -> f64 {
    (region.width * region.height) as f64
}

/// Returns the image without alpha in some texels.
fn cleared(image: Image, texels: &[usize]) -> Image {
    let mut alpha = image.alpha();
    for &texel in texels {
        alpha[texel] = 0;
    }
    image.with_alpha(alpha)
}

/// Returns box-filtered mip levels of base color: means of alpha, and of color weighted by alpha. Engines that filter a PNG do not weight colors
/// (`LightGrid::levels`).
#[must_use]
pub fn means(image: &Image) -> Levels {
    let mut means = Canvas::of_color(image);
    let mut levels = vec![image.clone()];
    while means.width > 1 || means.height > 1 {
        means = halved(&means);
        levels.push(filled(&means));
    }
    levels
}

/// Returns the mip levels of linear values such as occlusion, roughness and metallic: means of their codes.
#[must_use]
pub fn of_shares(image: &Image) -> Levels {
    of_data(image, |mean| mean)
}

/// Returns the mip levels of tangent-space normals: means, normalized.
#[must_use]
pub fn of_normals(image: &Image) -> Levels {
    of_data(image, |mean| (mean * 2.0 - 1.0).try_normalize().unwrap_or(Vec3::Z) * 0.5 + 0.5)
}

/// Returns the mip levels of linear codes. Transparent texels are filled in already, so all texels have the same weight.
fn of_data(image: &Image, settle: impl Fn(Vec3) -> Vec3 + Sync) -> Levels {
    let share = |code: u8| f32::from(code) / 255.0;
    let pixels = image.pixels().iter().map(|&[r, g, b, _]| Vec3::new(share(r), share(g), share(b)).extend(1.0));
    let mut means = Canvas { width: image.width(), height: image.height(), pixels: pixels.collect() };
    let mut levels = vec![image.clone()];
    while means.width > 1 || means.height > 1 {
        means = halved(&means);
        let codes = means.pixels.par_iter().map(|mean| {
            let [r, g, b] = settle(mean.truncate()).to_array().map(quantise);
            [r, g, b, 255]
        });
        let codes: Vec<[u8; 4]> = codes.collect();
        levels.push(Image::new(means.width, means.height, codes).expect("as many as the canvas has"));
    }
    levels
}

/// Returns a level as an image, with color filled in under transparent texels.
fn filled(means: &Canvas) -> Image {
    let mut filled = means.clone();
    dilate::fill_transparent(&mut filled);
    Channel::BaseColor.to_image(&filled)
}

/// Returns the least alpha code at or above the cutoff.
pub(crate) fn code_at_least(cutoff: f32) -> u8 {
    (1..=255u8).find(|&code| f32::from(code) / 255.0 >= cutoff).unwrap_or(255)
}

/// Returns the share of an image's area at or above the cutoff, with alpha interpolated between texel centers.
#[must_use]
pub fn area(image: &Image, cutoff: f32) -> f64 {
    mask::area(&image.alpha(), image.width(), cutoff, 1)
}

/// Returns the share of a region's texels at or above the cutoff.
#[must_use]
pub fn share(image: &Image, region: Region, cutoff: u8) -> f64 {
    let passing = texels(region, image.width()).filter(|&i| image.pixels()[i][3] >= cutoff).count();
    passing as f64 / size(region)
}

/// Most places on the polygons at which alpha is looked up.
const PLACES: usize = 1 << 16;

/// Regions with fewer texels along a side are too small to keep a share each (`few`).
const FEW: usize = 4;

/// Range of the exponents that raise alpha, as powers of two, and the halvings of the search for one.
const LIFTS: (f64, f64) = (-5.0, 2.0);
const HALVINGS: usize = 6;

/// Returns the level with alpha moved and raised so that about the share `area` of its area reaches the cutoff.
fn lifted(level: &Image, orders: &[Order], cutoff: u8, area: f64) -> Image {
    let moved = |lift: f64| moved(level, orders, cutoff, libm::exp2(lift));
    let (mut most, mut least) = LIFTS;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (most + least);
        let found = mask::area(&moved(middle), level.width(), f32::from(cutoff) / 255.0, 1);
        if found < area {
            least = middle;
        } else {
            most = middle;
        }
    }
    level.clone().with_alpha(moved(0.5 * (most + least)))
}

/// The texels of a region with alpha above 0, sorted; the first `passing` get alpha at or above the cutoff.
struct Order {
    region: Region,
    texels: Vec<usize>,
    passing: usize,
    /// Alpha of the last and of the first of the passing texels.
    range: [u8; 2],
}

impl Order {
    /// Returns the order with which this share of the region passes. Texels with the same alpha are sorted by a hash of their position.
    fn of(level: &Image, region: Region, share: f64) -> Self {
        let alpha = |texel: usize| level.pixels()[texel][3];
        let mut order: Vec<usize> = texels(region, level.width()).filter(|&texel| alpha(texel) > 0).collect();
        order.sort_unstable_by_key(|&texel| (std::cmp::Reverse(alpha(texel)), scattered(texel), texel));
        let wanted = share * size(region);
        // A visible region does not vanish.
        let passing = if share > 0.0 { (wanted.round() as usize).clamp(1, order.len().max(1)) } else { 0 };
        let code = |rank: usize| order.get(rank).or(order.first()).map_or(0, |&texel| alpha(texel));
        let range = [code(passing.saturating_sub(1)), code(0)];
        Self { region, texels: order, passing, range }
    }
}

/// Returns the alpha of a level, moved region by region. Alpha from the threshold to the greatest goes from the cutoff to full (to full if
/// both are equal); alpha below the threshold goes from 0 to just below the cutoff. Both follow the power `exponent`.
fn moved(level: &Image, orders: &[Order], cutoff: u8, exponent: f64) -> Vec<u8> {
    let mut alpha = level.alpha();
    let mut tables = HashMap::new();
    for Order { region, texels, passing, range } in orders {
        let of_range = || lifting_tables(range.map(f64::from), cutoff, exponent);
        let [passes, fails] = tables.entry(*range).or_insert_with(of_range);
        for (rank, &texel) in texels.iter().enumerate() {
            // If regions have shrunk into one another, the last one wins.
            let (passes_here, on_rim) = (rank < *passing, is_on_rim(texel, *region, level.width()));
            let table = if passes_here { &*passes } else { &*fails };
            let moved = table[level.pixels()[texel][3] as usize];
            alpha[texel] = match (on_rim, passes_here) {
                (false, _) => moved,
                (true, true) => moved.min(cutoff.saturating_mul(2) - 1),
                (true, false) => 0,
            };
        }
    }
    alpha
}

fn is_on_rim(texel: usize, Region { x, y, width, height }: Region, columns: usize) -> bool {
    let (column, row) = (texel % columns - x, texel / columns - y);
    column == 0 || row == 0 || column + 1 == width || row + 1 == height
}

/// Returns the alpha tables for texels that pass and for those that do not.
fn lifting_tables([threshold, greatest]: [f64; 2], cutoff: u8, exponent: f64) -> [[u8; 256]; 2] {
    let lift = |share: f64, codes: u8| (libm::pow(share.clamp(0.0, 1.0), exponent) * f64::from(codes)) as u8;
    let above = |code: f64| if threshold < greatest { (code - threshold) / (greatest - threshold) } else { 1.0 };
    let passes = std::array::from_fn(|code| cutoff + lift(above(code as f64), 255 - cutoff));
    let fails = std::array::from_fn(|code| lift(code as f64 / threshold.max(1.0), cutoff - 1));
    [passes, fails]
}
