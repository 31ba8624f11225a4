//! What a point of a triangle looks like: alpha test and linear base colour.

use glam::{Vec2, Vec3, Vec4};

use super::{AlphaMode, Foliage, Image, Material};
use crate::color::decode_table;

/// A triangle's surface, ready to be sampled.
pub struct Surface<'a> {
    material: &'a Material,
    uvs: [Vec2; 3],
    colors: Option<[Vec4; 3]>,
}

impl<'a> Surface<'a> {
    pub fn new(foliage: &'a Foliage, triangle: usize) -> Self {
        let attributes = foliage.attributes();
        Self {
            material: foliage.material(triangle),
            uvs: attributes.uvs.get(triangle).copied().unwrap_or_default(),
            colors: attributes.colors.get(triangle).copied(),
        }
    }

    /// Whether the side that winds clockwise is drawn, too.
    pub fn double_sided(&self) -> bool {
        self.material.double_sided
    }

    /// The linear colour at barycentric weights, or `None` where the alpha test lets through what lies behind. Blended alpha passes when
    /// it is above `threshold`: thresholds spread evenly over [0, 1) make it coverage.
    pub fn sample(&self, weights: Vec3, threshold: f32) -> Option<Vec3> {
        let factor = match &self.colors {
            Some([a, b, c]) => self.material.base_color * (*a * weights.x + *b * weights.y + *c * weights.z),
            None => self.material.base_color,
        };
        let texels = self.material.image.as_ref().map(|image| {
            let [a, b, c] = self.uvs;
            Texels::at(image, a * weights.x + b * weights.y + c * weights.z)
        });
        let alpha = || factor.w * texels.as_ref().map_or(1.0, Texels::alpha);
        let passes = match self.material.alpha_mode {
            AlphaMode::Opaque => true,
            AlphaMode::Mask(cutoff) => alpha() >= cutoff,
            AlphaMode::Blend => alpha() > threshold,
        };
        passes.then(|| factor.truncate() * texels.map_or(Vec3::ONE, |t| t.color()))
    }
}

/// The four texels around a point and their bilinear weights; the image repeats.
///
/// Error bound: a coordinate in [0, 1) times the image's side s is rounded twice, so the place is off by up to s · 2⁻²³ of a texel, and alpha
/// by as much in either direction, and by three roundings.
struct Texels {
    texels: [[u8; 4]; 4],
    weights: [f32; 4],
}

impl Texels {
    fn at(image: &Image, uv: Vec2) -> Self {
        // Texel centres lie at half-integers; v is up, rows go down.
        let (x0, x1, fx) = neighbours(uv.x, image.width());
        let (y0, y1, fy) = neighbours(1.0 - uv.y, image.height());
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

    /// Weighted by alpha, so that the colour under transparent texels does not bleed in; plain where all four are transparent.
    fn color(&self) -> Vec3 {
        let table = decode_table();
        let linear = |t: &[u8; 4]| Vec3::new(table[t[0] as usize], table[t[1] as usize], table[t[2] as usize]);
        let mean = |alpha: fn(&[u8; 4]) -> f32| {
            let weighted = self.texels.iter().zip(self.weights);
            weighted.fold((Vec3::ZERO, 0.0), |(sum, total), (t, w)| {
                (sum + linear(t) * (w * alpha(t)), total + w * alpha(t))
            })
        };
        let (sum, total) = mean(|t| f32::from(t[3]));
        if total > 0.0 { sum / total } else { mean(|_| 1.0).0 }
    }
}

/// The two texels around a coordinate, in [0, 1) of an axis that repeats, and the weight of the second.
fn neighbours(coordinate: f32, size: usize) -> (usize, usize, f32) {
    let wrapped = (coordinate - coordinate.floor()) * size as f32 - 0.5;
    let first = wrapped.floor();
    // `wrapped` lies in [−½, size − ½], so one period either way is enough.
    let index = |i: f32| (i + size as f32) as usize % size;
    (index(first), index(first + 1.0), wrapped - first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::random::Random;
    use crate::common::stability::{case, worse};

    /// Bilinear alpha by its definition, in f64.
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
                // Wrapping is exact in f64; in f32 a coordinate of 3 has lost two bits, which are its own.
                let (u, v) = (u.rem_euclid(1.0), v.rem_euclid(1.0));
                let found = f64::from(Texels::at(&image, Vec2::new(u, v)).alpha());
                worst = worse(worst, (found - alpha(&image, f64::from(u), f64::from(v))).abs() / bound);
            }
        }
        case("Kernels", "bilinear alpha, f32, as a share of its bound", "the definition in f64; the stated bound")
            .holds(worst, 1.0);
    }
}
