//! The parts of an atlas page that several trees share, each with a cutoff of its own.

use super::halves::{smaller, texels};
use super::mips::code_at_least;
use super::on_polygons::{OnPolygons, drawn_texels};
use crate::atlas::{Atlas, Region};
use crate::foliage::Image;

/// Regions of an atlas page that are drawn at one cutoff: those of one tree.
#[derive(Clone, Debug)]
pub struct PagePart {
    /// Regions without their gutters.
    pub regions: Vec<Region>,
    /// Unused texels around each region.
    pub gutter: usize,
    /// Least alpha that is drawn, greater than 0.
    pub alpha_cutoff: f32,
    /// For each texel of the page the share that polygons cover.
    pub drawn: Vec<f32>,
    /// The first mip level that is seen: its texels are about a pixel large where the part is seen closest.
    pub first_seen: usize,
}

impl PagePart {
    /// Returns the part with all regions of an atlas layout.
    #[must_use]
    pub fn of(atlas: &Atlas, alpha_cutoff: f32, first_seen: usize) -> Self {
        let regions = atlas.regions().collect();
        Self { regions, gutter: atlas.gutter, alpha_cutoff, drawn: drawn_texels(atlas), first_seen }
    }

    /// Returns places on the polygons of a page of this width, `most` at most.
    pub(super) fn polygons(&self, width: usize, most: usize) -> OnPolygons {
        OnPolygons::new(&self.drawn, width, most)
    }

    /// Returns the regions with their gutters.
    fn owned(&self) -> Vec<Region> {
        self.regions.iter().map(|region| region.grown(self.gutter)).collect()
    }
}

/// Returns the image of each part: without the alpha of the others.
pub(super) fn apart(image: &Image, parts: &[PagePart]) -> Vec<Image> {
    if parts.len() == 1 {
        return vec![image.clone()];
    }
    let alone = |part: &PagePart| {
        let mut pixels: Vec<[u8; 4]> = image.pixels().iter().map(|&[r, g, b, _]| [r, g, b, 0]).collect();
        let owned = part.owned().into_iter().flat_map(|region| texels(region, image.width()));
        owned.for_each(|i| pixels[i] = image.pixels()[i]);
        as_large(image, pixels)
    };
    parts.iter().map(alone).collect()
}

/// Returns mip level `number` of a page from that of each part.
pub(super) fn together(levels: Vec<Image>, parts: &[PagePart], number: usize) -> Image {
    let mut levels = levels.into_iter().zip(parts);
    let (first, _) = levels.next().expect("a page has a part");
    let (columns, rows) = (first.width(), first.height());
    let mut pixels = first.pixels().to_vec();
    for (own, part) in levels {
        let regions = part.owned().into_iter().map(|region| smaller(region, 1 << number, columns, rows));
        regions.flat_map(|region| texels(region, columns)).for_each(|i| pixels[i] = own.pixels()[i]);
    }
    as_large(&first, pixels)
}

/// Returns the regions of mip level `number` in which alpha is cut out, each with its least drawn alpha
/// code. With several parts these are the parts' own regions.
#[must_use]
pub fn cut_outs(parts: &[PagePart], number: usize, level: &Image) -> Vec<(Region, u8)> {
    let (width, height) = (level.width(), level.height());
    if let [PagePart { alpha_cutoff, .. }] = parts {
        return vec![(Region { x: 0, y: 0, width, height }, code_at_least(*alpha_cutoff))];
    }
    let of_part = |part: &PagePart| {
        let (owned, code) = (part.owned(), code_at_least(part.alpha_cutoff));
        owned.into_iter().map(move |region| (smaller(region, 1 << number, width, height), code))
    };
    parts.iter().flat_map(of_part).collect()
}

fn as_large(image: &Image, pixels: Vec<[u8; 4]>) -> Image {
    Image::new(image.width(), image.height(), pixels).expect("as many texels as before")
}
