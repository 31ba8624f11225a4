//! Coverage of billboards with many versions of their page's alpha, in the views of a reference.

use rayon::prelude::*;

use super::measure::coverage_of;
use super::render::layers;
use super::{Reference, View, in_each_view};
use crate::color::quantise;
use crate::error::Result;
use crate::foliage::{AlphaMode, Foliage, Image};
use crate::textures::Layers;

/// The points of foliage at all samples of a reference's views. Its texture and alpha mode may be replaced; its base color has alpha 1.
pub struct Layered<'a> {
    reference: &'a Reference,
    views: Vec<Layers>,
}

impl Reference {
    /// Finds the points of foliage in all views.
    ///
    /// # Errors
    /// Those of [`super::render()`].
    pub fn layered(&self, foliage: &Foliage) -> Result<Layered<'_>> {
        let views = in_each_view(&[foliage], &self.views, |view| layers(foliage, view))?;
        Ok(Layered { reference: self, views })
    }
}

impl Layered<'_> {
    /// Returns the coverage that [`Reference::agreement`] finds, with `image` as texture.
    #[must_use]
    pub fn coverage(&self, image: &Image, mode: AlphaMode) -> f64 {
        let [coverage] = self.of(|layers| [layers.covered(image, mode)]);
        coverage
    }

    /// Returns the same with `image` cut out at each of some ascending cutoffs.
    #[must_use]
    pub fn cut_out<const N: usize>(&self, image: &Image, cutoffs: [f32; N]) -> [f64; N] {
        self.of(|layers| layers.cut_out(image, cutoffs))
    }

    /// Returns the coverage from the number of covered samples of each pixel in each view.
    fn of<const N: usize>(&self, covered: impl Fn(&Layers) -> [Vec<u32>; N] + Sync) -> [f64; N] {
        let alpha = |(layers, view): (&Layers, &View)| {
            let most = view.samples.side().pow(2) as f32;
            let sum = |counts: Vec<u32>| {
                counts.into_iter().map(|count| u64::from(quantise(count as f32 / most))).sum::<u64>() as f64
            };
            covered(layers).map(sum)
        };
        let sums: Vec<[f64; N]> = self.views.par_iter().zip(&self.reference.views).map(alpha).collect();
        std::array::from_fn(|i| coverage_of(self.reference.pictures.iter(), sums.iter().map(|of_view| of_view[i])))
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec2};

    use super::*;
    use crate::foliage::{Attributes, Material};
    use crate::metrics::Views;
    use crate::textures::Samples;

    /// Two squares across each other, each with the whole texture.
    fn crossed(material: Material) -> Foliage {
        let square = |x: DVec3| [-x - DVec3::Z, x - DVec3::Z, x + DVec3::Z, DVec3::Z - x];
        let corners = [square(DVec3::X), square(DVec3::Y)].concat();
        let places = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        let triangles: Vec<[u32; 3]> = [0, 4].iter().flat_map(|i| [[*i, i + 1, i + 2], [*i, i + 2, i + 3]]).collect();
        let uvs = triangles.iter().map(|t| t.map(|corner| places[corner as usize % 4])).collect();
        let attributes = Attributes { uvs, ..Attributes::default() };
        Foliage::new(&corners, triangles, attributes, vec![material]).unwrap()
    }

    #[test]
    fn coverage_is_that_of_renderings() {
        // The same samples in both ways; neither knows the other.
        let views =
            Views { count: 5, size: 40, samples: Samples::new(3).unwrap().unfiltered(), up: DVec3::Z, turn: 0.2 };
        let whole = crossed(Material { double_sided: true, ..Material::default() });
        let reference = Reference::new(&[&whole], whole.frame(), views).unwrap();
        let image = Image::new(2, 2, vec![[0, 0, 0, 255], [0; 4], [0, 0, 0, 128], [0, 0, 0, 255]]).unwrap();
        for mode in [AlphaMode::Mask(0.3), AlphaMode::Mask(0.7), AlphaMode::Blend] {
            let shown = Some(image.clone());
            let cut = crossed(Material { double_sided: true, image: shown, alpha_mode: mode, ..Material::default() });
            let found = reference.layered(&whole).unwrap().coverage(&image, mode);
            let rendered = reference.agreement(&cut).unwrap().coverage;
            assert!(rendered < 0.99 && (found - rendered).abs() < 1e-3, "{mode:?}: {found}, rendered {rendered}");
        }
    }
}
