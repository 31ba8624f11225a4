//! The images of a level, and which of them there are to be.

use glam::{Vec3, Vec4};

use super::channels::Channel;
use super::tone;
use crate::error::{Error, Result};
use crate::foliage::{AlphaMode, Image, Material};

/// Which channels a page has beside base colour and alpha.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Channels {
    /// Normals, bent toward the hull of the crown by a share in [0, 1].
    pub normal: Option<f32>,
    /// Occlusion, roughness and metallic.
    pub gloss: bool,
    /// The light that shines through.
    pub translucency: bool,
}

impl Channels {
    /// # Errors
    /// Normals bent by a share outside [0, 1].
    pub fn check(&self) -> Result<()> {
        match self.normal {
            Some(bend) if !(0.0..=1.0).contains(&bend) => {
                Err(Error::invalid(format!("normals are bent by {bend:?}; the share must lie in [0, 1]")))
            }
            _ => Ok(()),
        }
    }

    /// The same without bending: what is drawn is bent already.
    #[must_use]
    pub fn unbent(self) -> Self {
        Self { normal: self.normal.map(|_| 0.0), ..self }
    }

    /// Base colour first.
    pub(super) fn list(&self) -> Vec<Channel> {
        let wanted = [
            self.normal.map(Channel::Normal),
            self.gloss.then_some(Channel::Gloss),
            self.translucency.then_some(Channel::Translucency),
        ];
        std::iter::once(Channel::BaseColor).chain(wanted.into_iter().flatten()).collect()
    }
}

/// The images of a level, all of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    /// sRGB with straight alpha; colour is filled in under transparent texels.
    pub base_color: Image,
    /// In the axes of each billboard.
    pub normal: Option<Image>,
    /// Occlusion, roughness, metallic.
    pub gloss: Option<Image>,
    /// sRGB.
    pub translucency: Option<Image>,
}

impl Page {
    pub(super) fn of(images: impl IntoIterator<Item = (Channel, Image)>) -> Option<Self> {
        let (mut base_color, mut normal, mut gloss, mut translucency) = (None, None, None, None);
        for (channel, image) in images {
            let place = match channel {
                Channel::BaseColor => &mut base_color,
                Channel::Normal(_) => &mut normal,
                Channel::Gloss => &mut gloss,
                Channel::Translucency => &mut translucency,
            };
            *place = Some(image);
        }
        Some(Self { base_color: base_color?, normal, gloss, translucency })
    }

    /// The images with their names, base colour first.
    pub fn images(&self) -> impl Iterator<Item = (&'static str, &Image)> {
        let others = [("normal", &self.normal), ("gloss", &self.gloss), ("translucency", &self.translucency)];
        let others = others.into_iter().filter_map(|(name, image)| Some((name, image.as_ref()?)));
        std::iter::once(("base_color", &self.base_color)).chain(others)
    }

    /// The page as it is drawn with this cutoff: what fails gives its colour to what passes beside it.
    #[must_use]
    pub fn settled(self, alpha_cutoff: f32) -> Self {
        Self { base_color: tone::gathered(&self.base_color, alpha_cutoff), ..self }
    }

    /// The page with its linear colours multiplied.
    #[must_use]
    pub fn toned(self, factors: Vec3) -> Self {
        Self { base_color: tone::scaled(&self.base_color, factors), ..self }
    }

    /// The material of billboards that show the page, cut out at `alpha_cutoff`.
    #[must_use]
    pub fn material(&self, alpha_cutoff: f32, double_sided: bool) -> Material {
        Material {
            name: "billboards".to_owned(),
            base_color: Vec4::ONE,
            image: Some(self.base_color.clone()),
            alpha_mode: AlphaMode::Mask(alpha_cutoff),
            double_sided,
            normal: self.normal.clone(),
            // The image has the whole of it.
            metallic: if self.gloss.is_some() { 1.0 } else { 0.0 },
            roughness: 1.0,
            gloss: self.gloss.clone(),
            translucency: if self.translucency.is_some() { Vec3::ONE } else { Vec3::ZERO },
            translucency_image: self.translucency.clone(),
        }
    }
}
