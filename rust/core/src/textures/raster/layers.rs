//! All points at which samples of a picture meet triangles, for pictures of many versions of one image's alpha.
//!
//! A version costs a lookup for each point of a sample until one is drawn; triangles are not rasterized again. O(points), 12 bytes each.

use glam::Vec2;

use super::tiles::{bounds, middles};
use super::{Samples, ScreenTriangle, TILE};
use crate::foliage::{AlphaMode, Image, Surface, a_hair_less};
use crate::textures::samples::{Edges, Thresholds};

/// The points of one picture.
pub struct Layers {
    /// Pixels along each side, and samples along each side of a pixel.
    size: usize,
    samples: usize,
    /// For each sample, row by row, the end of its points.
    ends: Vec<u32>,
    points: Vec<Point>,
}

/// A point of a triangle at a sample.
#[derive(Clone, Copy)]
struct Point {
    uv: Vec2,
    /// Alpha from which it is drawn, if alpha is a share.
    threshold: f32,
}

impl Layers {
    /// Finds the points in a picture of `size`² pixels, of all triangles whole: without their windows and reaches.
    #[must_use]
    pub fn of(triangles: &[ScreenTriangle], size: usize, samples: Samples) -> Self {
        let side = size * samples.side();
        let mut ends = vec![0u32; side * side];
        for_each_point(triangles, side, samples.side(), |sample, _| ends[sample] += 1);
        let mut end = 0;
        for count in &mut ends {
            (*count, end) = (end, end + *count);
        }
        let mut points = vec![Point { uv: Vec2::ZERO, threshold: 0.0 }; end as usize];
        for_each_point(triangles, side, samples.side(), |sample, point| {
            points[ends[sample] as usize] = point;
            ends[sample] += 1;
        });
        Self { size, samples: samples.side(), ends, points }
    }

    /// Returns the number of samples of each pixel, row by row, that show any point of the image.
    #[must_use]
    pub fn covered(&self, image: &Image, mode: AlphaMode) -> Vec<u32> {
        let mut counts = vec![0; self.size * self.size];
        for (pixel, points) in self.by_sample() {
            counts[pixel] += u32::from(points.iter().any(|point| image.is_drawn(point.uv, mode, point.threshold)));
        }
        counts
    }

    /// Returns the same for an image that is cut out at each of some ascending cutoffs, in about the time for one.
    #[must_use]
    pub fn cut_out<const N: usize>(&self, image: &Image, cutoffs: [f32; N]) -> [Vec<u32>; N] {
        let mut counts = cutoffs.map(|_| vec![0; self.size * self.size]);
        let cutoffs = cutoffs.map(a_hair_less);
        for (pixel, points) in self.by_sample() {
            let mut reached = 0;
            for point in points {
                let alpha = image.filtered_alpha(point.uv);
                reached += cutoffs[reached..].iter().take_while(|cutoff| alpha >= **cutoff).count();
                if reached == N {
                    break;
                }
            }
            counts[..reached].iter_mut().for_each(|of_cutoff| of_cutoff[pixel] += 1);
        }
        counts
    }

    /// Yields the pixel and the points of each sample.
    fn by_sample(&self) -> impl Iterator<Item = (usize, &[Point])> {
        let side = self.size * self.samples;
        let mut start = 0;
        self.ends.iter().enumerate().map(move |(sample, &end)| {
            let points = &self.points[start..end as usize];
            start = end as usize;
            (sample / side / self.samples * self.size + sample % side / self.samples, points)
        })
    }
}

/// Calls `found` with each sample of a picture of `side`² samples, `samples`² for a pixel, and each point of a triangle there.
fn for_each_point(triangles: &[ScreenTriangle], side: usize, samples: usize, mut found: impl FnMut(usize, Point)) {
    let scale = samples as f32;
    for (index, triangle) in (0u32..).zip(triangles) {
        let Some(edges) = Edges::new(triangle.corners.map(|corner| corner.truncate() * scale)) else { continue };
        let surface = Surface::new(triangle.foliage, triangle.triangle as usize);
        if !edges.front && !surface.double_sided() {
            continue;
        }
        let thresholds = Thresholds::new(samples, index);
        let (low, high) = bounds(&triangle.corners);
        let [rows, columns] =
            [(low.y, high.y), (low.x, high.x)].map(|(low, high)| middles(low * scale, high * scale, side));
        for y in rows {
            for x in edges.span(y as f32 + 0.5, &columns) {
                let weights = edges.weights(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
                if weights.min_element() >= 0.0 {
                    let [x_in_tile, y_in_tile] = [x, y].map(|sample| sample % (TILE * samples));
                    let threshold = thresholds.at(x_in_tile, y_in_tile);
                    found(y * side + x, Point { uv: surface.uv(weights), threshold });
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::foliage::{Attributes, Foliage, Material};
    use crate::textures::Window;

    /// A square of 8 × 8 pixels. `mirrored`: its texture is mirrored.
    fn square(mirrored: bool) -> Foliage {
        let corners = [(0.0, 0.0), (8.0, 0.0), (8.0, 8.0), (0.0, 8.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
        let uv = |i: usize| {
            let u = (corners[i].x / 8.0) as f32;
            Vec2::new(if mirrored { 1.0 - u } else { u }, 0.5)
        };
        let triangles = [[0, 1, 2], [0, 2, 3]];
        let uvs = triangles.map(|t| t.map(|i: u32| uv(i as usize))).to_vec();
        let material = Material { double_sided: true, ..Material::default() };
        let attributes = Attributes { uvs, ..Attributes::default() };
        Foliage::new(&corners, triangles.to_vec(), attributes, vec![material]).unwrap()
    }

    fn layers(squares: &[Foliage]) -> Layers {
        let triangles = squares.iter().flat_map(|foliage| {
            (0..2).map(|triangle| ScreenTriangle {
                corners: foliage.corners(triangle).map(|p| foliage.frame().to_caller(p).as_vec3()),
                foliage,
                triangle: triangle as u32,
                window: &Window::WHOLE,
                reach: f32::INFINITY,
            })
        });
        Layers::of(&triangles.collect::<Vec<_>>(), 8, Samples::new(2).unwrap())
    }

    #[test]
    fn a_sample_is_covered_if_any_layer_is_drawn_there() {
        // Alpha is at least one half on the left half of the square: from the middle of a texel it falls evenly to that of the other.
        let image = Image::new(2, 1, vec![[0, 0, 0, 255], [0; 4]]).unwrap();
        let cut = AlphaMode::Mask(0.5);
        let rows = |row: [u32; 8]| row.repeat(8);
        assert_eq!(layers(&[square(false)]).covered(&image, cut), rows([4, 4, 4, 4, 0, 0, 0, 0]));
        assert_eq!(layers(&[square(true)]).covered(&image, cut), rows([0, 0, 0, 0, 4, 4, 4, 4]));
        assert_eq!(layers(&[square(false), square(true)]).covered(&image, cut), rows([4; 8]));
        assert_eq!(layers(&[square(false)]).covered(&image, AlphaMode::Opaque), rows([4; 8]));
    }

    #[test]
    fn cutoffs_together_cover_what_each_covers_alone() {
        let image = Image::new(4, 1, [30, 250, 128, 90].map(|alpha| [0, 0, 0, alpha]).to_vec()).unwrap();
        let both = layers(&[square(false), square(true)]);
        let cutoffs = [0.2, 0.4, 0.6, 0.9];
        assert_eq!(both.cut_out(&image, cutoffs), cutoffs.map(|cutoff| both.covered(&image, AlphaMode::Mask(cutoff))));
    }

    #[test]
    fn alpha_is_a_share_of_the_samples_and_layers_multiply_what_they_leave() {
        let image = Image::new(1, 1, vec![[0, 0, 0, 102]]).unwrap();
        let share = |squares: &[Foliage]| {
            f64::from(layers(squares).covered(&image, AlphaMode::Blend).into_iter().sum::<u32>()) / 256.0
        };
        assert!((share(&[square(false)]) - 0.4).abs() < 0.04, "{}", share(&[square(false)]));
        let two = share(&[square(false), square(true)]);
        assert!((two - 0.64).abs() < 0.06, "{two}");
    }

    #[test]
    fn points_beside_the_picture_do_not_count() {
        let far = square(false);
        let moved = far.with_corners(&(0..2).map(|t| far.corners(t).map(|p| p + DVec3::X * 9.0)).collect::<Vec<_>>());
        let image = Image::new(1, 1, vec![[0, 0, 0, 255]]).unwrap();
        assert_eq!(layers(&[moved.unwrap()]).covered(&image, AlphaMode::Opaque), vec![0; 64]);
    }
}
