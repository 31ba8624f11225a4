//! Light for pictures: a sun with shadows and a sky, so that pictures also show normals, and gaps between leaves of the same color.
//!
//! A surface of base color c with the normal n on the visible side has the light c · (SKY + SUN · max(n·l, 0) · v), where v is 0 if something
//! hides the sun, else 1. The shadow map is as in `textures/sky.rs`, with its limits. No light shines through leaves.

use glam::{DVec3, Vec3};

use crate::foliage::Foliage;
use crate::geometry::Frame;
use crate::textures::{Channel, Seen, Shader, Shadow};

/// Brightness of a white surface that faces the sun: a clear day, with half of the sky hidden.
const SUN: f32 = 0.95;
/// Brightness of a white surface that only the sky lights.
pub const SKY: f32 = 0.25;

/// Side of the shadow map in pixels.
const SHADOW_PIXELS: usize = 512;

/// Returns the brightness of a white surface. `facing`: n·l; `share`: fraction of the sun that reaches the surface.
pub(crate) fn brightness(facing: f32, share: f32) -> f32 {
    SKY + SUN * facing.max(0.0) * share
}

/// A sun that shines on a model.
pub(super) struct Light {
    frame: Frame,
    shadow: Shadow,
}

impl Light {
    /// Casts the shadows of `parts` for a sun in the direction `sun`, of length 1. `frame` bounds the shadow map.
    pub fn on(parts: &[&Foliage], frame: &Frame, sun: DVec3) -> Self {
        let parts: Vec<Foliage> = parts.iter().map(|part| part.double_sided()).collect();
        Self { frame: *frame, shadow: Shadow::cast(&parts, frame, sun, SHADOW_PIXELS) }
    }

    fn brightness_at(&self, seen: &Seen) -> f32 {
        let facing = seen.normal().map_or(0.0, |normal| normal.dot(self.shadow.sun));
        let is_lit = facing > 0.0 && self.shadow.reaches(self.frame.to_local(seen.place()).as_vec3());
        brightness(facing, f32::from(u8::from(is_lit)))
    }
}

/// How a picture shows base colors.
pub(super) enum Look<'a> {
    Flat,
    Lit(&'a Light),
}

impl Shader for Look<'_> {
    fn shade(&self, seen: &Seen) -> Vec3 {
        let color = Channel::BaseColor.shade(seen);
        match self {
            Self::Flat => color,
            Self::Lit(light) => color * light.brightness_at(seen),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec4;

    use super::*;
    use crate::Progress;
    use crate::color::decode_table;
    use crate::foliage::Material;
    use crate::metrics::{Reference, View, Views, render_lit};
    use crate::textures::Samples;

    /// White squares of side 2 that face up, at the given heights.
    fn tiers(heights: &[f64]) -> Foliage {
        let white = Material { base_color: Vec4::ONE, double_sided: true, ..Material::default() };
        crate::textures::tiers(heights).with_materials(|_| white.clone())
    }

    fn view(direction: DVec3, centre: DVec3) -> View {
        View { direction, up: DVec3::Z, centre, radius: 0.1, size: 8, samples: Samples::new(2).unwrap() }
    }

    /// Returns the linear brightness in the middle of a picture of the leaves.
    fn middle(leaves: &Foliage, view: &View, sun: DVec3) -> f32 {
        let picture = render_lit(&[leaves], view, sun, Progress::silent()).unwrap();
        decode_table()[picture.pixels()[4 * 8 + 4][0] as usize]
    }

    /// An 8-bit code is within 0.005 of its brightness.
    fn is_near(found: f32, exact: f32) -> bool {
        (found - exact).abs() < 0.006
    }

    #[test]
    fn a_leaf_is_as_bright_as_it_faces_the_sun() {
        let leaf = tiers(&[0.0]);
        let above = view(DVec3::new(0.3, 0.2, 1.0), DVec3::ZERO);
        for height in [20f64, 45.0] {
            let sun = DVec3::new(height.to_radians().cos(), 0.0, height.to_radians().sin());
            let found = middle(&leaf, &above, sun * 7.0);
            assert!(is_near(found, 0.25 + 0.95 * height.to_radians().sin() as f32), "{height}°: {found}");
        }
        assert!(is_near(middle(&leaf, &above, -DVec3::Z), 0.25), "the other side is lit");
        assert!(is_near(middle(&leaf, &view(-DVec3::Z, DVec3::ZERO), DVec3::Z), 0.25), "the back has the sky alone");
    }

    #[test]
    fn a_leaf_shades_the_leaves_below_it() {
        let leaves = tiers(&[0.0, 0.5]);
        let sun = DVec3::new(0.6, 0.0, 0.8);
        // The sun passes the upper leaf's border at x = 1 and reaches the lower leaf from x = 1 − 0.5 · 0.6 / 0.8 = 0.625 on.
        let below = |x: f64| middle(&leaves, &view(DVec3::new(0.0, -1.0, 0.2), DVec3::new(x, -0.9, 0.0)), sun);
        assert!(is_near(below(0.4), 0.25), "{}", below(0.4));
        assert!(is_near(below(0.8), 1.0), "{}", below(0.8));
    }

    #[test]
    fn collapsed_leaves_keep_the_normals_that_they_had() {
        let leaf = tiers(&[0.0]);
        let tilted = leaf.with_normals();
        let corners: Vec<_> =
            (0..2).map(|t| tilted.corners(t).map(|p| DVec3::new(p.x, p.y * 0.8, p.y * 0.6))).collect();
        let tilted = tilted.with_corners(&corners).unwrap();
        let found = middle(&tilted, &view(DVec3::new(0.0, -0.6, 0.8), tilted.frame().centre), DVec3::Z);
        assert!(is_near(found, 1.0), "{found}");
    }

    #[test]
    fn without_light_pictures_of_equal_colors_agree_and_lit_ones_do_not() {
        // The same silhouette from above. The lower leaf shows a gap between two halves of the upper one, in its shadow.
        let views = Views { count: 1, size: 32, samples: Samples::new(2).unwrap(), up: DVec3::Z, turn: 0.0 };
        let whole = tiers(&[0.0, 0.3]);
        let gap: Vec<_> =
            (0..4).map(|t| whole.corners(t).map(|p| if t > 1 { DVec3::new(p.x, p.y * 0.5, p.z) } else { p })).collect();
        let torn = whole.with_corners(&gap).unwrap();
        let reference = Reference::lit(&[&whole], whole.frame(), views).unwrap();
        let same = reference.compare(&[&whole]).unwrap();
        assert_eq!(same.lit.as_ref().unwrap().base, same.lit.as_ref().unwrap().level);
        let found = reference.compare(&[&torn]).unwrap();
        let lit = found.lit.unwrap();
        let changed = |a: &[crate::Image], b: &[crate::Image]| {
            a[0].pixels().iter().zip(b[0].pixels()).filter(|(a, b)| a[0].abs_diff(b[0]) > 20).count()
        };
        assert!(changed(&lit.base, &lit.level) > 40, "{}", changed(&lit.base, &lit.level));
    }

    #[test]
    fn a_sun_without_a_direction_is_refused() {
        let leaf = tiers(&[0.0]);
        let error = render_lit(&[&leaf], &view(DVec3::Z, DVec3::ZERO), DVec3::ZERO, Progress::silent()).unwrap_err();
        assert!(error.to_string().starts_with("the sun's direction is [0.0, 0.0, 0.0]"), "{error}");
    }
}
