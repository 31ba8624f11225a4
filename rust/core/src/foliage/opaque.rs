//! What of a triangle can be seen: the share of it that its alpha test lets through, and the convex hull of that.
//!
//! A leaf card is mostly transparent. What a card covers is what its texels cover, not its area. A triangle is cut into
//! [`FINE`]² equal small ones, each looked at in its middle; triangles of the same texture coordinates and material are looked at once.
//! Error: a feature smaller than a small triangle can be missed; the hull takes whole small triangles, so it is too large by up to one of them.

use std::collections::HashMap;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::surface::Surface;
use super::{AlphaMode, Foliage};
use crate::geometry::convex_hull;

/// Cuts of a triangle's side where few triangles differ, and where many do.
const FINE: usize = 16;
const COARSE: usize = 4;
const MANY: usize = 8192;

/// Blended alpha above this lies inside the hull; above ½ it counts as seen.
const FAINTEST: f32 = 0.02;

/// What of a triangle can be seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Visible {
    /// The share of its area.
    pub share: f32,
    /// Barycentric weights of the corners of the convex hull; none when nothing can be seen.
    pub hull: Vec<DVec3>,
}

impl Visible {
    /// All of it.
    fn whole() -> Self {
        Self { share: 1.0, hull: vec![DVec3::X, DVec3::Y, DVec3::Z] }
    }
}

/// What can be seen of each triangle of a foliage.
#[derive(Clone, Debug)]
pub struct Opacity {
    kinds: Vec<Visible>,
    /// The kind of each triangle; empty when all are of the first.
    kind: Vec<u32>,
}

impl Opacity {
    /// Every triangle is taken to be opaque.
    #[must_use]
    pub fn ignored() -> Self {
        Self { kinds: vec![Visible::whole()], kind: Vec::new() }
    }

    /// Looks at the triangles' texels.
    #[must_use]
    pub fn of(foliage: &Foliage) -> Self {
        let tested = |t: usize| {
            let material = foliage.material(t);
            material.alpha_mode != AlphaMode::Opaque
                && (material.image.is_some() || !foliage.attributes().colors.is_empty())
        };
        let count = foliage.triangle_count();
        if !(0..count).any(tested) {
            return Self::ignored();
        }
        let (mut numbers, mut examples) = (HashMap::new(), Vec::new());
        let kind: Vec<u32> = (0..count)
            .map(|t| {
                if !tested(t) {
                    return 0;
                }
                *numbers.entry(look_of(foliage, t)).or_insert_with(|| {
                    examples.push(t);
                    examples.len() as u32
                })
            })
            .collect();
        let cuts = if examples.len() > MANY { COARSE } else { FINE };
        let looked = examples.par_iter().map(|&t| look(&Surface::new(foliage, t), cuts));
        Self { kinds: std::iter::once(Visible::whole()).chain(looked.collect::<Vec<_>>()).collect(), kind }
    }

    /// What can be seen of a triangle.
    #[must_use]
    pub fn get(&self, triangle: usize) -> &Visible {
        &self.kinds[self.kind.get(triangle).map_or(0, |&k| k as usize)]
    }
}

/// Equal for triangles that look alike: material, texture coordinates, alpha of the corners.
fn look_of(foliage: &Foliage, triangle: usize) -> (u32, [u32; 6], [u32; 3]) {
    let attributes = foliage.attributes();
    let [a, b, c] = attributes.uvs.get(triangle).copied().unwrap_or_default();
    let alphas = attributes.colors.get(triangle).map_or([0; 3], |colors| colors.map(|c| c.w.to_bits()));
    let material = attributes.material_ids.get(triangle).copied().unwrap_or(0);
    (material, [a.x, a.y, b.x, b.y, c.x, c.y].map(f32::to_bits), alphas)
}

fn look(surface: &Surface, cuts: usize) -> Visible {
    let mut corners = Vec::new();
    let mut seen = 0usize;
    let at = |i: usize, j: usize| DVec2::new(i as f64, j as f64) / cuts as f64;
    for i in 0..cuts {
        for j in 0..cuts - i {
            // Two small triangles share a square; the last of a row has one.
            let lower = [at(i, j), at(i + 1, j), at(i, j + 1)];
            let upper = [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let small_ones = [lower, upper];
            for small in &small_ones[..if i + j + 1 < cuts { 2 } else { 1 }] {
                let middle = (small[0] + small[1] + small[2]) / 3.0;
                let middle = barycentric(middle).as_vec3();
                seen += usize::from(surface.sample(middle, 0.5).is_some());
                if surface.sample(middle, FAINTEST).is_some() {
                    corners.extend_from_slice(small);
                }
            }
        }
    }
    let hull = convex_hull(&corners).into_iter().map(barycentric).collect();
    Visible { share: seen as f32 / (cuts * cuts) as f32, hull }
}

fn barycentric(p: DVec2) -> DVec3 {
    DVec3::new(1.0 - p.x - p.y, p.x, p.y)
}

/// The place with barycentric weights `w` on a triangle.
#[must_use]
pub fn place(corners: &[DVec3; 3], w: DVec3) -> DVec3 {
    corners[0] * w.x + corners[1] * w.y + corners[2] * w.z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::{Attributes, Image, Material};
    use glam::Vec2;

    /// A right triangle whose texture coordinates are its coordinates, opaque where `opaque` says.
    fn seen(side: usize, opaque: impl Fn(usize, usize) -> bool) -> Visible {
        let pixels: Vec<[u8; 4]> = (0..side * side)
            .map(|i| [255, 255, 255, if opaque(i % side, side - 1 - i / side) { 255 } else { 0 }])
            .collect();
        let material = Material {
            image: Some(Image::new(side, side, pixels).unwrap()),
            alpha_mode: AlphaMode::Mask(0.5),
            ..Material::default()
        };
        let attributes = Attributes { uvs: vec![[Vec2::ZERO, Vec2::X, Vec2::Y]], ..Attributes::default() };
        let positions = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let foliage = Foliage::new(&positions, vec![[0, 1, 2]], attributes, vec![material]).unwrap();
        Opacity::of(&foliage).get(0).clone()
    }

    #[test]
    fn all_or_nothing() {
        assert_eq!(seen(4, |_, _| true).share, 1.0);
        let nothing = seen(4, |_, _| false);
        assert_eq!((nothing.share, nothing.hull.len()), (0.0, 0));
    }

    #[test]
    fn a_strip_is_its_share_and_its_hull() {
        // x < 1/4 of the right triangle: 1 − (3/4)² of its area.
        let strip = seen(64, |x, _| x < 16);
        assert!((f64::from(strip.share) - 7.0 / 16.0).abs() < 0.03, "{}", strip.share);
        let farthest = strip.hull.iter().map(|w| w.y).fold(0.0, f64::max);
        assert!((0.25..=0.25 + 1.0 / FINE as f64).contains(&farthest), "{farthest}");
    }

    #[test]
    fn without_alpha_nothing_is_looked_at() {
        let foliage =
            Foliage::new(&[DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]], Attributes::default(), vec![]).unwrap();
        assert_eq!(*Opacity::of(&foliage).get(0), Visible::whole());
    }
}
