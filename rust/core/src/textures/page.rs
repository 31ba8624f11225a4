//! The images of a level, and which of them there are to be.

use glam::{Vec3, Vec4};

use super::channels::Channel;
use super::sky::Sky;
use super::{mips, tone};
use crate::color::quantise;
use crate::error::{Error, Result};
use crate::foliage::{AlphaMode, Image, Material};

/// Which channels a page has beside base colour and alpha.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(clippy::struct_excessive_bools)] // Each is there or not, whatever the others.
pub struct Channels {
    /// Normals, bent toward the hull of the crown by a share in [0, 1].
    pub normal: Option<f32>,
    /// Occlusion, roughness and metallic.
    pub gloss: bool,
    /// The light that shines through.
    pub translucency: bool,
    /// How much of the sky is seen, as occlusion beside roughness and metallic.
    pub occlusion: bool,
    /// Where it is seen, so that a cloud shades itself; the share that this is added to is the occlusion.
    pub visibility: bool,
    /// Which leaf is seen, and where in its texture.
    pub leaf_map: bool,
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

    /// With what the others rest upon.
    #[must_use]
    pub fn completed(self) -> Self {
        Self { occlusion: self.occlusion || self.visibility, ..self }
    }

    /// What it takes of them where what is drawn shows them already: it is bent, and occluded.
    #[must_use]
    pub fn of_billboards(self) -> Self {
        Self { normal: self.normal.map(|_| 0.0), gloss: self.gloss || self.occlusion, occlusion: false, ..self }
    }

    /// Whether any of them depends on the sky.
    #[must_use]
    pub fn need_sky(&self) -> bool {
        self.occlusion || self.visibility
    }

    /// Base colour first; what depends on the sky is there when there is one.
    pub(super) fn list<'a>(&self, sky: Option<&'a Sky>) -> Vec<Channel<'a>> {
        let occluding = sky.filter(|_| self.occlusion);
        let wanted = [
            self.normal.map(Channel::Normal),
            (self.gloss || occluding.is_some()).then_some(Channel::Gloss(occluding)),
            self.translucency.then_some(Channel::Translucency),
            sky.filter(|_| self.visibility).map(Channel::Visibility),
            self.leaf_map.then_some(Channel::LeafUv),
            self.leaf_map.then_some(Channel::LeafId),
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
    /// Where the sky is seen, in the axes of each billboard; to be added to the occlusion.
    pub visibility: Option<Image>,
    /// Where in its texture a leaf is seen: u and v, of 12 bits; labels, of which only the nearest counts.
    pub leaf_uv: Option<Image>,
    /// Which leaf of which material.
    pub leaf_id: Option<Image>,
}

impl Page {
    pub(super) fn of<'a>(images: impl IntoIterator<Item = (Channel<'a>, Image)>) -> Option<Self> {
        let mut images = images.into_iter();
        let Some((Channel::BaseColor, base_color)) = images.next() else { return None };
        let mut page = Self {
            base_color,
            normal: None,
            gloss: None,
            translucency: None,
            visibility: None,
            leaf_uv: None,
            leaf_id: None,
        };
        for (channel, image) in images {
            let place = match channel {
                Channel::Normal(_) => &mut page.normal,
                Channel::Gloss(_) => &mut page.gloss,
                Channel::Translucency => &mut page.translucency,
                Channel::Visibility(_) => &mut page.visibility,
                Channel::LeafUv => &mut page.leaf_uv,
                Channel::LeafId => &mut page.leaf_id,
                Channel::BaseColor | Channel::Alpha | Channel::Depth => continue,
            };
            *place = Some(image);
        }
        Some(page)
    }

    /// The images with their names, base colour first.
    pub fn images(&self) -> impl Iterator<Item = (&'static str, &Image)> {
        let others = [
            ("normal", &self.normal),
            ("gloss", &self.gloss),
            ("translucency", &self.translucency),
            ("visibility", &self.visibility),
            ("leaf_uv", &self.leaf_uv),
            ("leaf_id", &self.leaf_id),
        ];
        let others = others.into_iter().filter_map(|(name, image)| Some((name, image.as_ref()?)));
        std::iter::once(("base_color", &self.base_color)).chain(others)
    }

    /// Another page of the same channels, each made by its name.
    pub(crate) fn rebuilt(&self, image: impl Fn(&str) -> Image) -> Self {
        let other = |name: &str, own: &Option<Image>| own.as_ref().map(|_| image(name));
        Self {
            base_color: image("base_color"),
            normal: other("normal", &self.normal),
            gloss: other("gloss", &self.gloss),
            translucency: other("translucency", &self.translucency),
            visibility: other("visibility", &self.visibility),
            leaf_uv: other("leaf_uv", &self.leaf_uv),
            leaf_id: other("leaf_id", &self.leaf_id),
        }
    }

    /// The page as it is drawn with this cutoff: what fails gives its colour to what passes beside it.
    #[must_use]
    pub fn settled(self, alpha_cutoff: f32) -> Self {
        Self { base_color: tone::gathered(&self.base_color, alpha_cutoff), ..self }
    }

    /// The page as if what it shows were so many times as thick: light that passes it is to that power.
    #[must_use]
    pub fn thickened(self, times: f64) -> Self {
        let thicker = |code: usize| quantise(1.0 - libm::pow(1.0 - code as f64 / 255.0, times) as f32);
        let table: [u8; 256] = std::array::from_fn(thicker);
        let alpha = self.base_color.alpha().into_iter().map(|code| table[usize::from(code)]).collect();
        Self { base_color: self.base_color.with_alpha(alpha), ..self }
    }

    /// The page with its linear colours multiplied.
    #[must_use]
    pub fn toned(self, factors: Vec3) -> Self {
        Self { base_color: tone::scaled(&self.base_color, factors), ..self }
    }

    /// The mip levels of the image with this name, which suit what it shows. `None` without it; for labels, which have none; and for base
    /// colour, whose levels depend on how it is drawn ([`mips::of_color`]).
    #[must_use]
    pub fn levels(&self, name: &str) -> Option<mips::Levels> {
        let (name, image) = self.images().find(|(known, _)| *known == name)?;
        match name {
            "base_color" | "leaf_uv" | "leaf_id" => None,
            "normal" => Some(mips::of_normals(image)),
            "translucency" => Some(mips::means(image)),
            _ => Some(mips::of_shares(image)),
        }
    }

    /// The material of billboards that show the page, cut out at `alpha_cutoff`, or blended where that is 0.
    #[must_use]
    pub fn material(&self, alpha_cutoff: f32, double_sided: bool) -> Material {
        Material {
            name: "billboards".to_owned(),
            base_color: Vec4::ONE,
            image: Some(self.base_color.clone()),
            alpha_mode: if alpha_cutoff > 0.0 { AlphaMode::Mask(alpha_cutoff) } else { AlphaMode::Blend },
            double_sided,
            normal: self.normal.clone(),
            // The image has the whole of it.
            metallic: if self.gloss.is_some() { 1.0 } else { 0.0 },
            roughness: 1.0,
            gloss: self.gloss.clone(),
            translucency: if self.translucency.is_some() { Vec3::ONE } else { Vec3::ZERO },
            translucency_image: self.translucency.clone(),
            leaf_uv: self.leaf_uv.clone(),
            leaf_id: self.leaf_id.clone(),
        }
    }
}
