//! Texture baking: renders each billboard's leaves into the atlas page of a level.

pub mod animation;
mod bend;
mod channels;
mod dilate;
mod halves;
pub mod image;
mod labels;
mod light_grid;
pub mod mips;
mod page;
mod palette;
mod parts;
mod raster;
mod samples;
mod sky;
pub(crate) mod tone;

use std::time::Instant;

use glam::{DVec3, Mat3};
use rayon::prelude::*;

pub(crate) use bend::bent;
pub use channels::Channel;
pub use dilate::fill_below;
pub(crate) use dilate::{fill_gaps, fill_transparent};
pub(crate) use light_grid::{LightGrid, light};
pub use page::{Channels, Page};
pub use parts::PagePart;
pub(crate) use raster::rasterise_timed;
pub use raster::{
    Canvas, Layers, ScreenTriangle, Seen, SeenInPixel, SeenTriangles, Shader, Window, count_covered, count_seen,
    rasterise, seen_among,
};
pub use samples::Samples;
pub(crate) use sky::Shadow;
#[cfg(test)]
pub(crate) use sky::tests::tiers;
pub use sky::{Outlook, Sky};

use crate::atlas::{Atlas, Billboard, PageSize};
use crate::error::Result;
use crate::foliage::Foliage;
use crate::progress::Progress;

/// Seconds spent on each image of an atlas page, by name.
pub type ChannelSeconds = Vec<(&'static str, f64)>;

/// A triangle to draw on a billboard, in the frame of the atlas layout.
pub struct Drawn<'a> {
    /// The foliage of the triangle.
    pub foliage: &'a Foliage,
    /// Index of the triangle in `foliage`.
    pub triangle: usize,
    /// Its corners in the plane, at a = 1.
    pub targets: [DVec3; 3],
    /// Its original corners: their heights along the normal are its depths; higher triangles hide lower ones.
    pub corners: [DVec3; 3],
    /// Greatest distance from the plane up to which it is drawn.
    pub reach: f64,
}

/// Renders every billboard's triangles into its region of the atlas page.
///
/// `drawn` returns the triangles that a plane shows. Without a `sky`, channels that depend on it are left out. Colors under transparent
/// texels are filled in from their surroundings, so that filters find no other color.
///
/// # Panics
/// Never: base color is always among the channels.
pub fn bake<'a>(
    atlas: &Atlas,
    samples: Samples,
    channels: (&Channels, Option<&Sky>),
    drawn: impl Fn(u32) -> Vec<Drawn<'a>> + Sync,
) -> Page {
    let baked = bake_timed(atlas, samples, channels, drawn, Progress::silent());
    baked.expect("nobody cancels a silent progress").0
}

/// Renders the page as [`bake`] does; also returns the seconds spent on each of its images. Reports progress.
///
/// # Errors
/// [`crate::Error::Cancelled`].
///
/// # Panics
/// Never: base color is always among the channels.
pub fn bake_timed<'a>(
    atlas: &Atlas,
    samples: Samples,
    (channels, sky): (&Channels, Option<&Sky>),
    drawn: impl Fn(u32) -> Vec<Drawn<'a>> + Sync,
    progress: Progress,
) -> Result<(Page, ChannelSeconds)> {
    let places: Vec<ToPage> = atlas.billboards.iter().map(ToPage::new).collect();
    let place = |index: usize| {
        let drawn = drawn(atlas.billboards[index].plane);
        drawn.iter().map(|d| places[index].place(d)).filter(ScreenTriangle::is_within).collect::<Vec<_>>()
    };
    let triangles: Vec<ScreenTriangle> = (0..places.len()).into_par_iter().flat_map_iter(place).collect();
    let channels = channels.list(sky);
    let PageSize { width, height } = atlas.size;
    let (canvases, spent) =
        rasterise_timed(&triangles, width, height, samples, &channels, progress.part(0.0, RENDERED))?;
    let filling = progress.part(RENDERED, 1.0);
    let count = channels.len() as f64;
    let (mut images, mut seconds) = (Vec::new(), ChannelSeconds::new());
    for (channel, (mut canvas, shading)) in channels.into_iter().zip(canvases.into_iter().zip(spent)) {
        filling.tell("bake", images.len() as f64 / count)?;
        let started = Instant::now();
        if channel.is_label() {
            labels::spread(&mut canvas);
        } else {
            dilate::fill_transparent(&mut canvas);
        }
        let image = channel.to_image(&canvas);
        seconds.push((channel.name(), shading + started.elapsed().as_secs_f64()));
        images.push((channel, image));
    }
    let page = Page::of(images).expect("base color is always there");
    Ok((page, seconds))
}

/// The share of a bake's time that rendering takes; the rest fills gaps.
const RENDERED: f64 = 0.8;

/// Map from a billboard's plane to texels of the atlas page.
struct ToPage {
    origin: DVec3,
    /// Texels per unit, along the columns and up the rows.
    across: DVec3,
    up: DVec3,
    normal: DVec3,
    left: f64,
    bottom: f64,
    /// The region as a clip window: outlines follow opaque parts, so triangles may reach beyond their region into others.
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
mod mips_tests;
#[cfg(test)]
mod tests;
