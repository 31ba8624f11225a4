//! Sky visibility at any position in a crown, for occlusion and self-shadowing of billboards.
//!
//! Shadow maps of the crown are rendered from many directions (Williams, "Casting curved shadows on curved surfaces", 1978). A position
//! sees a direction if nothing lies nearer to that sun in its shadow map. Visibility is stored to first order, V(l) ≈ m + b · l, by least
//! squares: the mean m is ambient occlusion; the vector b points toward the open sky. Shaders use the ramp with the same m and b
//! (`lc_sun_share` in `shaders/leafcloud.glsl`): for a single gap it is a cone with an edge. O(directions · (triangles + positions)).
//!
//! Known limits: several gaps are treated as one between them. Surfaces nearer than R/48 cast no shadow, so that leaves do not shade
//! themselves.

use glam::{DVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::raster::{ScreenTriangle, Window, depths};
use crate::foliage::Foliage;
use crate::geometry::Frame;

/// Numbers of directions for few and for many triangles. Each direction costs a shadow map.
const DIRECTIONS: usize = 64;
const FEWEST_DIRECTIONS: usize = 16;
const MANY_TRIANGLES: usize = 200_000;

/// Side of a shadow map in pixels.
const PIXELS: usize = 256;

/// Shadow bias in pixels: a surface this little nearer to the sun does not hide a position, so that leaves do not shade themselves. It is
/// R/48 for the sky.
const BIAS: f32 = 8.0 / 3.0;

/// Sky visibility at a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outlook {
    /// Visible share of all directions, in [0, 1].
    pub share: f32,
    /// To first order, the visible share toward l is `share + toward · l`; in the caller's axes.
    pub toward: Vec3,
}

/// Sky visibility in a crown, as shadow maps.
#[derive(Clone, Debug, PartialEq)]
pub struct Sky {
    frame: Frame,
    shadows: Vec<Shadow>,
}

impl Sky {
    /// Renders the shadow maps of `parts`, which cast shadows from both sides. `frame` bounds the positions for [`Self::from`].
    #[must_use]
    pub fn over(parts: &[&Foliage], frame: &Frame) -> Self {
        let parts: Vec<Foliage> = parts.iter().map(|part| part.double_sided()).collect();
        let triangles: usize = parts.iter().map(Foliage::triangle_count).sum();
        let count = if triangles > MANY_TRIANGLES { FEWEST_DIRECTIONS } else { DIRECTIONS };
        Self { frame: *frame, shadows: directions(count).map(|sun| Shadow::cast(&parts, frame, sun, PIXELS)).collect() }
    }

    /// Returns the sky visibility at a position in the caller's coordinates.
    #[must_use]
    pub fn from(&self, place: DVec3) -> Outlook {
        let place = self.frame.to_local(place).as_vec3();
        let seen = self.shadows.iter().filter(|shadow| shadow.reaches(place));
        let sum: Vec4 = seen.map(|shadow| (3.0 * shadow.sun).extend(1.0)).sum();
        let mean = sum / self.shadows.len() as f32;
        Outlook { share: mean.w, toward: mean.truncate() }
    }
}

/// Returns directions on a spiral over the whole sphere. Their means and those of their squares are uniform to about 1/count.
fn directions(count: usize) -> impl Iterator<Item = DVec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
        let (radius, angle) = ((1.0 - z * z).sqrt(), i as f64 * golden);
        DVec3::new(radius * libm::cos(angle), radius * libm::sin(angle), z)
    })
}

/// A shadow map: the depth nearest to a sun at each pixel.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Shadow {
    right: Vec3,
    up: Vec3,
    /// Width and height in pixels.
    pixels: usize,
    /// Direction to the sun, of length 1.
    pub sun: Vec3,
    /// Depths toward the sun; −∞ in empty pixels.
    depths: Vec<f32>,
}

impl Shadow {
    /// Renders a shadow map of `pixels`² of double-sided parts. `frame` bounds the positions for [`Self::reaches`].
    pub fn cast(parts: &[Foliage], frame: &Frame, sun: DVec3, pixels: usize) -> Self {
        let right = sun.any_orthonormal_vector();
        let up = sun.cross(right);
        let half = pixels as f64 / 2.0;
        let place = |foliage: &Foliage, triangle: usize| {
            let onto = |p: DVec3| {
                let p = frame.to_local(foliage.frame().to_caller(p));
                DVec3::new(half + half * right.dot(p), half - half * up.dot(p), sun.dot(p)).as_vec3()
            };
            foliage.corners(triangle).map(onto)
        };
        let mut triangles: Vec<ScreenTriangle> = Vec::new();
        for foliage in parts {
            let shown = (0..foliage.triangle_count()).into_par_iter().map(|triangle| ScreenTriangle {
                reach: f32::INFINITY,
                corners: place(foliage, triangle),
                foliage,
                triangle: triangle as u32,
                window: &Window::WHOLE,
            });
            triangles.par_extend(shown);
        }
        let depths = depths(&triangles, pixels, pixels);
        Self { right: right.as_vec3(), up: up.as_vec3(), pixels, sun: sun.as_vec3(), depths }
    }

    /// Returns whether the sun reaches the position, in local coordinates.
    pub fn reaches(&self, place: Vec3) -> bool {
        let half = self.pixels as f32 / 2.0;
        let (x, y) = (half + half * self.right.dot(place), half - half * self.up.dot(place));
        // Nothing lies outside the map. Negative numbers are checked first because their casts give 0.
        let inside = |at: f32| (at >= 0.0 && at < self.pixels as f32).then_some(at as usize);
        let pixel = inside(x).zip(inside(y)).map(|(column, row)| row * self.pixels + column);
        pixel.is_none_or(|pixel| self.depths[pixel] <= self.sun.dot(place) + BIAS / half)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::foliage::Attributes;

    /// Squares of side 2 at the given heights, facing up. R is the radius of their bounding sphere.
    pub(crate) fn tiers(heights: &[f64]) -> Foliage {
        let corners = |z: f64| [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z));
        let positions: Vec<DVec3> = heights.iter().flat_map(|&z| corners(z)).collect();
        let square = |i: usize| [[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|c| c + 4 * i as u32));
        let triangles = (0..heights.len()).flat_map(square).collect();
        Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap()
    }

    #[test]
    fn directions_average_out() {
        for count in [FEWEST_DIRECTIONS, DIRECTIONS] {
            let mean = directions(count).sum::<DVec3>() / count as f64;
            let squares = directions(count).map(|d| d * d).sum::<DVec3>() / count as f64;
            assert!(mean.length() < 0.02, "{mean}");
            assert!((squares - 1.0 / 3.0).abs().max_element() < 0.02, "{squares}");
        }
    }

    #[test]
    fn over_a_large_roof_half_of_the_sky_is_seen() {
        let roof = tiers(&[0.0]);
        let sky = Sky::over(&[&roof], roof.frame());
        // Close above its middle, V(l) is 1 for l up and 0 for l down: to first order ½ + ¾ z (by hand: 3 · mean of V z = ¾).
        let outlook = sky.from(DVec3::new(0.0, 0.0, 0.08));
        assert!((outlook.share - 0.5).abs() < 0.06, "{outlook:?}");
        assert!((outlook.toward - Vec3::Z * 0.75).abs().max_element() < 0.1, "{outlook:?}");
        let below = sky.from(DVec3::new(0.0, 0.0, -0.08));
        assert!((below.toward + Vec3::Z * 0.75).abs().max_element() < 0.1, "{below:?}");
    }

    #[test]
    fn between_roofs_only_the_sides_are_open() {
        let roofs = tiers(&[-0.25, 0.25]);
        let sky = Sky::over(&[&roofs], roofs.frame());
        let outlook = sky.from(DVec3::ZERO);
        // The open band |z| < sin(atan(¼)) at the least (along the sides), sin(atan(¼ / √2)) at the corners.
        assert!((0.15..0.3).contains(&outlook.share), "{outlook:?}");
        assert!(outlook.toward.length() < 0.1, "{outlook:?}");
    }

    #[test]
    fn far_outside_nothing_hides_most_of_the_sky() {
        let roof = tiers(&[0.0]);
        let sky = Sky::over(&[&roof], roof.frame());
        let corner = roof.frame().centre + DVec3::splat(roof.frame().radius);
        assert!(sky.from(corner).share > 0.85);
        assert_eq!(sky.from(corner * 50.0).share, 1.0, "nothing lies outside the shadow maps");
    }

    #[test]
    fn a_leaf_does_not_shade_itself() {
        let corners = [(-1.0, -0.6, 0.3), (1.0, -0.6, -0.2), (1.0, 0.6, 0.3), (-1.0, 0.6, 0.8)];
        let corners = corners.map(|(x, y, z)| DVec3::new(x, y, z));
        let leaf = Foliage::new(&corners, vec![[0, 1, 2], [0, 2, 3]], Attributes::default(), vec![]).unwrap();
        let sky = Sky::over(&[&leaf], leaf.frame());
        for i in 1..20 {
            let share = f64::from(i) / 20.0;
            let outlook = sky.from(corners[0].lerp(corners[2], share));
            // Only grazing suns are hidden.
            assert!(outlook.share > 0.9 && outlook.toward.length() < 0.2, "{outlook:?}");
        }
    }

    #[test]
    fn transparent_leaves_cast_no_shadow() {
        use crate::foliage::{AlphaMode, Material};
        use glam::Vec4;
        let glass =
            Material { base_color: Vec4::new(1.0, 1.0, 1.0, 0.0), alpha_mode: AlphaMode::Blend, ..Material::default() };
        let clear = tiers(&[-0.25, 0.25]).with_materials(|_| glass.clone());
        let outlook = Sky::over(&[&clear], clear.frame()).from(DVec3::ZERO);
        assert!(outlook.share == 1.0 && outlook.toward.length() < 0.05, "{outlook:?}");
    }
}
