//! Mip levels.
//!
//! Base color: means of 2 × 2 texels, weighted by alpha, in linear light. Alpha is the share of a texel that leaves cover, so its mean is right
//! where a renderer draws shares (alpha to coverage, alpha hash). A renderer that cuts out at one alpha loses thin leaves on small mip levels,
//! because the means fall below the cutoff. So files with mip levels of their own have alpha bent ([`super::bend`]) on each of them: the share
//! of drawn texels above the cutoff stays that of level 0 (Castaño, "Computing Alpha Mipmaps", 2010, who scales alpha: a factor clips it, and
//! shaders could not undo that). One histogram a level finds the pivot. O(texels).
//!
//! Known limit: texels of equal alpha pass together, so a level of few texels keeps its share only as nearly as its codes allow.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::bend;
use super::channels::Channel;
use super::dilate;
use super::halves::{halved, smaller, texels};
use super::parts::PagePart;
use super::raster::Canvas;
use crate::color::quantise;
use crate::foliage::Image;

/// Mip levels of an image, level 0 first; each has half the side, down to one texel.
pub type Levels = Vec<Image>;

/// Returns the mip levels of base color on which the drawn share of each part stays at its cutoff.
#[must_use]
pub fn of_color(image: &Image, parts: &[PagePart]) -> Levels {
    let levels = means(image);
    let pivots: Vec<Vec<f32>> = parts.iter().map(|part| pivots(image, part)).collect();
    let bent = |(number, level): (usize, Image)| {
        let mut alpha = level.alpha();
        for (part, pivots) in parts.iter().zip(&pivots).filter(|_| number > 0) {
            let table = bend::table(pivots[number], part.alpha_cutoff);
            let regions =
                part.regions.iter().map(|region| smaller(*region, 1 << number, level.width(), level.height()));
            for texel in regions.flat_map(|region| texels(region, level.width())) {
                alpha[texel] = table[usize::from(level.pixels()[texel][3])];
            }
        }
        level.with_alpha(alpha)
    };
    levels.into_iter().enumerate().map(bent).collect()
}

/// Returns the pivot of each mip level of a part: alpha at the pivot becomes the cutoff there ([`bend`]). On level 0 it is the cutoff.
#[must_use]
pub fn pivots(image: &Image, part: &PagePart) -> Vec<f32> {
    // Alpha is weighted by the share of a texel that polygons cover: the rest of the page is not drawn.
    let pixels = image.pixels().iter().zip(&part.drawn);
    let pixels = pixels.map(|(&[.., alpha], &drawn)| Vec4::new(f32::from(alpha), drawn, 0.0, 0.0)).collect();
    let mut level = Canvas { width: image.width(), height: image.height(), pixels };
    let passing = passing(&level)[usize::from(code_at_least(part.alpha_cutoff))];
    let mut pivots = vec![part.alpha_cutoff];
    while level.width > 1 || level.height > 1 {
        level = halved(&level);
        pivots.push(pivot(&self::passing(&level), passing).unwrap_or(part.alpha_cutoff));
    }
    pivots
}

/// Returns for each alpha code the share of the drawn area that reaches it. Texels have alpha in x and the area of their polygons in y. All
/// shares are 0 without an area.
fn passing(level: &Canvas) -> [f64; 256] {
    let mut area = [0.0; 256];
    for texel in &level.pixels {
        area[(texel.x + 0.5) as usize] += f64::from(texel.y);
    }
    let whole = area.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let mut sum = 0.0;
    for share in area.iter_mut().rev() {
        sum += *share;
        *share = sum / whole;
    }
    area
}

/// Returns the alpha between two codes for which the share above it is nearest to `wanted`; `None` if `wanted` is 0 or 1.
fn pivot(passing: &[f64; 256], wanted: f64) -> Option<f32> {
    let off = |code: &usize| (passing[*code] - wanted).abs();
    let nearest = (1..256).min_by(|a, b| off(a).total_cmp(&off(b)))?;
    (wanted > 0.0 && wanted < 1.0).then_some((nearest as f32 - 0.5) / 255.0)
}

/// Returns box-filtered mip levels of base color: means of alpha, and of color weighted by alpha. Engines that filter a PNG do not weight colors.
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

/// Returns the image and its box-filtered mip levels of alpha, `most` images in all. Colors are black, because they take most of the time of
/// [`means`].
///
/// # Panics
/// Never: a level has as many texels as its canvas.
#[must_use]
pub fn of_alpha(image: &Image, most: usize) -> Levels {
    let pixels = image.pixels().iter().map(|p| Vec4::splat(f32::from(p[3])));
    let mut means = Canvas { width: image.width(), height: image.height(), pixels: pixels.collect() };
    let mut levels = vec![image.clone()];
    while levels.len() < most && (means.width > 1 || means.height > 1) {
        means = halved(&means);
        let codes: Vec<[u8; 4]> = means.pixels.iter().map(|mean| [0, 0, 0, (mean.x + 0.5) as u8]).collect();
        levels.push(Image::new(means.width, means.height, codes).expect("as many as the canvas has"));
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
