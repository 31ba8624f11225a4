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
