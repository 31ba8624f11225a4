//! The baked page of a level: what each billboard shows of the leaves behind it.

mod cascade;
mod channels;
mod dilate;
mod halves;
pub mod image;
mod labels;
pub mod mips;
mod page;
mod plain;
mod raster;
mod samples;
mod sky;
mod tone;

use std::time::Instant;

use glam::{DVec3, Mat3};
use rayon::prelude::*;

pub use cascade::{LEVELS as CASCADE_LEVELS, keeping_area};
pub use channels::Channel;
pub(crate) use dilate::fill_gaps;
pub use page::{Channels, Page};
pub use plain::for_plain_means;
use raster::rasterise_timed;
pub use raster::{Canvas, ScreenTriangle, Window, count_seen, rasterise};
pub use sky::{Outlook, Sky};

use crate::error::{Error, Result};
use crate::foliage::Foliage;
use crate::sheet::{Billboard, Sheet};

/// What each image of a page took, by its name.
pub type ChannelSeconds = Vec<(&'static str, f64)>;

/// Sub-samples along each side of a texel, in [1, 16].
#[derive(Clone, Copy, Debug)]
pub struct Samples {
    side: usize,
    /// Parts along each side of a texel that are looked at by themselves.
    looks: usize,
    /// Of the distance between samples, over which textures are filtered.
    filter: f32,
}

impl Samples {
    /// # Errors
    /// A number outside [1, 16].
    pub fn new(samples: usize) -> Result<Self> {
        if (1..=16).contains(&samples) {
            return Ok(Self { side: samples, ..Self::default() });
        }
        Err(Error::invalid(format!("samples is {samples}; it must lie between 1 and 16")))
    }

    /// How many along each side.
    #[must_use]
    pub const fn side(self) -> usize {
        self.side
    }

    /// Each sample is looked at by itself, as a renderer does: what is seen between leaves counts no more than what is seen of their middle.
    #[must_use]
    pub fn each(self) -> Self {
        Self { looks: self.side, ..self }
    }

    /// Textures are looked at in points, as a renderer does that takes many samples: for means over whole pictures, which need no filter and
    /// would keep its bias. (Filters do not know which part of a texel is drawn beside which: pines come out some per cent too dark.)
    #[must_use]
    pub fn unfiltered(self) -> Self {
        Self { filter: 0.0, ..self }
    }
}

impl Default for Samples {
    /// 4 × 4.
    fn default() -> Self {
        Self { side: 4, looks: 1, filter: 1.0 }
    }
}

/// A triangle as it is drawn on billboards: where it lies at a = 1, in the frame of the sheet.
pub struct Drawn<'a> {
    /// What it belongs to.
    pub foliage: &'a Foliage,
    /// Which one it is.
    pub triangle: usize,
    /// Its corners in the plane.
    pub targets: [DVec3; 3],
    /// Its corners where they really are: what lies higher along the normal hides what lies lower.
    pub corners: [DVec3; 3],
    /// It is drawn only as far as it lies no farther from the plane.
    pub reach: f64,
}

/// Renders every billboard's triangles into its region of the page.
///
/// `drawn` gives the triangles that a plane shows; without a `sky` there are no channels that depend on it. What is transparent is filled in from around it, so that no filter finds anything else.
///
/// # Panics
/// Never: base colour is always among the channels.
pub fn bake<'a>(
    sheet: &Sheet,
    samples: Samples,
    channels: (&Channels, Option<&Sky>),
    drawn: impl Fn(u32) -> Vec<Drawn<'a>> + Sync,
) -> Page {
    bake_timed(sheet, samples, channels, drawn).0
}

/// The page, and the seconds that each of its images took, by name.
///
/// # Panics
/// Never: base colour is always among the channels.
pub fn bake_timed<'a>(
    sheet: &Sheet,
    samples: Samples,
    (channels, sky): (&Channels, Option<&Sky>),
    drawn: impl Fn(u32) -> Vec<Drawn<'a>> + Sync,
) -> (Page, ChannelSeconds) {
    let places: Vec<ToPage> = sheet.billboards.iter().map(ToPage::new).collect();
    let place = |index: usize| {
        let drawn = drawn(sheet.billboards[index].plane);
        drawn.iter().map(|d| places[index].place(d)).filter(ScreenTriangle::is_within).collect::<Vec<_>>()
    };
    let triangles: Vec<ScreenTriangle> = (0..places.len()).into_par_iter().flat_map_iter(place).collect();
    let channels = channels.list(sky);
    let (canvases, spent) = rasterise_timed(&triangles, sheet.size.width, sheet.size.height, samples, &channels);
    let mut seconds: ChannelSeconds = channels.iter().map(|channel| channel.name()).zip(spent).collect();
    let of_image = seconds.iter_mut().map(|(_, seconds)| seconds);
    let images = channels.into_iter().zip(canvases).zip(of_image).map(|((channel, mut canvas), seconds)| {
        let started = Instant::now();
        if channel.is_label() {
            labels::spread(&mut canvas);
        } else {
            dilate::fill_transparent(&mut canvas);
        }
        let image = channel.to_image(&canvas);
        *seconds += started.elapsed().as_secs_f64();
        (channel, image)
    });
    let page = Page::of(images).expect("base colour is always there");
    (page, seconds)
}

/// The map from a billboard's plane to texels of the page.
struct ToPage {
    origin: DVec3,
    /// Texels per unit, along the columns and up the rows.
    across: DVec3,
    up: DVec3,
    normal: DVec3,
    left: f64,
    bottom: f64,
    /// Where outlines follow what is opaque, triangles reach beyond their region, into others'.
    window: Window,
}

impl ToPage {
    fn new(billboard: &Billboard) -> Self {
        let [a, b, _, d] = billboard.corners;
        let (x, y, region) = (b - a, d - a, billboard.region);
        let normal = x.cross(y).normalize();
        let view = Mat3::from_cols(x.normalize().as_vec3(), y.normalize().as_vec3(), normal.as_vec3()).transpose();
        Self {
            origin: a,
            across: x * (region.width as f64 / x.length_squared()),
            up: y * (region.height as f64 / y.length_squared()),
            normal,
            left: region.x as f64,
            bottom: (region.y + region.height) as f64,
            window: Window {
                columns: region.x..region.x + region.width,
                rows: region.y..region.y + region.height,
                view,
            },
        }
    }

    fn place<'a>(&'a self, drawn: &Drawn<'a>) -> ScreenTriangle<'a> {
        let position = |i: usize| {
            let q = drawn.targets[i] - self.origin;
            let height = self.normal.dot(drawn.corners[i] - self.origin);
            DVec3::new(self.left + self.across.dot(q), self.bottom - self.up.dot(q), height).as_vec3()
        };
        let corners = std::array::from_fn(position);
        ScreenTriangle {
            corners,
            foliage: drawn.foliage,
            triangle: drawn.triangle as u32,
            window: &self.window,
            reach: drawn.reach as f32,
        }
    }
}

#[cfg(test)]
mod channels_tests;
#[cfg(test)]
mod tests;
