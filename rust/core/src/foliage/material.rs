//! How a triangle's surface looks: base colour, alpha and sides.

use std::sync::Arc;

use glam::Vec4;

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

/// An sRGB picture with straight alpha; row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    width: usize,
    height: usize,
    pixels: Arc<[[u8; 4]]>,
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
        Ok(Self { width, height, pixels })
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
}

impl Default for Material {
    /// White, opaque, double-sided.
    fn default() -> Self {
        Self {
            name: "leaf".to_owned(),
            base_color: Vec4::ONE,
            image: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: true,
        }
    }
}

impl Material {
    /// Checks the factor and the cutoff.
    ///
    /// # Errors
    /// A base colour outside [0, 1] or a cutoff outside [0, 1]; NaN is outside.
    pub fn check(&self) -> Result<()> {
        let within = |x: f32| (0.0..=1.0).contains(&x);
        if !self.base_color.to_array().into_iter().all(within) {
            return Err(Error::invalid(format!(
                "material {:?} has the base colour {:?}; each part must lie in [0, 1]",
                self.name,
                self.base_color.to_array()
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
