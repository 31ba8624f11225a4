//! An orthographic, flat-lit picture: base colours and alpha only, so that what differs is geometry and texture, not light.

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::foliage::{Foliage, Image};
use crate::textures::{Channel, Samples, ScreenTriangle, Window, count_seen, rasterise};

/// Where the picture is taken from.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// From the centre to the eye; any length but 0.
    pub direction: DVec3,
    /// What is up in the picture; the view may look along it, then it is replaced.
    pub up: DVec3,
    /// What lies in the middle, caller's coordinates.
    pub centre: DVec3,
    /// Half the picture's side, caller's units.
    pub radius: f64,
    /// Side in pixels.
    pub size: usize,
    /// Sub-samples along each side of a pixel.
    pub samples: Samples,
}

/// Renders all parts into one picture; pixels that nothing covers are transparent.
///
/// # Errors
/// No parts; a direction without length; a centre or "up" that is not finite; a radius or a size that is not above 0; parts so much larger
/// than the picture that single precision cannot place them.
pub fn render(parts: &[&Foliage], view: &View) -> Result<Image> {
    rendered(parts, view, Channel::BaseColor)
}

/// The same on black, of alpha alone.
///
/// # Errors
/// As [`render`].
pub fn silhouette(parts: &[&Foliage], view: &View) -> Result<Image> {
    rendered(parts, view, Channel::Alpha)
}

fn rendered(parts: &[&Foliage], view: &View, channel: Channel) -> Result<Image> {
    let triangles = on_screen(parts, view)?;
    Ok(channel.to_image(&rasterise(&triangles, view.size, view.size, view.samples.each(), &[channel])[0]))
}

/// At how many samples of the picture each triangle is seen.
///
/// # Errors
/// As [`render`].
pub fn seen_samples(foliage: &Foliage, view: &View) -> Result<Vec<u32>> {
    Ok(count_seen(&on_screen(&[foliage], view)?, view.size, view.size, view.samples))
}

/// All triangles as the view shows them.
fn on_screen<'a>(parts: &[&'a Foliage], view: &View) -> Result<Vec<ScreenTriangle<'a>>> {
    let eye = view.direction.try_normalize().filter(|d| d.is_finite()).ok_or_else(|| {
        Error::invalid(format!(
            "the view's direction is {:?}; it needs a finite length above 0",
            view.direction.to_array()
        ))
    })?;
    let radius_counts = view.radius > 0.0 && view.radius.is_finite();
    if !radius_counts || !(1..=16_384).contains(&view.size) {
        return Err(Error::invalid(format!(
            "a picture of radius {:?} and {} pixels a side; the radius must be above 0, the pixels between 1 and 16384",
            view.radius, view.size
        )));
    }
    check_place(parts, view)?;
    let right = view.up.cross(eye).try_normalize().unwrap_or_else(|| eye.any_orthonormal_vector());
    let up = eye.cross(right);
    let half = view.size as f64 / 2.0;
    let to_screen = |p: DVec3| {
        let q = (p - view.centre) / view.radius;
        DVec3::new(half + half * right.dot(q), half - half * up.dot(q), eye.dot(q)).as_vec3()
    };
    let mut triangles: Vec<ScreenTriangle> = Vec::new();
    for &foliage in parts {
        let place = |triangle: usize| ScreenTriangle {
            reach: f32::INFINITY,
            corners: foliage.corners(triangle).map(|p| to_screen(foliage.frame().to_caller(p))),
            foliage,
            triangle: triangle as u32,
            window: &Window::WHOLE,
        };
        triangles.par_extend((0..foliage.triangle_count()).into_par_iter().map(place));
    }
    Ok(triangles)
}

/// How many radii of the picture its parts may reach from its centre.
const REACH: f64 = 1e6;

fn check_place(parts: &[&Foliage], view: &View) -> Result<()> {
    if parts.is_empty() {
        return Err(Error::invalid("there are no parts to render; give one foliage at least"));
    }
    if let Some((name, v)) = [("centre", view.centre), ("up", view.up)].into_iter().find(|(_, v)| !v.is_finite()) {
        return Err(Error::invalid(format!("the view's {name} is {:?}; it must be finite", v.to_array())));
    }
    let reach = |part: &&Foliage| (part.frame().centre.distance(view.centre) + part.frame().radius) / view.radius;
    match parts.iter().map(reach).find(|reach| reach.is_nan() || *reach > REACH) {
        Some(reach) => Err(Error::invalid(format!(
            "a part reaches {reach:.1e} radii from the picture's centre; it may reach {REACH:e}: move the centre or raise the radius"
        ))),
        None => Ok(()),
    }
}
