//! Materials: base color, alpha and the other surface properties of a triangle, and their images.

use std::sync::{Arc, OnceLock};

use glam::{Vec3, Vec4};

use super::pyramid::{self, Encoding, Pyramid, PyramidLevel, Texel};
use crate::error::{Error, Result, number};

/// Meaning of alpha, as in glTF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Alpha at or above the cutoff is drawn.
    Mask(f32),
    /// Alpha is coverage.
    Blend,
}

/// An image with straight alpha; color images are sRGB. Row 0 is at the top.
#[derive(Clone, Debug)]
pub struct Image {
    width: usize,
    height: usize,
    pixels: Arc<[[u8; 4]]>,
    /// Least drawn alpha code if a mask cuts the image; texels at or above it count fully.
    whole_from: Option<u8>,
    pyramids: Pyramids,
}

/// Mip pyramids, each built on first use and on one thread: a thread that waits may be a worker that a parallel build would need.
#[derive(Clone, Debug, Default)]
struct Pyramids {
    /// Color pyramids, decoded as sRGB and as linear codes.
    colors: Arc<[OnceLock<Pyramid<Texel>>; 2]>,
    greatest_alpha: Arc<OnceLock<Pyramid<u8>>>,
}

impl PartialEq for Image {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.height, &self.pixels) == (other.width, other.height, &other.pixels)
    }
}

impl Image {
    /// Makes an image of `width` × `height` pixels.
    ///
    /// # Errors
    /// A side of 0, or a number of pixels other than `width` × `height`.
    pub fn new(width: usize, height: usize, pixels: impl Into<Arc<[[u8; 4]]>>) -> Result<Self> {
        let pixels = pixels.into();
        if width == 0 || height == 0 || width.checked_mul(height) != Some(pixels.len()) {
            return Err(Error::invalid(format!(
                "an image of {width} × {height} pixels with data for {}; both sides must be at least 1",
                pixels.len()
            )));
        }
        Ok(Self { width, height, pixels, whole_from: None, pyramids: Pyramids::default() })
    }

    /// Returns the width in pixels.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the height in pixels.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns all pixels, row by row from the top.
    #[must_use]
    pub fn pixels(&self) -> &[[u8; 4]] {
        &self.pixels
    }

    /// Returns the alpha of all pixels.
    pub(crate) fn alpha(&self) -> Vec<u8> {
        self.pixels.iter().map(|pixel| pixel[3]).collect()
    }

    /// Replaces the alpha of all pixels.
    pub(crate) fn with_alpha(self, alpha: Vec<u8>) -> Self {
        let pixels = self.pixels.iter().zip(alpha).map(|(&[r, g, b, _], a)| [r, g, b, a]).collect();
        Self { pixels, pyramids: Pyramids::default(), ..self }
    }

    /// Returns the image with `change` applied to every pixel.
    #[must_use]
    pub fn mapped(&self, change: impl Fn([u8; 4]) -> [u8; 4]) -> Self {
        let pixels = self.pixels.iter().map(|&pixel| change(pixel)).collect();
        Self { pixels, pyramids: Pyramids::default(), ..*self }
    }

    /// Marks the image as a mask with this cutoff: seen from afar, drawn texels alone set its color, all with the same weight.
    fn masked(self, cutoff: f32) -> Self {
        let code = (cutoff * 255.0).ceil().clamp(0.0, 255.0) as u8;
        if self.whole_from == Some(code) {
            return self;
        }
        // The color weights of texels change; their alpha does not.
        let pyramids = Pyramids { colors: Arc::default(), ..self.pyramids };
        Self { whole_from: Some(code), pyramids, ..self }
    }

    /// Returns the weight, in [0, 1], of a texel with this alpha in a filtered color.
    pub(super) fn weight(&self, alpha: u8) -> f32 {
        match self.whole_from {
            Some(least) if alpha >= least => 1.0,
            // So small that it matters only without heavier texels: between texels a mask may be drawn where no texel reaches the cutoff.
            Some(_) => f32::from(alpha) / 255.0 / 64.0,
            None => f32::from(alpha) / 255.0,
        }
    }

    fn opaque(self) -> Self {
        if self.pixels.iter().all(|p| p[3] == 255) { self } else { self.mapped(|[r, g, b, _]| [r, g, b, 255]) }
    }

    /// Returns the color pyramid's level for points `footprint` texels apart; `None` means the image itself.
    pub(super) fn pyramid(&self, encoding: Encoding, footprint: f32) -> Option<&PyramidLevel<Texel>> {
        if pyramid::is_near(footprint) {
            return None;
        }
        let colors = &self.pyramids.colors[encoding as usize];
        colors.get_or_init(|| pyramid::of_colors(self, encoding)).level(footprint)
    }

    /// Returns a level that holds the greatest alpha around each place: all texels within half of `length` texels count.
    pub(super) fn greatest_alpha(&self, length: f32) -> Option<&PyramidLevel<u8>> {
        self.pyramids.greatest_alpha.get_or_init(|| pyramid::of_greatest_alpha(self)).wider_than(length)
    }
}

/// Surface properties of triangles: color, alpha, sides, and optional images.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name, for reports.
    pub name: String,
    /// Linear RGBA that multiplies the image.
    pub base_color: Vec4,
    /// Base color and alpha; repeats outside [0, 1].
    pub image: Option<Image>,
    /// Meaning of alpha.
    pub alpha_mode: AlphaMode,
    /// Whether both sides are drawn. If not, only the side with counter-clockwise winding is.
    pub double_sided: bool,
    /// Tangent-space normal map with the UVs of `image`, as in glTF: red to the right, green up, linear codes.
    pub normal: Option<Image>,
    /// Roughness in [0, 1].
    pub roughness: f32,
    /// Metallic in [0, 1].
    pub metallic: f32,
    /// Occlusion, roughness and metallic in red, green and blue; multiplies the factors. UVs of `image`, linear codes.
    pub orm: Option<Image>,
    /// Linear color of transmitted light; black without translucency.
    pub translucency: Vec3,
    /// Multiplies `translucency`; UVs of `image`.
    pub translucency_image: Option<Image>,
    /// For billboards: UVs into the leaf's texture for each texel, coded as in `textures`. UVs of `image`.
    pub leaf_uv: Option<Image>,
    /// For billboards: the leaf that each texel shows, coded as in `textures`. UVs of `image`.
    pub leaf_id: Option<Image>,
}

impl Default for Material {
    /// Returns a white, opaque, double-sided, rough material.
    fn default() -> Self {
        Self {
            name: "leaf".to_owned(),
            base_color: Vec4::ONE,
            image: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: true,
            normal: None,
            roughness: 1.0,
            metallic: 0.0,
            orm: None,
            translucency: Vec3::ZERO,
            translucency_image: None,
            leaf_uv: None,
            leaf_id: None,
        }
    }
}

impl Material {
    /// Sets alpha to full wherever it has no meaning: in all images but the base color, and there in opaque mode. So it weights nothing.
    pub(super) fn settled(mut self) -> Self {
        for image in [&mut self.normal, &mut self.orm, &mut self.translucency_image] {
            *image = image.take().map(Image::opaque);
        }
        self.image = match self.alpha_mode {
            AlphaMode::Opaque => self.image.map(Image::opaque),
            AlphaMode::Mask(cutoff) => self.image.map(|image| image.masked(cutoff / self.base_color.w)),
            AlphaMode::Blend => self.image,
        };
        self
    }

    /// Returns the pyramid of the drawn share of each texel; `None` without an image.
    pub(super) fn coverage(&self) -> Option<Pyramid<u8>> {
        self.image.as_ref().map(|image| pyramid::of_coverage(image, self.alpha_mode, self.base_color.w))
    }

    /// Checks the factors and the cutoff.
    ///
    /// # Errors
    /// A factor or a cutoff outside [0, 1]; NaN is outside.
    pub fn check(&self) -> Result<()> {
        let within = |x: f32| (0.0..=1.0).contains(&x);
        if !self.base_color.to_array().into_iter().all(within) {
            return Err(Error::invalid(format!(
                "material {:?} has the base color {:?}; each part must lie in [0, 1]",
                self.name,
                self.base_color.to_array()
            )));
        }
        let shares = [("roughness", self.roughness), ("metallic", self.metallic)];
        let translucency = self.translucency.to_array().map(|part| ("translucency", part));
        if let Some((what, share)) = shares.into_iter().chain(translucency).find(|(_, share)| !within(*share)) {
            return Err(Error::invalid(format!(
                "material {:?} has the {what} {}; it must lie in [0, 1]",
                self.name,
                number(f64::from(share))
            )));
        }
        match self.alpha_mode {
            AlphaMode::Mask(cutoff) if !within(cutoff) => Err(Error::invalid(format!(
                "material {:?} has the alpha cutoff {}; it must lie in [0, 1]",
                self.name,
                number(f64::from(cutoff))
            ))),
            _ => Ok(()),
        }
    }
}
