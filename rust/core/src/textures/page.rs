//! The images of a level's atlas page, and the choice of its channels.

use glam::{Vec3, Vec4};

use super::channels::Channel;
use super::sky::Sky;
use super::{mips, tone};
use crate::color::quantise;
use crate::error::Result;
use crate::foliage::{AlphaMode, Image, Material};
use crate::limits;

/// Channels of an atlas page beside base color and alpha.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(clippy::struct_excessive_bools)] // The flags are independent.
pub struct Channels {
    /// Normals, bent toward the hull of the crown by a share in [0, 1].
    pub normal: Option<f32>,
    /// Roughness and metallic, with occlusion (ORM).
    pub orm: bool,
    /// Translucency, the color of transmitted light.
    pub translucency: bool,
    /// Visible share of the sky, as the occlusion in ORM.
    pub occlusion: bool,
    /// Bent-normal occlusion: the direction of the visible sky, for self-shadowing. It is added to the occlusion.
    pub bent_normal: bool,
    /// Label textures: the leaf of each texel, and its texture coordinates there.
    pub leaf_map: bool,
}

impl Channels {
    /// Checks the settings.
    ///
    /// # Errors
    /// Normals bent by a share outside [0, 1].
    pub fn check(&self) -> Result<()> {
        match self.normal {
            Some(bend) => limits::NORMALS.check("normals", f64::from(bend)),
            None => Ok(()),
        }
    }

    /// Returns the channels together with those that they depend on.
    #[must_use]
    pub fn completed(self) -> Self {
        Self { occlusion: self.occlusion || self.bent_normal, ..self }
    }

    /// Returns the channels for baking from billboards: their normals are bent already, and their ORM is occluded already.
    #[must_use]
    pub fn of_billboards(self) -> Self {
        Self { normal: self.normal.map(|_| 0.0), orm: self.orm || self.occlusion, occlusion: false, ..self }
    }

    /// Returns whether any channel depends on the sky.
    #[must_use]
    pub fn need_sky(&self) -> bool {
        self.occlusion || self.bent_normal
    }

    /// Returns the list of channels, base color first. Channels that depend on the sky are left out without one.
    pub(super) fn list<'a>(&self, sky: Option<&'a Sky>) -> Vec<Channel<'a>> {
        let occluding = sky.filter(|_| self.occlusion);
        let wanted = [
            self.normal.map(Channel::Normal),
            (self.orm || occluding.is_some()).then_some(Channel::Orm(occluding)),
            self.translucency.then_some(Channel::Translucency),
            sky.filter(|_| self.bent_normal).map(Channel::BentNormal),
            self.leaf_map.then_some(Channel::LeafUv),
            self.leaf_map.then_some(Channel::LeafId),
        ];
        std::iter::once(Channel::BaseColor).chain(wanted.into_iter().flatten()).collect()
    }
}

/// The images of an atlas page, all of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    /// Base color: sRGB with straight alpha; color is filled in under transparent texels.
    pub base_color: Image,
    /// Normals, in the axes of each billboard.
    pub normal: Option<Image>,
    /// Occlusion, roughness, metallic (ORM).
    pub orm: Option<Image>,
    /// Translucency, sRGB.
    pub translucency: Option<Image>,
    /// Bent-normal occlusion, in the axes of each billboard; added to the occlusion.
    pub bent_normal: Option<Image>,
    /// Texture coordinates u and v of the leaf, 12 bits each. Label texture: sample it with nearest filtering.
    pub leaf_uv: Option<Image>,
    /// Index of the leaf and of its material. Label texture, too.
    pub leaf_id: Option<Image>,
}

impl Page {
    pub(super) fn of<'a>(images: impl IntoIterator<Item = (Channel<'a>, Image)>) -> Option<Self> {
        let mut images = images.into_iter();
        let Some((Channel::BaseColor, base_color)) = images.next() else { return None };
        let mut page = Self::of_color(base_color);
        for (channel, image) in images {
            let place = match channel {
                Channel::Normal(_) => &mut page.normal,
                Channel::Orm(_) => &mut page.orm,
                Channel::Translucency => &mut page.translucency,
                Channel::BentNormal(_) => &mut page.bent_normal,
                Channel::LeafUv => &mut page.leaf_uv,
                Channel::LeafId => &mut page.leaf_id,
                Channel::BaseColor => continue,
            };
            *place = Some(image);
        }
        Some(page)
    }

    /// Returns a page of base color alone.
    #[must_use]
    pub fn of_color(base_color: Image) -> Self {
        Self {
            base_color,
            normal: None,
            orm: None,
            translucency: None,
            bent_normal: None,
            leaf_uv: None,
            leaf_id: None,
        }
    }

    /// Returns the images with their names, base color first.
    pub fn images(&self) -> impl Iterator<Item = (&'static str, &Image)> {
        let others = [
            ("normal", &self.normal),
            ("orm", &self.orm),
            ("translucency", &self.translucency),
            ("bent_normal", &self.bent_normal),
            ("leaf_uv", &self.leaf_uv),
            ("leaf_id", &self.leaf_id),
        ];
        let others = others.into_iter().filter_map(|(name, image)| Some((name, image.as_ref()?)));
        std::iter::once(("base_color", &self.base_color)).chain(others)
    }

    /// Returns a page with the same channels, with images made by `image` from their names.
    pub(crate) fn rebuilt(&self, image: impl Fn(&str) -> Image) -> Self {
        let other = |name: &str, own: &Option<Image>| own.as_ref().map(|_| image(name));
        Self {
            base_color: image("base_color"),
            normal: other("normal", &self.normal),
            orm: other("orm", &self.orm),
            translucency: other("translucency", &self.translucency),
            bent_normal: other("bent_normal", &self.bent_normal),
            leaf_uv: other("leaf_uv", &self.leaf_uv),
            leaf_id: other("leaf_id", &self.leaf_id),
        }
    }

    /// Returns the page with colors settled for this cutoff: texels below it give their color to adjacent texels that reach it.
    #[must_use]
    pub fn settled(self, alpha_cutoff: f32) -> Self {
        Self { base_color: tone::gathered(&self.base_color, alpha_cutoff), ..self }
    }

    /// Returns the page as if its content were `times` as thick: transmittance is raised to that power.
    #[must_use]
    pub fn thickened(self, times: f64) -> Self {
        let thicker = |code: usize| quantise(1.0 - libm::pow(1.0 - code as f64 / 255.0, times) as f32);
        let table: [u8; 256] = std::array::from_fn(thicker);
        let alpha = self.base_color.alpha().into_iter().map(|code| table[usize::from(code)]).collect();
        Self { base_color: self.base_color.with_alpha(alpha), ..self }
    }

    /// Returns the page with its linear colors multiplied by `factors`.
    #[must_use]
    pub fn toned(self, factors: Vec3) -> Self {
        Self { base_color: tone::scaled(&self.base_color, factors), ..self }
    }

    /// Returns the mip levels of the image with this name, filtered to suit its content. `None` if the page does not have it, for label
    /// textures, which have no mip levels, and for base color, whose levels depend on the cutoff ([`mips::of_color`]).
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

    /// Returns the material of billboards with this page, cut out at `alpha_cutoff`, or alpha blended if that is 0.
    #[must_use]
    pub fn material(&self, alpha_cutoff: f32, double_sided: bool) -> Material {
        Material {
            name: "billboards".to_owned(),
            base_color: Vec4::ONE,
            image: Some(self.base_color.clone()),
            alpha_mode: if alpha_cutoff > 0.0 { AlphaMode::Mask(alpha_cutoff) } else { AlphaMode::Blend },
            double_sided,
            normal: self.normal.clone(),
            // The image holds the full value.
            metallic: if self.orm.is_some() { 1.0 } else { 0.0 },
            roughness: 1.0,
            orm: self.orm.clone(),
            translucency: if self.translucency.is_some() { Vec3::ONE } else { Vec3::ZERO },
            translucency_image: self.translucency.clone(),
            leaf_uv: self.leaf_uv.clone(),
            leaf_id: self.leaf_id.clone(),
        }
    }
}
