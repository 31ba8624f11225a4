//! How a triangle's surface looks: base colour, alpha and sides.

use std::sync::{Arc, OnceLock};

use glam::{Vec3, Vec4};

use super::pyramid::{self, Encoding, Pyramid, Texel};

use crate::error::{Error, Result, number};

/// What alpha means, as in glTF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Drawn where alpha ≥ the cutoff.
    Mask(f32),
    /// Alpha is coverage.
    Blend,
}

/// A picture with straight alpha, sRGB where it shows colours; row 0 on top.
#[derive(Clone, Debug)]
pub struct Image {
    width: usize,
    height: usize,
    pixels: Arc<[[u8; 4]]>,
    /// The least code of alpha that is drawn, and then whole.
    whole_from: Option<u8>,
    pyramids: Pyramids,
}

/// Each made when it is first asked for; on one thread, for whoever waits for it may be a worker whose help it would need.
#[derive(Clone, Debug, Default)]
struct Pyramids {
    /// As sRGB and as linear codes.
    colors: Arc<[OnceLock<Pyramid<Texel>>; 2]>,
    greatest_alpha: Arc<OnceLock<Pyramid<u8>>>,
}

impl PartialEq for Image {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.height, &self.pixels) == (other.width, other.height, &other.pixels)
    }
}

impl Image {
    /// A picture of `width` × `height` pixels.
    ///
    /// # Errors
    /// A side of 0, or another number of pixels.
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

    /// Pixels in a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row from the top.
    #[must_use]
    pub fn pixels(&self) -> &[[u8; 4]] {
        &self.pixels
    }

    /// The alpha of all pixels.
    pub(crate) fn alpha(&self) -> Vec<u8> {
        self.pixels.iter().map(|pixel| pixel[3]).collect()
    }

    /// The picture with another alpha, one for each pixel.
    pub(crate) fn with_alpha(self, alpha: Vec<u8>) -> Self {
        let pixels = self.pixels.iter().zip(alpha).map(|(&[r, g, b, _], a)| [r, g, b, a]).collect();
        Self { pixels, pyramids: Pyramids::default(), ..self }
    }

    /// The picture with every pixel changed.
    #[must_use]
    pub fn mapped(&self, change: impl Fn([u8; 4]) -> [u8; 4]) -> Self {
        let pixels = self.pixels.iter().map(|&pixel| change(pixel)).collect();
        Self { pixels, pyramids: Pyramids::default(), ..*self }
    }

    /// The same, of which a mask draws what has at least this alpha: from far, no more and no less than that colours it.
    fn masked(self, cutoff: f32) -> Self {
        let code = (cutoff * 255.0).ceil().clamp(0.0, 255.0) as u8;
        if self.whole_from == Some(code) {
            return self;
        }
        // What a texel counts changes, its alpha does not.
        let pyramids = Pyramids { colors: Arc::default(), ..self.pyramids };
        Self { whole_from: Some(code), pyramids, ..self }
    }

    /// What a texel of this alpha counts in the colour of a place that is seen from far, in [0, 1].
    pub(super) fn weight(&self, alpha: u8) -> f32 {
        match self.whole_from {
            Some(least) if alpha >= least => 1.0,
            // So little that it colours only what has nothing else: between texels a mask may draw where none of them is drawn.
            Some(_) => f32::from(alpha) / 255.0 / 64.0,
            None => f32::from(alpha) / 255.0,
        }
    }

    fn opaque(self) -> Self {
        if self.pixels.iter().all(|p| p[3] == 255) { self } else { self.mapped(|[r, g, b, _]| [r, g, b, 255]) }
    }

    /// The level of its pyramid for points `footprint` texels apart; `None` is the image itself.
    pub(super) fn pyramid(&self, encoding: Encoding, footprint: f32) -> Option<&pyramid::Level<Texel>> {
        if pyramid::is_near(footprint) {
            return None;
        }
        let colors = &self.pyramids.colors[encoding as usize];
        colors.get_or_init(|| pyramid::of_colors(self, encoding)).level(footprint)
    }

    /// The greatest alpha near places of which none lies farther than half of `length` texels from where it is looked up.
    pub(super) fn greatest_alpha(&self, length: f32) -> Option<&pyramid::Level<u8>> {
        self.pyramids.greatest_alpha.get_or_init(|| pyramid::of_greatest_alpha(self)).wider_than(length)
    }
}

/// Base colour, alpha and sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// For reports.
    pub name: String,
    /// Linear RGBA that multiplies the image.
    pub base_color: Vec4,
    /// Repeats outside [0, 1].
    pub image: Option<Image>,
    /// What alpha means.
    pub alpha_mode: AlphaMode,
    /// Otherwise only the side from which triangles wind counter-clockwise is drawn.
    pub double_sided: bool,
    /// A tangent-space normal map laid like `image`, as in glTF: red to the right, green up, codes linear.
    pub normal: Option<Image>,
    /// In [0, 1].
    pub roughness: f32,
    /// In [0, 1].
    pub metallic: f32,
    /// Occlusion, roughness and metallic in red, green and blue that multiply the factors, laid like `image`, codes linear.
    pub gloss: Option<Image>,
    /// Linear colour of the light that shines through; black where none does.
    pub translucency: Vec3,
    /// Multiplies it, laid like `image`.
    pub translucency_image: Option<Image>,
    /// Of billboards: which part of which leaf's texture each texel shows, and which leaf; as `textures` codes them. Laid like `image`.
    pub leaf_uv: Option<Image>,
    /// Which leaf.
    pub leaf_id: Option<Image>,
}

impl Default for Material {
    /// White, opaque, double-sided, rough.
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
            gloss: None,
            translucency: Vec3::ZERO,
            translucency_image: None,
            leaf_uv: None,
            leaf_id: None,
        }
    }
}

impl Material {
    /// Alpha counts in the base colour alone, and there only when the mode says so: elsewhere it is made full, so that nothing is weighted by it.
    pub(super) fn settled(mut self) -> Self {
        for image in [&mut self.normal, &mut self.gloss, &mut self.translucency_image] {
            *image = image.take().map(Image::opaque);
        }
        self.image = match self.alpha_mode {
            AlphaMode::Opaque => self.image.map(Image::opaque),
            AlphaMode::Mask(cutoff) => self.image.map(|image| image.masked(cutoff / self.base_color.w)),
            AlphaMode::Blend => self.image,
        };
        self
    }

    /// The share of its texels that is drawn; `None` without an image.
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
                "material {:?} has the base colour {:?}; each part must lie in [0, 1]",
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
