//! The channels of an atlas page or a picture. Each requested channel is a separate shading pass over the visible samples; others cost
//! nothing.

use glam::{DVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::labels;
use super::raster::{Canvas, ScreenTriangle, Seen, Shader};
use super::sky::Sky;
use crate::color::{decode_table, encode, quantise};
use crate::foliage::Image;

/// A channel of an atlas page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Channel<'a> {
    /// Linear base color; as an image, sRGB with straight alpha.
    BaseColor,
    /// Normal of the visible side, in the billboard's axes (red to the right, green up). It is bent by the given share, in [0, 1], toward
    /// the hull of the crown, as usual for foliage shading.
    Normal(f32),
    /// Occlusion, roughness, metallic (ORM). Occlusion is the material's occlusion times the visible share of the sky.
    Orm(Option<&'a Sky>),
    /// Linear color of transmitted light; as an image, sRGB.
    Translucency,
    /// Bent-normal occlusion in the billboard's axes (red to the right, green up), in [−1, 1]: to first order, the visible share of the sky
    /// toward l is occlusion + this · l.
    BentNormal(&'a Sky),
    /// Texture coordinates of the leaf, 12 bits each; see `labels`.
    LeafUv,
    /// Index of the leaf and of its material; see `labels`.
    LeafId,
}

/// Least component of a normal toward the viewer: a billboard cannot show normals that point away.
const LEAST_TOWARD_VIEWER: f32 = 0.02;

impl Channel<'_> {
    /// Returns the name of the channel's image in the page.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::BaseColor => "base_color",
            Self::Normal(_) => "normal",
            Self::Orm(_) => "orm",
            Self::Translucency => "translucency",
            Self::BentNormal(_) => "bent_normal",
            Self::LeafUv => "leaf_uv",
            Self::LeafId => "leaf_id",
        }
    }

    /// Returns whether the channel holds labels. They cannot be averaged, so a texel takes those of the triangle with the most samples.
    pub(super) fn is_label(self) -> bool {
        matches!(self, Self::LeafUv | Self::LeafId)
    }

    /// Returns the canvas as an image with straight alpha; channels other than base color and alpha are opaque.
    ///
    /// # Panics
    /// Never: a canvas has width × height pixels.
    #[must_use]
    pub fn to_image(self, canvas: &Canvas) -> Image {
        let code = |p: &Vec4| {
            let value = if p.w > 0.0 { p.truncate() / p.w } else { p.truncate() };
            match self {
                Self::BaseColor => [encode(value.x), encode(value.y), encode(value.z), quantise(p.w)],
                Self::Normal(_) => shares(value.try_normalize().unwrap_or(Vec3::Z) * 0.5 + 0.5),
                Self::BentNormal(_) => shares(value * 0.5 + 0.5),
                Self::Orm(_) | Self::LeafUv | Self::LeafId => shares(value),
                Self::Translucency => [encode(value.x), encode(value.y), encode(value.z), 255],
            }
        };
        let pixels: Vec<[u8; 4]> = canvas.pixels.par_iter().map(code).collect();
        Image::new(canvas.width, canvas.height, pixels).expect("a canvas has width × height pixels")
    }
}

impl Shader for Channel<'_> {
    fn shade(&self, seen: &Seen) -> Vec3 {
        match *self {
            Self::BaseColor => seen.surface.base_color(seen.spot, seen.front),
            Self::Normal(bend) => normal(seen, bend),
            Self::Orm(sky) => {
                let orm = seen.surface.orm(seen.spot);
                sky.map_or(orm, |sky| orm.with_x(orm.x * sky.from(seen.place()).share))
            }
            Self::Translucency => seen.surface.translucency(seen.spot),
            Self::BentNormal(sky) => seen.triangle.window.view * sky.from(seen.place()).toward,
            Self::LeafUv => labels::leaf_uv(seen),
            Self::LeafId => labels::leaf_id(seen),
        }
    }

    fn averages(&self) -> bool {
        !self.is_label()
    }
}

/// Returns linear codes.
fn shares(value: Vec3) -> [u8; 4] {
    [quantise(value.x), quantise(value.y), quantise(value.z), 255]
}

impl Seen<'_> {
    /// Returns the point's original position, in the caller's coordinates.
    pub(crate) fn place(&self) -> DVec3 {
        let ScreenTriangle { foliage, triangle, .. } = self.triangle;
        let [a, b, c] = foliage.corners(*triangle as usize);
        let [u, v, w] = self.spot.weights.as_dvec3().to_array();
        foliage.frame().to_caller(a * u + b * v + c * w)
    }

    /// Returns the unit normal of the visible side, in the foliage's axes; `None` for a triangle without area.
    pub(crate) fn normal(&self) -> Option<Vec3> {
        let ScreenTriangle { foliage, triangle, .. } = self.triangle;
        let own = self.surface.normal(self.spot, &foliage.corners(*triangle as usize).map(DVec3::as_vec3))?;
        Some(if self.front { own } else { -own })
    }
}

impl Canvas {
    /// Returns the base colors of an image: linear light, premultiplied. The inverse of [`Channel::to_image`].
    pub(super) fn of_color(image: &Image) -> Self {
        let table = decode_table();
        let premultiplied = image.pixels().par_iter().map(|&[r, g, b, a]| {
            let share = f32::from(a) / 255.0;
            (Vec3::from_array([r, g, b].map(|code| table[code as usize])) * share).extend(share)
        });
        Self { width: image.width(), height: image.height(), pixels: premultiplied.collect() }
    }
}

fn normal(seen: &Seen, bend: f32) -> Vec3 {
    let triangle = seen.triangle;
    let Some(facing) = seen.normal() else { return Vec3::Z };
    let bent = if bend > 0.0 {
        let corners = triangle.foliage.corners(triangle.triangle as usize).map(DVec3::as_vec3);
        let place =
            corners[0] * seen.spot.weights.x + corners[1] * seen.spot.weights.y + corners[2] * seen.spot.weights.z;
        // A side that faces into the crown is bent inward; otherwise its normal would turn through the leaf.
        let outward = place.normalize_or(facing);
        facing.lerp(if facing.dot(outward) < 0.0 { -outward } else { outward }, bend)
    } else {
        facing
    };
    let shown = triangle.window.view * bent;
    shown.with_z(shown.z.max(LEAST_TOWARD_VIEWER)).normalize()
}
