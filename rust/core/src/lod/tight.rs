//! The polygons of a level, around everything that its atlas page shows.
//!
//! A level is drawn from its page and from mip levels of it. Mip levels show something where the page itself shows nothing: a texel of
//! theirs covers more than a leaf. So cells count as visible if any of the first [`MIPS`] mip levels shows them.

use glam::DVec2;
use rayon::prelude::*;

use crate::atlas::{Atlas, Billboard};
use crate::foliage::Image;
use crate::polygons::{Cells, Polygon, PolygonSettings, tight};
use crate::textures::mips;

/// Mip levels after the page itself that the polygons hold. Texels are half a pixel at most where a level takes over, and the next level
/// takes over at some 2.5 times that distance.
const MIPS: usize = 2;

/// Least alpha that counts: renderers that draw alpha as a share show little of less. On faint pages a share of the greatest alpha.
pub(super) const OF_SHARES: f32 = 0.25;

/// Alpha codes below this are not drawn on blended billboards.
const FAINTEST: f32 = 2.0;

/// Alpha of a mip level, and the code that it must reach to be drawn.
struct AlphaLevel {
    alpha: Vec<u8>,
    width: usize,
    height: usize,
    /// Texels of the page along one of its texels.
    scale: f64,
    least: f32,
}

impl AlphaLevel {
    fn new(alpha: Vec<u8>, width: usize, scale: f64, least: f32) -> Self {
        let height = alpha.len() / width;
        Self { alpha, width, height, scale, least: (255.0 * least).max(FAINTEST) }
    }

    /// Returns the four texels around a place on the page, in texels of the page, and the place between them.
    fn around(&self, place: DVec2) -> ([f32; 4], DVec2) {
        let place = place / self.scale - 0.5;
        // The texel behind each coordinate, by casts: `floor` is a function call without SSE 4.1. Places begin at −½.
        let (x, y) = ((place.x + 1.0) as usize, (place.y + 1.0) as usize);
        let (left, right) = (x.saturating_sub(1).min(self.width - 1), x.min(self.width - 1));
        let (top, bottom) = (y.saturating_sub(1).min(self.height - 1), y.min(self.height - 1));
        let at = |x: usize, y: usize| f32::from(self.alpha[y * self.width + x]);
        let texels = [at(left, top), at(right, top), at(left, bottom), at(right, bottom)];
        (texels, place + 1.0 - DVec2::new(x as f64, y as f64))
    }

    /// Returns whether anything is drawn between the four texels around a place.
    fn shows_near(&self, place: DVec2) -> bool {
        self.around(place).0.into_iter().any(|alpha| alpha >= self.least)
    }

    /// Returns whether a place is drawn.
    fn shows_at(&self, place: DVec2) -> bool {
        let ([a, b, c, d], share) = self.around(place);
        if a.max(b).max(c.max(d)) < self.least {
            return false;
        }
        let (x, y) = (share.x as f32, share.y as f32);
        (a + (b - a) * x) * (1.0 - y) + (c + (d - c) * x) * y >= self.least
    }
}

/// An atlas page as renderers draw it: in Blender without mip levels, in engines with box-filtered ones.
pub(super) struct Shown {
    page: AlphaLevel,
    mips: Vec<AlphaLevel>,
}

impl Shown {
    /// Returns the visible parts of a page with fractional alpha.
    pub fn of_shares(page: &Image) -> Self {
        let greatest = page.alpha().into_iter().max().unwrap_or(0);
        Self::new(page, OF_SHARES * f32::from(greatest) / 255.0)
    }

    /// Returns the parts of a page with at least this alpha; codes below [`FAINTEST`] are invisible.
    pub fn new(page: &Image, least: f32) -> Self {
        let level =
            |(number, mip): (u32, Image)| AlphaLevel::new(mip.alpha(), mip.width(), f64::from(1 << number), least);
        Self {
            page: AlphaLevel::new(page.alpha(), page.width(), 1.0, least),
            mips: (0..).zip(mips::of_alpha(page, MIPS + 1)).skip(1).map(level).collect(),
        }
    }

    /// Returns whether a cell around a point of a billboard's region is drawn.
    fn shows(&self, billboard: &Billboard, point: DVec2) -> bool {
        let region = billboard.region;
        let size = DVec2::new(region.width as f64, region.height as f64);
        let place = DVec2::new(region.x as f64, region.y as f64) + DVec2::new(point.x, 1.0 - point.y) * size;
        self.page.shows_near(place) || self.mips.iter().any(|mip| mip.shows_at(place))
    }

    /// Returns the visible cells of a billboard and of the back of its pair, if it has one, in texels of the front.
    fn cells(&self, front: &Billboard, back: Option<&Billboard>) -> Cells {
        let size = texels(front);
        Cells::new(front.region.width, front.region.height, |column, row| {
            let point = DVec2::new(column as f64, row as f64) / size;
            self.shows(front, point) || back.is_some_and(|back| self.shows(back, back.lowered(front.lifted(point))))
        })
    }
}

fn texels(billboard: &Billboard) -> DVec2 {
    DVec2::new(billboard.region.width as f64, billboard.region.height as f64)
}

/// Returns the layout with tight polygons. The two billboards of a pair have the same polygons in space.
pub(super) fn with_polygons(mut atlas: Atlas, shown: &Shown, settings: PolygonSettings) -> Atlas {
    let pairs: Vec<&mut [Billboard]> = atlas.billboards.chunk_by_mut(|a, b| a.plane == b.plane).collect();
    let cells: Vec<Cells> = pairs.par_iter().map(|pair| shown.cells(&pair[0], pair.get(1))).collect();
    for (pair, polygons) in pairs.into_iter().zip(tight(&cells, settings)) {
        let (front, backs) = pair.split_first_mut().expect("chunks are not empty");
        let size = texels(front);
        front.polygons = polygons.into_iter().map(|polygon| polygon.into_iter().map(|p| p / size).collect()).collect();
        for back in backs {
            back.polygons = front.polygons.iter().map(|polygon| turned(polygon, front, back)).collect();
        }
    }
    atlas
}

/// Returns the polygon of a front billboard as one of the back.
fn turned(polygon: &Polygon, front: &Billboard, back: &Billboard) -> Polygon {
    let seen = |p: &DVec2| back.lowered(front.lifted(*p)).clamp(DVec2::ZERO, DVec2::ONE);
    polygon.iter().rev().map(seen).collect()
}
