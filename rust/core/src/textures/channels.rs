//! What a page or a picture can show of a surface, channel by channel. Each channel that is asked for is a pass of its own over what is seen;
//! one that is not asked for costs nothing.

use glam::{DVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::labels;
use super::raster::{Canvas, ScreenTriangle};
use super::sky::Sky;
use crate::color::{decode_table, encode, quantise};
use crate::foliage::{Image, Spot, Surface};

/// A channel of a page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Channel<'a> {
    /// Linear base colour; as an image sRGB, with straight alpha.
    BaseColor,
    /// The normal on the side that faces the viewer, in the billboard's axes (red to the right, green up), bent by the given share, in
    /// [0, 1], toward the hull of the crown, as foliage is shaded.
    Normal(f32),
    /// Occlusion, roughness, metallic; occlusion is what the material says times the share of the sky that is seen.
    Gloss(Option<&'a Sky>),
    /// The linear colour of the light that shines through; as an image sRGB.
    Translucency,
    /// Where the sky is seen, in the billboard's axes (red to the right, green up): to first order the share toward l is occlusion + this · l. In [−1, 1].
    Visibility(&'a Sky),
    /// Where in its texture a leaf is seen, of 12 bits; see `labels`.
    LeafUv,
    /// Which leaf of which material is seen.
    LeafId,
    /// Alpha alone; as an image on black. For who asks no more, nothing is looked up.
    Alpha,
    /// How near to the viewer, in the units of the screen triangle; no image shows it.
    Depth,
}

/// A point of a triangle that is seen.
pub struct Seen<'a> {
    /// Of its triangle.
    pub surface: &'a Surface<'a>,
    /// As it is drawn.
    pub triangle: &'a ScreenTriangle<'a>,
    /// Where, and how much of it.
    pub spot: Spot,
    /// Whether the side is seen from which the triangle winds counter-clockwise.
    pub front: bool,
}

/// Normals lean at most so far from the viewer, as the part along the view: a billboard can show none that point away.
const LEAST_TOWARD_VIEWER: f32 = 0.02;

impl Channel<'_> {
    /// As the page calls its image.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::BaseColor => "base_color",
            Self::Normal(_) => "normal",
            Self::Gloss(_) => "gloss",
            Self::Translucency => "translucency",
            Self::Visibility(_) => "visibility",
            Self::LeafUv => "leaf_uv",
            Self::LeafId => "leaf_id",
            Self::Alpha => "alpha",
            Self::Depth => "depth",
        }
    }

    /// What it shows of a point.
    pub(super) fn look(self, seen: &Seen) -> Vec3 {
        match self {
            Self::BaseColor => seen.surface.base_color(seen.spot, seen.front),
            Self::Normal(bend) => normal(seen, bend),
            Self::Gloss(sky) => {
                let gloss = seen.surface.gloss(seen.spot);
                sky.map_or(gloss, |sky| gloss.with_x(gloss.x * sky.from(seen.place()).share))
            }
            Self::Translucency => seen.surface.translucency(seen.spot),
            Self::Visibility(sky) => seen.triangle.window.view * sky.from(seen.place()).toward,
            Self::LeafUv => labels::leaf_uv(seen),
            Self::LeafId => labels::leaf_id(seen),
            Self::Alpha => Vec3::ZERO,
            Self::Depth => Vec3::splat(seen.spot.weights.dot(Vec3::from_array(seen.triangle.corners.map(|c| c.z)))),
        }
    }

    /// Whether it has no means: then the triangle counts that most samples see.
    pub(super) fn is_label(self) -> bool {
        matches!(self, Self::LeafUv | Self::LeafId)
    }

    /// The canvas as codes, straight; base colour with its alpha, the others opaque.
    ///
    /// # Panics
    /// Never: a canvas has as many pixels as it says.
    #[must_use]
    pub fn to_image(self, canvas: &Canvas) -> Image {
        let code = |p: &Vec4| {
            let value = if p.w > 0.0 { p.truncate() / p.w } else { p.truncate() };
            match self {
                Self::BaseColor => [encode(value.x), encode(value.y), encode(value.z), quantise(p.w)],
                Self::Alpha => [0, 0, 0, quantise(p.w)],
                Self::Normal(_) => shares(value.try_normalize().unwrap_or(Vec3::Z) * 0.5 + 0.5),
                Self::Visibility(_) => shares(value * 0.5 + 0.5),
                Self::Gloss(_) | Self::LeafUv | Self::LeafId | Self::Depth => shares(value),
                Self::Translucency => [encode(value.x), encode(value.y), encode(value.z), 255],
            }
        };
        let pixels: Vec<[u8; 4]> = canvas.pixels.par_iter().map(code).collect();
        Image::new(canvas.width, canvas.height, pixels).expect("a canvas is whole")
    }
}

/// Linear codes.
fn shares(value: Vec3) -> [u8; 4] {
    [quantise(value.x), quantise(value.y), quantise(value.z), 255]
}

impl Seen<'_> {
    /// Where it really is, in the caller's coordinates.
    fn place(&self) -> DVec3 {
        let ScreenTriangle { foliage, triangle, .. } = self.triangle;
        let [a, b, c] = foliage.corners(*triangle as usize);
        let [u, v, w] = self.spot.weights.as_dvec3().to_array();
        foliage.frame().to_caller(a * u + b * v + c * w)
    }
}

impl Canvas {
    /// The base colours of an image: linear light, premultiplied. The inverse of [`Channel::to_image`].
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
    let corners = triangle.foliage.corners(triangle.triangle as usize).map(glam::DVec3::as_vec3);
    let Some(own) = seen.surface.normal(seen.spot, &corners) else { return Vec3::Z };
    let facing = if seen.front { own } else { -own };
    let bent = if bend > 0.0 {
        let place =
            corners[0] * seen.spot.weights.x + corners[1] * seen.spot.weights.y + corners[2] * seen.spot.weights.z;
        // A side that faces into the crown is bent the other way: else its normal would be turned through the leaf.
        let outward = place.normalize_or(facing);
        facing.lerp(if facing.dot(outward) < 0.0 { -outward } else { outward }, bend)
    } else {
        facing
    };
    let shown = triangle.window.view * bent;
    shown.with_z(shown.z.max(LEAST_TOWARD_VIEWER)).normalize()
}
