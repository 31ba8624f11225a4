//! Visible part of each triangle: the share that passes its alpha test, and the convex hull of that part.
//!
//! Leaf cards are mostly transparent: the drawn texels count, not the card's area. A triangle is cut into [`FINE`]² equal small triangles;
//! triangles with the same UVs and material are evaluated once. The share samples the middle of each small triangle. The hull takes every
//! small triangle with an opaque texel in its texel box. So it never omits a drawn texel, except for blended alpha below [`FAINTEST`] and
//! at an image's edge (see `texel_mask`). It is too large by at most one small triangle's box.

use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec2};
use rayon::prelude::*;

use super::surface::{Surface, a_hair_less};
use super::texel_mask::TexelMask;
use super::{AlphaMode, Foliage, Material};
use crate::geometry::convex_hull;

/// Cuts of a triangle's side: `FINE`, or `COARSE` for more than `MANY` different triangles.
const FINE: usize = 32;
const COARSE: usize = 4;
const MANY: usize = 8192;

/// Blended alpha at or above this lies inside the hull; above ½ it counts as visible.
const FAINTEST: f32 = 0.02;

/// The visible part of a triangle.
#[derive(Clone, Debug, PartialEq)]
pub struct Visible {
    /// Visible share of the area, in [0, 1].
    pub share: f32,
    /// Corners of the convex hull as barycentric weights; empty if nothing is visible.
    pub hull: Vec<DVec3>,
}

impl Visible {
    /// Returns a fully visible triangle.
    fn whole() -> Self {
        Self { share: 1.0, hull: vec![DVec3::X, DVec3::Y, DVec3::Z] }
    }
}

/// The visible part of each triangle of a foliage.
#[derive(Clone, Debug)]
pub struct Opacity {
    kinds: Vec<Visible>,
    /// Index into `kinds` for each triangle; empty if all triangles use the first.
    kind: Vec<u32>,
}

impl Opacity {
    /// Treats every triangle as opaque.
    #[must_use]
    pub fn ignored() -> Self {
        Self { kinds: vec![Visible::whole()], kind: Vec::new() }
    }

    /// Evaluates the alpha of the triangles.
    #[must_use]
    pub fn of(foliage: &Foliage) -> Self {
        let tested = |t: usize| {
            let material = foliage.material(t);
            let varies = material.image.is_some() || !foliage.attributes().colors.is_empty();
            material.alpha_mode != AlphaMode::Opaque && (varies || material.base_color.w < least_alpha(material))
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
                *numbers.entry(key_of(foliage, t)).or_insert_with(|| {
                    examples.push(t);
                    examples.len() as u32
                })
            })
            .collect();
        let cuts = if examples.len() > MANY { COARSE } else { FINE };
        let masks = Masks::of(foliage);
        let parts = examples.par_iter().map(|&t| visible_part(&masks.triangle(t), cuts));
        Self { kinds: std::iter::once(Visible::whole()).chain(parts.collect::<Vec<_>>()).collect(), kind }
    }

    /// Returns whether no triangle has a visible part.
    #[must_use]
    pub fn shows_nothing(&self) -> bool {
        !self.kind.is_empty() && self.kind.iter().all(|&kind| self.kinds[kind as usize].hull.is_empty())
    }

    /// Returns the visible part of a triangle.
    #[must_use]
    pub fn get(&self, triangle: usize) -> &Visible {
        &self.kinds[self.kind.get(triangle).map_or(0, |&k| k as usize)]
    }
}

/// Returns a key of material, UVs and corner alpha; triangles with equal keys look alike.
fn key_of(foliage: &Foliage, triangle: usize) -> (u32, [u32; 6], [u32; 3]) {
    let attributes = foliage.attributes();
    let [a, b, c] = attributes.uvs.get(triangle).copied().unwrap_or_default();
    let alphas = attributes.colors.get(triangle).map_or([0; 3], |colors| colors.map(|c| c.w.to_bits()));
    let material = attributes.material_ids.get(triangle).copied().unwrap_or(0);
    (material, [a.x, a.y, b.x, b.y, c.x, c.y].map(f32::to_bits), alphas)
}

/// Opacity tables of the materials' images.
struct Masks<'a> {
    foliage: &'a Foliage,
    /// One per material; `None` without an image.
    masks: Vec<Option<TexelMask>>,
}

impl<'a> Masks<'a> {
    fn of(foliage: &'a Foliage) -> Self {
        // The greatest corner alpha bounds the factor.
        let corners = foliage.attributes().colors.iter().flatten().map(|c| c.w);
        let factor = if foliage.attributes().colors.is_empty() { 1.0 } else { corners.fold(0.0, f32::max) };
        let mask = |material: &Material| {
            let least = least_alpha(material) / (material.base_color.w * factor);
            // With a factor of 0 the corners' own test decides.
            material.image.as_ref().map(|image| TexelMask::new(image, if least.is_nan() { 0.0 } else { least }))
        };
        Self { foliage, masks: foliage.materials.par_iter().map(mask).collect() }
    }

    fn triangle(&self, triangle: usize) -> TestedTriangle<'_> {
        let attributes = self.foliage.attributes();
        let material = attributes.material_ids.get(triangle).copied().unwrap_or(0);
        TestedTriangle {
            surface: Surface::new(self.foliage, triangle),
            least: least_alpha(self.foliage.material(triangle)),
            base: self.foliage.material(triangle).base_color.w,
            mask: self.masks.get(material as usize).and_then(Option::as_ref),
            uvs: attributes.uvs.get(triangle).copied().unwrap_or_default(),
            alphas: attributes.colors.get(triangle).map(|colors| colors.map(|c| c.w)),
        }
    }
}

/// Returns the least alpha inside the hull.
fn least_alpha(material: &Material) -> f32 {
    match material.alpha_mode {
        AlphaMode::Opaque => 0.0,
        AlphaMode::Mask(cutoff) => a_hair_less(cutoff),
        AlphaMode::Blend => FAINTEST,
    }
}

/// A triangle to evaluate.
struct TestedTriangle<'a> {
    surface: Surface<'a>,
    least: f32,
    base: f32,
    mask: Option<&'a TexelMask>,
    uvs: [Vec2; 3],
    alphas: Option<[f32; 3]>,
}

impl TestedTriangle<'_> {
    /// Returns whether any part of a small triangle, given by its corners, may be visible.
    fn may_show(&self, small: &[DVec2; 3]) -> bool {
        let at = |[a, b, c]: [f32; 3], p: &DVec2| {
            let w = barycentric(*p).as_vec3();
            a * w.x + b * w.y + c * w.z
        };
        // Corner alpha is linear: its maximum is at a corner.
        let factor = self.alphas.map_or(1.0, |alphas| small.iter().map(|p| at(alphas, p)).fold(0.0, f32::max));
        let Some(mask) = self.mask else { return self.base * factor >= self.least };
        let places = small.map(|p| Vec2::new(at(self.uvs.map(|uv| uv.x), &p), at(self.uvs.map(|uv| uv.y), &p)));
        let [a, b, c] = places;
        self.base * factor >= self.least && mask.any_within(a.min(b).min(c), a.max(b).max(c))
    }
}

fn visible_part(tested: &TestedTriangle, cuts: usize) -> Visible {
    let mut corners = Vec::new();
    let mut seen = 0usize;
    let at = |i: usize, j: usize| DVec2::new(i as f64, j as f64) / cuts as f64;
    for i in 0..cuts {
        for j in 0..cuts - i {
            // Each grid square has two small triangles; the last of a row has one.
            let lower = [at(i, j), at(i + 1, j), at(i, j + 1)];
            let upper = [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let small_ones = [lower, upper];
            for small in &small_ones[..if i + j + 1 < cuts { 2 } else { 1 }] {
                if tested.may_show(small) {
                    corners.extend_from_slice(small);
                    let middle = barycentric((small[0] + small[1] + small[2]) / 3.0).as_vec3();
                    seen += usize::from(tested.surface.passes(middle, 0.5));
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

/// Returns the point with barycentric weights `w` on a triangle.
#[must_use]
pub fn place(corners: &[DVec3; 3], w: DVec3) -> DVec3 {
    corners[0] * w.x + corners[1] * w.y + corners[2] * w.z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::{Attributes, Image};

    /// A right triangle with UVs equal to its coordinates, opaque where `opaque` returns true.
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
        // The tolerance: a texel of the filter, a texel of the box, and a small triangle.
        assert!((0.25..=0.25 + 2.0 / 64.0 + 2.0 / FINE as f64).contains(&farthest), "{farthest}");
    }

    #[test]
    fn a_single_texel_is_inside_the_hull() {
        for (x, y) in [(3, 7), (100, 20), (2, 110), (61, 60)] {
            let dot = seen(128, |i, j| (i, j) == (x, y));
            let middle = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) / 128.0;
            let hull: Vec<DVec2> = dot.hull.iter().map(|w| DVec2::new(w.y, w.z)).collect();
            let (low, high) = (hull.iter().copied().reduce(DVec2::min), hull.iter().copied().reduce(DVec2::max));
            let (low, high) = (low.expect("something is seen"), high.expect("something is seen"));
            assert!(low.cmple(middle).all() && high.cmpge(middle).all(), "{middle} of {low} to {high}");
            assert!((high - low).max_element() < 0.25, "{low} to {high} is not tight");
        }
    }

    #[test]
    fn without_alpha_nothing_is_looked_at() {
        let foliage =
            Foliage::new(&[DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]], Attributes::default(), vec![]).unwrap();
        assert_eq!(*Opacity::of(&foliage).get(0), Visible::whole());
    }
}
