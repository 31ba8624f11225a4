//! The size of the texels that leaves are cut out of.
//!
//! A billboard with much finer texels shows nothing more. Leaves that are not cut out, and modelled leaves that show a few texels of a
//! palette, have the edges of their triangles, which are sharper than any texel.

use glam::DVec2;

use super::{AlphaMode, Foliage, Material, area_vector};

/// Fewest texels of a triangle that is cut out of a texture.
const FEWEST_TEXELS: f64 = 64.0;

/// Returns the mean size of a texel, local frame; `None` if a triangle is not cut out of a texture. O(triangles + texels).
#[must_use]
pub fn source_texel(foliage: &Foliage) -> Option<f64> {
    let cuts: Vec<bool> = foliage.materials.iter().map(is_cut_out).collect();
    let (mut area, mut texels) = (0.0, 0.0);
    for t in 0..foliage.triangle_count() {
        let image = foliage.material(t).image.as_ref().filter(|_| cuts[foliage.material_id(t)])?;
        let size = DVec2::new(image.width() as f64, image.height() as f64);
        let [a, b, c] = foliage.attributes().uvs.get(t)?.map(|uv| uv.as_dvec2() * size);
        let shown = 0.5 * (b - a).perp_dot(c - a).abs();
        if shown < FEWEST_TEXELS {
            return None;
        }
        texels += shown;
        area += area_vector(foliage.corners(t)).length();
    }
    (area > 0.0).then(|| (area / texels).sqrt())
}

fn is_cut_out(material: &Material) -> bool {
    let transparent = |image: &super::Image| image.pixels().iter().any(|pixel| pixel[3] < 255);
    material.alpha_mode != AlphaMode::Opaque && material.image.as_ref().is_some_and(transparent)
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec2};

    use super::*;
    use crate::foliage::{Attributes, Image};

    /// Squares of side 2 that show a share of an image of 64², with a hole if `holed`.
    fn squares(mode: AlphaMode, holed: bool, shares: &[f32]) -> Option<f64> {
        let pixels: Vec<[u8; 4]> = (0..64 * 64).map(|i| [0, 90, 0, if holed && i == 0 { 0 } else { 255 }]).collect();
        let image = Some(Image::new(64, 64, pixels).unwrap());
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let halves = [[0, 1, 2], [0, 2, 3]];
        let count = shares.len() as u32;
        let positions: Vec<DVec3> =
            (0..count).flat_map(|i| square.map(|[x, y]| DVec3::new(x, y, f64::from(i)))).collect();
        let triangles = (0..count).flat_map(|i| halves.map(|half| half.map(|k| 4 * i + k))).collect();
        let uv = |k: u32, share: f32| Vec2::from(square[k as usize].map(|x: f64| x as f32 * 0.5)) * share;
        let uvs = shares.iter().flat_map(|&share| halves.map(|half| half.map(|k| uv(k, share)))).collect();
        let material = Material { alpha_mode: mode, image, ..Material::default() };
        let attributes = Attributes { uvs, ..Attributes::default() };
        let foliage = Foliage::new(&positions, triangles, attributes, vec![material]).unwrap();
        source_texel(&foliage).map(|texel| texel * foliage.frame().radius)
    }

    #[test]
    fn a_square_of_64_texels_a_side() {
        let mask = AlphaMode::Mask(0.5);
        let close = |found: Option<f64>, expected: f64| (found.unwrap() / expected - 1.0).abs() < 1e-6;
        assert!(close(squares(mask, true, &[1.0]), 2.0 / 64.0));
        assert!(close(squares(AlphaMode::Blend, true, &[0.5]), 2.0 / 32.0));
        // 8 units of area on 64² and 32² texels.
        assert!(close(squares(mask, true, &[1.0, 0.5]), (8.0f64 / (4096.0 + 1024.0)).sqrt()));
    }

    #[test]
    fn edges_of_triangles_have_no_texels() {
        assert_eq!(squares(AlphaMode::Opaque, true, &[1.0]), None);
        assert_eq!(squares(AlphaMode::Mask(0.5), false, &[1.0]), None, "no hole");
        assert_eq!(squares(AlphaMode::Mask(0.5), true, &[1.0, 0.01]), None, "a palette");
    }
}
