//! Surface of a triangle at a point: the alpha test and the value of each channel.
//!
//! Textures are filtered over the spacing of the points: bilinearly up to about a texel, from the nearest pyramid level beyond. From afar,
//! an alpha mask is the share of texels above the cutoff. Unfiltered lookups sample textures like renderers do for nearby leaves.

use glam::{Vec2, Vec3, Vec4};

use super::pyramid::{self, Encoding, PyramidLevel, Texel};
use super::{AlphaMode, Foliage, Image, Material};

/// A triangle's surface, prepared for samples at a fixed spacing.
pub struct Surface<'a> {
    material: &'a Material,
    uvs: [Vec2; 3],
    colors: Option<[Vec4; 3]>,
    back_colors: Option<[Vec3; 3]>,
    normals: Option<[Vec3; 3]>,
    /// UV step between neighboring points of a row.
    across: Vec2,
    /// UV area of a sample; `None` for unfiltered lookups.
    sample: Option<f32>,
    alpha: Alpha<'a>,
    near: Option<Near<'a>>,
}

/// A sample position on a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Barycentric weights.
    pub weights: Vec3,
    /// Number of samples around this middle that are filtered as one area.
    pub samples: f32,
}

/// Points along the side of a block, and in a run within a row; blocks and runs are tested together.
pub const BLOCK: usize = 8;

/// Early rejection: if the greatest alpha around the middle of a block or run is below `least`, none of its points is drawn.
#[derive(Clone, Copy)]
struct Near<'a> {
    least: f32,
    of_block: &'a PyramidLevel<u8>,
    of_run: &'a PyramidLevel<u8>,
}

/// Alpha test. Shares are compared with a threshold; thresholds spread evenly over [0, 1) turn them into coverage.
enum Alpha<'a> {
    All,
    /// From the image's own texels: above a cutoff, or as a share.
    Cut(&'a Image, f32),
    Share(&'a Image),
    /// Drawn shares from a pyramid level.
    Level(&'a PyramidLevel<u8>),
    /// Without an image.
    Flat,
}

impl<'a> Surface<'a> {
    /// Prepares a surface for single points.
    pub fn new(foliage: &'a Foliage, triangle: usize) -> Self {
        Self { near: None, ..Self::spread(foliage, triangle, [Vec3::ZERO; 2], 1.0) }
    }

    /// Prepares a surface for points on a grid, where barycentric weights change by `steps` along the two axes. Alpha is tested at each
    /// point; other channels are sampled once for the part of the triangle in a pixel. `filter` is the filter width as a share of the
    /// steps.
    pub fn spread(foliage: &'a Foliage, triangle: usize, steps: [Vec3; 2], filter: f32) -> Self {
        let attributes = foliage.attributes();
        let material = foliage.material(triangle);
        let uvs = attributes.uvs.get(triangle).copied().unwrap_or_default();
        let colors = attributes.colors.get(triangle).copied();
        let back_colors = attributes.back_colors.get(triangle).copied();
        let [across, down] = steps.map(|w| uvs[0] * w.x + uvs[1] * w.y + uvs[2] * w.z);
        let spread = across.perp_dot(down).abs() * filter * filter;
        // Corner alpha moves the edge of a mask, and pyramids ignore corners.
        let even = colors.is_none_or(|colors| colors.iter().all(|c| c.w == 1.0));
        let alpha = match (&material.image, material.alpha_mode) {
            (_, AlphaMode::Opaque) => Alpha::All,
            (None, _) => Alpha::Flat,
            (Some(image), mode) => {
                let footprint = footprint(image, spread);
                let from_far = even && !pyramid::is_near(footprint);
                match (if from_far { foliage.coverage(triangle).level(footprint) } else { None }, mode) {
                    (Some(level), _) => Alpha::Level(level),
                    (None, AlphaMode::Mask(cutoff)) => Alpha::Cut(image, a_hair_less(cutoff)),
                    (None, _) => Alpha::Share(image),
                }
            }
        };
        let near = if even { least_drawn(material) } else { None };
        let near = near.and_then(|(image, least)| {
            let size = Vec2::new(image.width() as f32, image.height() as f32);
            let [across, down] = [across, down].map(|step| (step * size).abs() * BLOCK as f32);
            // A filtered share belongs to a whole texel of its level, up to √2 footprints wide: it reaches that far to either side.
            let reach = 3.0 * footprint(image, spread);
            let greatest = |length: Vec2| image.greatest_alpha(length.max_element() + reach);
            Some(Near { least, of_block: greatest(across + down)?, of_run: greatest(across)? })
        });
        let normals = attributes.normals.get(triangle).copied();
        Self {
            material,
            uvs,
            colors,
            back_colors,
            normals,
            across,
            sample: (filter > 0.0).then_some(spread),
            alpha,
            near,
        }
    }

    /// Returns whether any of at most [`BLOCK`] × [`BLOCK`] points may be drawn, from the barycentric weights of their middle.
    pub fn block_may_pass(&self, middle: Vec3) -> bool {
        self.near.is_none_or(|near| f32::from(nearest(near.of_block, self.uv(middle))) >= near.least)
    }

    /// Returns whether any of at most [`BLOCK`] points in a row may be drawn, from the barycentric weights of their middle.
    pub fn run_may_pass(&self, middle: Vec3) -> bool {
        self.near.is_none_or(|near| f32::from(nearest(near.of_run, self.uv(middle))) >= near.least)
    }

    /// Returns whether the back, with clockwise winding, is drawn, too.
    pub fn double_sided(&self) -> bool {
        self.material.double_sided
    }

    /// Returns whether the point at the barycentric weights is drawn; partial alpha is drawn if its share is above `threshold`.
    pub fn passes(&self, weights: Vec3, threshold: f32) -> bool {
        self.passes_at(self.uv(weights), || weights, || threshold)
    }

    /// Like [`Self::passes`], for the point `steps` after the point of the same row with the UV `first`.
    pub fn passes_behind(
        &self,
        first: Vec2,
        steps: usize,
        weights: impl FnOnce() -> Vec3,
        threshold: impl FnOnce() -> f32,
    ) -> bool {
        self.passes_at(first + self.across * steps as f32, weights, threshold)
    }

    // Thresholds cost as much as a lookup, and masks from nearby need none.
    fn passes_at(&self, uv: Vec2, weights: impl FnOnce() -> Vec3, threshold: impl FnOnce() -> f32) -> bool {
        match self.alpha {
            Alpha::All => true,
            Alpha::Cut(image, cutoff) => self.alpha_factor(weights) * Texels::at(image, uv).alpha() >= cutoff,
            Alpha::Share(image) => self.alpha_factor(weights) * Texels::at(image, uv).alpha() > threshold(),
            Alpha::Level(level) => f32::from(nearest(level, uv)) > threshold() * 255.0,
            Alpha::Flat => match self.material.alpha_mode {
                AlphaMode::Mask(cutoff) => self.alpha_factor(weights) >= a_hair_less(cutoff),
                _ => self.alpha_factor(weights) > threshold(),
            },
        }
    }

    /// Returns the linear base color on the front (counter-clockwise winding) or the back.
    pub fn base_color(&self, spot: Spot, front: bool) -> Vec3 {
        let factor = match self.back_colors {
            Some(colors) if !front => self.material.base_color.truncate() * between_corners(colors, spot.weights),
            _ => self.factor(spot.weights).truncate(),
        };
        factor * self.texture(self.material.image.as_ref(), spot, Encoding::Srgb)
    }

    /// Returns occlusion, roughness and metallic.
    pub fn orm(&self, spot: Spot) -> Vec3 {
        let factors = Vec3::new(1.0, self.material.roughness, self.material.metallic);
        factors * self.texture(self.material.orm.as_ref(), spot, Encoding::Linear)
    }

    /// Returns the linear color of transmitted light.
    pub fn translucency(&self, spot: Spot) -> Vec3 {
        self.material.translucency * self.texture(self.material.translucency_image.as_ref(), spot, Encoding::Srgb)
    }

    /// Returns the unit normal on the front, in the foliage's axes; `corners` are the triangle's. `None` for a triangle without area.
    pub fn normal(&self, spot: Spot, corners: &[Vec3; 3]) -> Option<Vec3> {
        let weights = spot.weights;
        let [a, b, c] = *corners;
        let (u, v) = (b - a, c - a);
        let flat = u.cross(v).try_normalize()?;
        let smooth = self.normals.map_or(flat, |normals| between_corners(normals, weights));
        let smooth = smooth.try_normalize().unwrap_or(flat);
        // Mirrored meshes may have normals against the winding; they describe the same surface.
        let smooth = if smooth.dot(flat) < 0.0 { -smooth } else { smooth };
        let Some(image) = &self.material.normal else { return Some(smooth) };
        // The direction of the texture's rows; bitangents point up the texture, as the green of glTF normals does.
        let (s, t) = (self.uvs[1] - self.uvs[0], self.uvs[2] - self.uvs[0]);
        let across = (u * t.y - v * s.y) * s.perp_dot(t).signum();
        let Some(tangent) = (across - smooth * smooth.dot(across)).try_normalize() else { return Some(smooth) };
        let bitangent = smooth.cross(tangent) * s.perp_dot(t).signum();
        let mapped = self.texture(Some(image), spot, Encoding::Linear) * 2.0 - 1.0;
        (tangent * mapped.x + bitangent * mapped.y + smooth * mapped.z).try_normalize().or(Some(smooth))
    }

    /// Returns the nearest texel of one of the material's images, without alpha, as codes over 255.
    pub fn label(&self, image: impl Fn(&Material) -> Option<&Image>, uv: Vec2) -> Option<Vec3> {
        let image = image(self.material)?;
        let within =
            |coordinate: f32, size: usize| (((coordinate - floor(coordinate)) * size as f32) as usize).min(size - 1);
        let (column, row) = (within(uv.x, image.width()), within(1.0 - uv.y, image.height()));
        let [r, g, b, _] = image.pixels()[row * image.width() + column];
        Some(Vec3::new(f32::from(r), f32::from(g), f32::from(b)) / 255.0)
    }

    /// Returns the UV of a point, v up.
    pub fn uv(&self, weights: Vec3) -> Vec2 {
        let [a, b, c] = self.uvs;
        a * weights.x + b * weights.y + c * weights.z
    }

    fn factor(&self, weights: Vec3) -> Vec4 {
        match &self.colors {
            Some([a, b, c]) => self.material.base_color * (*a * weights.x + *b * weights.y + *c * weights.z),
            None => self.material.base_color,
        }
    }

    fn alpha_factor(&self, weights: impl FnOnce() -> Vec3) -> f32 {
        let Some([a, b, c]) = &self.colors else { return self.material.base_color.w };
        let weights = weights();
        self.material.base_color.w * (a.w * weights.x + b.w * weights.y + c.w * weights.z)
    }

    /// Samples an image; white without one.
    fn texture(&self, image: Option<&Image>, spot: Spot, encoding: Encoding) -> Vec3 {
        let Some(image) = image else { return Vec3::ONE };
        let uv = self.uv(spot.weights);
        let Some(sample) = self.sample else { return Texels::at(image, uv).shown(encoding) };
        match image.pyramid(encoding, footprint(image, sample * spot.samples)) {
            None => Texels::at(image, uv).color(encoding),
            Some(level) => between(level, uv),
        }
    }
}

fn between_corners([a, b, c]: [Vec3; 3], weights: Vec3) -> Vec3 {
    a * weights.x + b * weights.y + c * weights.z
}

/// Returns the image of the alpha test and its least drawn alpha code; `None` if everything is drawn.
fn least_drawn(material: &Material) -> Option<(&Image, f32)> {
    let image = material.image.as_ref()?;
    match material.alpha_mode {
        AlphaMode::Opaque => None,
        // A cutoff of 0 draws everything, also at a factor of 0.
        AlphaMode::Mask(cutoff) => Some((image, a_hair_less((cutoff / material.base_color.w).max(0.0) * 255.0))),
        AlphaMode::Blend => Some((image, 1.0)),
    }
}

impl Image {
    /// Returns whether a surface with this image is drawn at a point: from the cutoff on, or if its alpha is above a threshold.
    pub(crate) fn is_drawn(&self, uv: Vec2, mode: AlphaMode, threshold: f32) -> bool {
        match mode {
            AlphaMode::Opaque => true,
            AlphaMode::Mask(cutoff) => self.filtered_alpha(uv) >= a_hair_less(cutoff),
            AlphaMode::Blend => self.filtered_alpha(uv) > threshold,
        }
    }

    /// Returns the filtered alpha at a point, in [0, 1].
    pub(crate) fn filtered_alpha(&self, uv: Vec2) -> f32 {
        Texels::at(self, uv).alpha()
    }
}

/// Lowers a cutoff slightly: the weights of filters and corners sum to 1 only nearly, and a surface with exactly the cutoff's alpha must
/// not get holes.
pub(crate) fn a_hair_less(cutoff: f32) -> f32 {
    cutoff * (1.0 - 1e-5)
}

/// Returns the texels between neighboring points, as the geometric mean of both axes.
fn footprint(image: &Image, spread: f32) -> f32 {
    (spread * image.width() as f32 * image.height() as f32).sqrt()
}

/// Returns the texel at a UV of a repeating level.
fn nearest(level: &PyramidLevel<u8>, uv: Vec2) -> u8 {
    let (column, row) = (uv.x, 1.0 - uv.y);
    level.at(column - floor(column), row - floor(row))
}

/// Returns the bilinear color of four premultiplied texels; black if all are transparent.
fn between(level: &PyramidLevel<Texel>, uv: Vec2) -> Vec3 {
    let (x0, x1, fx) = neighbours(uv.x, level.width, level.scale.x);
    let (y0, y1, fy) = neighbours(1.0 - uv.y, level.height, level.scale.y);
    let texel = |x: usize, y: usize| Vec4::from_array(level.texels[y * level.width + x].map(f32::from));
    let sum = texel(x0, y0).lerp(texel(x1, y0), fx).lerp(texel(x0, y1).lerp(texel(x1, y1), fx), fy);
    if sum.w > 0.0 { sum.truncate() / sum.w } else { Vec3::ZERO }
}

/// The four texels around a point and their bilinear weights, on a repeating image.
///
/// Error bound: a coordinate in [0, 1) times the image's side s is rounded twice, so the place is off by up to s · 2⁻²³ of a texel. Alpha
/// is off by as much along either axis, plus three roundings.
struct Texels {
    texels: [[u8; 4]; 4],
    weights: [f32; 4],
}

impl Texels {
    fn at(image: &Image, uv: Vec2) -> Self {
        // Texel centers lie at half-integers; v is up, rows go down.
        let (x0, x1, fx) = neighbours(uv.x, image.width(), image.width() as f32);
        let (y0, y1, fy) = neighbours(1.0 - uv.y, image.height(), image.height() as f32);
        let pixels = image.pixels();
        let texel = |x: usize, y: usize| pixels[y * image.width() + x];
        Self {
            texels: [texel(x0, y0), texel(x1, y0), texel(x0, y1), texel(x1, y1)],
            weights: [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy],
        }
    }

    fn alpha(&self) -> f32 {
        let sum: f32 = self.texels.iter().zip(self.weights).map(|(t, w)| f32::from(t[3]) * w).sum();
        sum / 255.0
    }

    /// Returns the color weighted by alpha: colors under transparent texels do not bleed in. Unweighted if all four are transparent.
    fn color(&self, encoding: Encoding) -> Vec3 {
        let linear = |t: &[u8; 4]| Vec3::from_array([t[0], t[1], t[2]].map(|code| pyramid::decoded(code, encoding)));
        let mean = |alpha: fn(&[u8; 4]) -> f32| {
            let weighted = self.texels.iter().zip(self.weights);
            weighted.fold((Vec3::ZERO, 0.0), |(sum, total), (t, w)| {
                (sum + linear(t) * (w * alpha(t)), total + w * alpha(t))
            })
        };
        let (sum, total) = mean(|t| f32::from(t[3]));
        if total > 0.0 { sum / total } else { mean(|_| 1.0).0 }
    }

    /// Returns the color as renderers show it from nearby, regardless of alpha: the mean of GPU filtering, which interpolates linear light,
    /// and Cycles' filtering, which interpolates codes. On pines the two differ by 3 %, and weighting by alpha is brighter than either.
    fn shown(&self, encoding: Encoding) -> Vec3 {
        let between = |value: &dyn Fn(u8) -> f32| {
            let part = |i: usize| self.texels.iter().zip(self.weights).map(|(t, w)| value(t[i]) * w).sum::<f32>();
            Vec3::new(part(0), part(1), part(2))
        };
        let light = between(&|code| pyramid::decoded(code, encoding));
        let codes = between(&f32::from);
        light.midpoint(Vec3::from_array(codes.to_array().map(|code| pyramid::decoded_between(code, encoding))))
    }
}

/// Returns the two texels around a coordinate on an axis that repeats after `scale` texels, and the weight of the second.
fn neighbours(coordinate: f32, size: usize, scale: f32) -> (usize, usize, f32) {
    let place = (coordinate - floor(coordinate)) * scale - 0.5;
    // `place` lies in [−½, size − ½]: before the first texel comes the last. NaN becomes 0.
    let (first, below) = if place < 0.0 { (size - 1, -1.0) } else { ((place as usize).min(size - 1), floor(place)) };
    let second = if first + 1 == size { 0 } else { first + 1 };
    (first, second, place - below)
}

/// Replaces `f32::floor` for UVs and places on images: `f32::floor` is a function call without SSE 4.1, which not every processor has.
fn floor(x: f32) -> f32 {
    let whole = x as i32 as f32;
    if whole > x { whole - 1.0 } else { whole }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::common::random::Random;
    use crate::common::stability::{case, worse};
    use crate::foliage::Attributes;

    /// Bilinear alpha from its definition, in f64.
    fn alpha(image: &Image, u: f64, v: f64) -> f64 {
        let (width, height) = (image.width(), image.height());
        let (x, y) = (u.rem_euclid(1.0) * width as f64 - 0.5, (1.0 - v).rem_euclid(1.0) * height as f64 - 0.5);
        let texel = |i: f64, j: f64| {
            let (i, j) = (i.rem_euclid(width as f64) as usize, j.rem_euclid(height as f64) as usize);
            f64::from(image.pixels()[j * width + i][3]) / 255.0
        };
        let (i, j, fx, fy) = (x.floor(), y.floor(), x - x.floor(), y - y.floor());
        let row = |j: f64| texel(i, j) * (1.0 - fx) + texel(i + 1.0, j) * fx;
        row(j) * (1.0 - fy) + row(j + 1.0) * fy
    }

    #[test]
    fn filtering_is_as_near_as_is_said() {
        let mut random = Random(51);
        let mut worst: f64 = 0.0;
        for (width, height) in [(1, 1), (1, 16_384), (16_384, 1), (37, 64), (1024, 1024)] {
            let pixels: Vec<[u8; 4]> = (0..width * height).map(|_| [0, 0, 0, random.below(256) as u8]).collect();
            let image = Image::new(width, height, pixels).unwrap();
            let bound = (width + height) as f64 * 2f64.powi(-23) + 4.0 * 2f64.powi(-24);
            for _ in 0..5000 {
                let (u, v) = (random.signed() as f32 * 3.0, random.signed() as f32 * 3.0);
                // Wrap before the lookup: in f32 a coordinate of 3 has lost two bits, which is not the filter's error.
                let (u, v) = (u.rem_euclid(1.0), v.rem_euclid(1.0));
                let found = f64::from(Texels::at(&image, Vec2::new(u, v)).alpha());
                worst = worse(worst, (found - alpha(&image, f64::from(u), f64::from(v))).abs() / bound);
            }
        }
        case("Kernels", "bilinear alpha, f32, as a share of its bound", "the definition in f64; the stated bound")
            .holds(worst, 1.0);
    }

    #[test]
    fn in_points_a_colour_lies_between_light_and_codes_whatever_its_alpha() {
        // Between black and a transparent white: 0.5 of the light, and the light of code 127.5, by the standard's formula.
        let image = Image::new(2, 1, vec![[0, 0, 0, 255], [255, 255, 255, 0]]).unwrap();
        let material = Material { image: Some(image), alpha_mode: AlphaMode::Blend, ..Material::default() };
        let attributes = Attributes { uvs: vec![[Vec2::new(0.5, 0.5); 3]], ..Attributes::default() };
        let foliage =
            Foliage::new(&[DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]], attributes, vec![material]).unwrap();
        let spot = Spot { weights: Vec3::splat(1.0 / 3.0), samples: 1.0 };
        let color = |filter| Surface::spread(&foliage, 0, [Vec3::X, Vec3::Y], filter).base_color(spot, true);
        let of_code = ((0.5f64 + 0.055) / 1.055).powf(2.4);
        let between = f64::midpoint(0.5, of_code);
        assert!((f64::from(color(0.0).x) - between).abs() < 1e-4, "{} instead of {between}", color(0.0));
        assert_eq!(color(1.0), Vec3::ZERO, "transparent texels do not count when filtered");
    }

    #[test]
    fn blocks_that_are_left_out_show_nothing() {
        let mut random = Random(53);
        let mut lost = 0;
        let mut left_out = 0;
        for draw in 0..10_000 {
            // Sparse images of any size and UV layout, at any density, with and without repeats.
            let (width, height) = (1 + random.below(150), 1 + random.below(150));
            let opaque = |_| [9, 9, 9, if random.below(500) == 0 { 255 } else { 0 }];
            let image = Image::new(width, height, (0..width * height).map(opaque).collect::<Vec<_>>()).unwrap();
            let mode = AlphaMode::Blend;
            let factor = [1.0, 0.7, 0.0][random.below(3)];
            let cutoff = if factor == 0.0 { 0.0 } else { 0.5 };
            let mode = if draw % 2 == 0 { AlphaMode::Mask(cutoff) } else { mode };
            let base_color = Vec4::new(1.0, 1.0, 1.0, factor);
            let material = Material { image: Some(image), alpha_mode: mode, base_color, ..Material::default() };
            let uvs = [[(); 3].map(|()| Vec2::new(random.signed() as f32, random.signed() as f32) * 2.0)];
            let attributes = Attributes { uvs: uvs.to_vec(), ..Attributes::default() };
            let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
            let foliage = Foliage::new(&corners, vec![[0, 1, 2]], attributes, vec![material]).unwrap();
            // Seen face-on and nearly edge-on.
            let step = |random: &mut Random| {
                let size = 10f32.powf(random.signed() as f32 * 2.0 - 2.0);
                let (b, c) = (random.signed() as f32 * size, random.signed() as f32 * size);
                Vec3::new(-b - c, b, c)
            };
            let steps = [step(&mut random), step(&mut random)];
            let surface = Surface::spread(&foliage, 0, steps, 1.0);
            let middle = Vec3::new(0.4, 0.3, 0.3);
            let at = |x: usize, y: usize| middle + steps[0] * (x as f32 - 3.5) + steps[1] * (y as f32 - 3.5);
            let any = (0..64).any(|i| surface.passes(at(i % 8, i / 8), 1.0 / 512.0));
            left_out += usize::from(!surface.block_may_pass(middle));
            lost += usize::from(any && !surface.block_may_pass(middle));
            let middle_of_row = middle + steps[1] * 0.5;
            let any = (0..8).any(|x| surface.passes(at(x, 4), 1.0 / 512.0));
            left_out += usize::from(!surface.run_may_pass(middle_of_row));
            lost += usize::from(any && !surface.run_may_pass(middle_of_row));
        }
        assert!(left_out > 500, "{left_out}");
        case("Kernels", "blocks and runs of samples that are left out though they show something", "definition: none")
            .holds(lost as f64, 0.0);
    }
}
