//! Orthographic renderings: of base color and alpha, so that differences come from geometry and textures, or lit.

use glam::{DVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::light::{Light, Look};
use crate::color::quantise;
use crate::error::{Error, Result};
use crate::foliage::{Foliage, Image};
use crate::geometry::Frame;
use crate::progress::Progress;
use crate::textures::{
    Channel, Layers, Samples, ScreenTriangle, Seen, SeenTriangles, Shader, Window, count_covered, count_seen,
    rasterise, rasterise_timed, seen_among,
};

/// An orthographic camera.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Direction from the center to the eye; any length but 0.
    pub direction: DVec3,
    /// Up direction in the image. If the view is parallel to it, another direction replaces it.
    pub up: DVec3,
    /// Center of the image, in the caller's coordinates.
    pub centre: DVec3,
    /// Half of the image's side, in the caller's units.
    pub radius: f64,
    /// Width and height in pixels.
    pub size: usize,
    /// Sub-samples along each side of a pixel.
    pub samples: Samples,
}

impl View {
    /// Returns the directions to the right and up in the image; `eye` is `direction` with the length 1.
    pub(crate) fn axes(&self, eye: DVec3) -> [DVec3; 2] {
        let right = self.up.cross(eye).try_normalize().unwrap_or_else(|| eye.any_orthonormal_vector());
        [right, eye.cross(right)]
    }

    /// Returns `direction` with the length 1.
    ///
    /// # Errors
    /// The first part of the view that is outside its range.
    pub(crate) fn checked(&self) -> Result<DVec3> {
        let eye = unit(self.direction, "the view's direction")?;
        let radius_counts = self.radius > 0.0 && self.radius.is_finite();
        if !radius_counts || !(1..=16_384).contains(&self.size) {
            return Err(Error::invalid(format!(
                "an image with the radius {:?} and {} pixels per side; the radius must be above 0, the pixels between 1 and 16384",
                self.radius, self.size
            )));
        }
        match [("centre", self.centre), ("up", self.up)].into_iter().find(|(_, v)| !v.is_finite()) {
            Some((name, v)) => {
                Err(Error::invalid(format!("the view's {name} is {:?}; it must be finite", v.to_array())))
            }
            None => Ok(eye),
        }
    }
}

/// Renders all parts into one image; uncovered pixels are transparent.
///
/// # Errors
/// No parts; a direction without length; a center or up direction that is not finite; a radius that is not above 0; a size outside 1 to
/// 16384; parts so large against the image that single precision cannot place them.
pub fn render(parts: &[&Foliage], view: &View) -> Result<Image> {
    render_watched(parts, view, Progress::silent())
}

/// Renders as [`render()`] does, and reports progress.
///
/// # Errors
/// Those of [`render()`]; [`Error::Cancelled`].
pub fn render_watched(parts: &[&Foliage], view: &View, progress: Progress) -> Result<Image> {
    let triangles = on_screen(parts, view)?;
    let size = view.size;
    let (canvases, _) = rasterise_timed(&triangles, size, size, view.samples.each(), &[Channel::BaseColor], progress)?;
    Ok(Channel::BaseColor.to_image(&canvases[0]))
}

/// Renders alpha alone, on black.
///
/// # Errors
/// Those of [`render()`].
pub fn silhouette(parts: &[&Foliage], view: &View) -> Result<Image> {
    let counts = count_covered(on_screen(parts, view)?, view.size, view.size, view.samples);
    let most = view.samples.side().pow(2) as f32;
    let pixels = counts.into_iter().map(|count| [0, 0, 0, quantise(count as f32 / most)]);
    Image::new(view.size, view.size, pixels.collect::<Vec<_>>())
}

/// Returns the points at which samples of a view meet the foliage.
///
/// # Errors
/// Those of [`render()`].
pub(super) fn layers(foliage: &Foliage, view: &View) -> Result<Layers> {
    Ok(Layers::of(&on_screen(&[foliage], view)?, view.size, view.samples))
}

/// Renders all parts under a clear sky with the sun in the direction `sun`; see [`light`](super::light).
///
/// # Errors
/// Those of [`render()`]; a sun without a finite length above 0; [`Error::Cancelled`].
///
/// # Panics
/// Never: foliage has an area.
pub fn render_lit(parts: &[&Foliage], view: &View, sun: DVec3, progress: Progress) -> Result<Image> {
    let sun = unit(sun, "the sun's direction")?;
    let triangles = on_screen(parts, view)?;
    let corners = parts.iter().flat_map(|part| {
        (0..part.triangle_count()).flat_map(|triangle| part.corners(triangle)).map(|p| part.frame().to_caller(p))
    });
    let frame = Frame::of(corners).expect("foliage has an area");
    let light = Light::on(parts, &frame, sun);
    let (canvases, _) =
        rasterise_timed(&triangles, view.size, view.size, view.samples.each(), &[Look::Lit(&light)], progress)?;
    Ok(Channel::BaseColor.to_image(&canvases[0]))
}

/// Renders parts flat-lit and under `light`.
///
/// # Errors
/// Those of [`render()`].
pub(super) fn flat_and_lit(parts: &[&Foliage], view: &View, light: &Light) -> Result<[Image; 2]> {
    let triangles = on_screen(parts, view)?;
    let canvases = rasterise(&triangles, view.size, view.size, view.samples.each(), &[Look::Flat, Look::Lit(light)]);
    Ok([0, 1].map(|i| Channel::BaseColor.to_image(&canvases[i])))
}

/// Shows where on its texture a point of a triangle lies.
struct Places;

impl Shader for Places {
    fn shade(&self, seen: &Seen) -> Vec3 {
        seen.surface.uv(seen.spot.weights).extend(0.0)
    }
}

/// Returns the texture coordinates that each pixel shows: u, v, 0 and 1; zeros where nothing is drawn. With one sample per pixel they are
/// those of its middle.
///
/// # Errors
/// Those of [`render()`].
pub fn texture_points(foliage: &Foliage, view: &View) -> Result<Vec<Vec4>> {
    let triangles = on_screen(&[foliage], view)?;
    let canvas = rasterise(&triangles, view.size, view.size, view.samples, &[Places]).remove(0);
    Ok(canvas.pixels)
}

/// What a shader of [`shown_points`] shows.
enum Mark {
    /// Base color in linear light.
    Color,
    /// Index of the triangle: its lower 16 bits and the rest.
    Triangle,
}

impl Shader for Mark {
    fn shade(&self, seen: &Seen) -> Vec3 {
        match self {
            Self::Color => Channel::BaseColor.shade(seen),
            Self::Triangle => {
                let index = seen.triangle.triangle;
                Vec3::new((index & 0xFFFF) as f32, (index >> 16) as f32, 0.0)
            }
        }
    }
}

/// Returns base color in linear light, with 1, and the triangle in the middle of each pixel; zeros and `u32::MAX` where nothing is drawn.
/// `corners` has the local places of each triangle's corners, which may be others than those of `foliage`.
///
/// # Errors
/// Those of [`render()`].
pub fn shown_points(
    foliage: &Foliage,
    corners: impl Fn(usize) -> [DVec3; 3] + Sync,
    view: &View,
) -> Result<(Vec<Vec4>, Vec<u32>)> {
    let eye = checked(&[foliage], view)?;
    let triangles = placed(foliage, corners, view, eye);
    let samples = Samples::new(1)?.unfiltered();
    let mut canvases = rasterise(&triangles, view.size, view.size, samples, &[Mark::Color, Mark::Triangle]);
    let index = |p: &Vec4| if p.w > 0.0 { p.x as u32 | (p.y as u32) << 16 } else { u32::MAX };
    let triangles = canvases[1].pixels.iter().map(index).collect();
    Ok((canvases.swap_remove(0).pixels, triangles))
}

/// Returns the number of samples that show each triangle.
///
/// # Errors
/// Those of [`render()`].
pub fn seen_samples(foliage: &Foliage, view: &View) -> Result<Vec<u32>> {
    Ok(count_seen(on_screen(&[foliage], view)?, view.size, view.size, view.samples))
}

/// Draws a picture of each item of `parts`, all behind the same `leaves` if given. Returns the triangles of each part that are visible.
///
/// # Errors
/// Those of [`render()`].
pub fn seen_behind(leaves: Option<&Foliage>, parts: &[&Foliage], view: &View) -> Result<Vec<SeenTriangles>> {
    let leaves = leaves.map_or(Ok(Vec::new()), |leaves| on_screen(&[leaves], view))?;
    let parts = parts.iter().map(|part| on_screen(&[part], view)).collect::<Result<Vec<_>>>()?;
    Ok(seen_among(&leaves, &parts, view.size, view.size, view.samples))
}

/// Returns all triangles in screen coordinates.
fn on_screen<'a>(parts: &[&'a Foliage], view: &View) -> Result<Vec<ScreenTriangle<'a>>> {
    let eye = checked(parts, view)?;
    let of_part = |&part: &&'a Foliage| placed(part, |triangle| part.corners(triangle), view, eye);
    let (first, others) = parts.split_first().expect("there are parts");
    let mut triangles = of_part(first);
    for part in others {
        triangles.extend(of_part(part));
    }
    Ok(triangles)
}

/// Checks a view of parts, and returns its direction with length 1.
fn checked(parts: &[&Foliage], view: &View) -> Result<DVec3> {
    let eye = view.checked()?;
    check_place(parts, view)?;
    Ok(eye)
}

/// Returns the triangles of a part in screen coordinates, with corners at these local places.
fn placed<'a>(
    foliage: &'a Foliage,
    corners: impl Fn(usize) -> [DVec3; 3] + Sync,
    view: &View,
    eye: DVec3,
) -> Vec<ScreenTriangle<'a>> {
    let [right, up] = view.axes(eye);
    let half = view.size as f64 / 2.0;
    let to_screen = |p: DVec3| {
        let q = (p - view.centre) / view.radius;
        DVec3::new(half + half * right.dot(q), half - half * up.dot(q), eye.dot(q)).as_vec3()
    };
    let place = |triangle: usize| ScreenTriangle {
        reach: f32::INFINITY,
        corners: corners(triangle).map(|p| to_screen(foliage.frame().to_caller(p))),
        foliage,
        triangle: triangle as u32,
        window: &Window::WHOLE,
    };
    (0..foliage.triangle_count()).into_par_iter().map(place).collect()
}

/// Returns the direction with length 1.
fn unit(direction: DVec3, name: &str) -> Result<DVec3> {
    direction.try_normalize().filter(|d| d.is_finite()).ok_or_else(|| {
        Error::invalid(format!("{name} is {:?}; it needs a finite length above 0", direction.to_array()))
    })
}

/// Greatest extent of the parts from the image's center, in radii of the image.
const REACH: f64 = 1e6;

fn check_place(parts: &[&Foliage], view: &View) -> Result<()> {
    if parts.is_empty() {
        return Err(Error::invalid("there are no parts to render; give at least one foliage"));
    }
    let reach = |part: &&Foliage| (part.frame().centre.distance(view.centre) + part.frame().radius) / view.radius;
    match parts.iter().map(reach).find(|reach| reach.is_nan() || *reach > REACH) {
        Some(reach) => Err(Error::invalid(format!(
            "a part reaches {reach:.1e} radii from the image's center; the limit is {REACH:e}: move the center or raise the radius"
        ))),
        None => Ok(()),
    }
}
