//! An orthographic rasteriser: coverage by supersampling, the nearest surface by a depth buffer, alpha by test.
//!
//! The canvas is cut into tiles that fit a core's cache; each tile is drawn by one thread from the list of triangles that
//! touch it, in their order, so the result does not depend on the number of threads. A sample takes the fragment nearest to
//! the viewer that passes its alpha test (of equally near ones, the first triangle's). O(fragments · samples²), one texture look-up for a
//! fragment that passes the depth test.
//!
//! Error bound: sample positions are exact; edges are decided in f32 at coordinates up to 2¹⁴, within 2⁻⁸ of a texel.

use std::ops::Range;

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::Samples;
use crate::color::{encode, quantise};
use crate::foliage::Surface;
use crate::foliage::{Foliage, Image};

const TILE: usize = 32;

/// A triangle in pixels: x to the right, y down from the upper left corner, z toward the viewer.
#[derive(Clone)]
pub struct ScreenTriangle<'a> {
    /// Where it is drawn.
    pub corners: [Vec3; 3],
    /// What it belongs to.
    pub foliage: &'a Foliage,
    /// Which one it is.
    pub triangle: usize,
    /// The pixels that it may cover.
    pub clip: Clip,
}

/// Columns and rows of pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Clip {
    /// From the left.
    pub columns: Range<usize>,
    /// From the top.
    pub rows: Range<usize>,
}

impl Clip {
    /// All pixels.
    pub const NONE: Self = Self { columns: 0..usize::MAX, rows: 0..usize::MAX };
}

/// A picture in linear light, colour premultiplied by coverage; row 0 on top.
#[derive(Clone)]
pub struct Canvas {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// All pixels.
    pub pixels: Vec<Vec4>,
}

impl Canvas {
    /// As sRGB with straight alpha.
    ///
    /// # Panics
    /// Never: a canvas has as many pixels as it says.
    #[must_use]
    pub fn to_image(&self) -> Image {
        let straight = |p: &Vec4| {
            let color = if p.w > 0.0 { p.truncate() / p.w } else { p.truncate() };
            [encode(color.x), encode(color.y), encode(color.z), quantise(p.w)]
        };
        let pixels: Vec<[u8; 4]> = self.pixels.par_iter().map(straight).collect();
        Image::new(self.width, self.height, pixels).expect("a canvas is whole")
    }
}

/// Draws the triangles on a canvas of `width` × `height` pixels, each at least 1.
#[must_use]
pub fn rasterise(triangles: &[ScreenTriangle], width: usize, height: usize, samples: Samples) -> Canvas {
    let tiles = Tiles { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) };
    let lists = tiles.lists(triangles);
    let drawn: Vec<Vec<Vec4>> = (0..tiles.columns * tiles.rows)
        .into_par_iter()
        .map(|tile| draw_tile(triangles, &lists[tile], tiles.origin(tile), samples.0))
        .collect();
    let mut pixels = vec![Vec4::ZERO; width * height];
    pixels.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            // A tile that nothing touches is empty.
            let tile = &drawn[y / TILE * tiles.columns + x / TILE];
            *pixel = tile.get(y % TILE * TILE + x % TILE).copied().unwrap_or(Vec4::ZERO);
        }
    });
    Canvas { width, height, pixels }
}

struct Tiles {
    columns: usize,
    rows: usize,
}

impl Tiles {
    fn origin(&self, tile: usize) -> Vec2 {
        Vec2::new((tile % self.columns * TILE) as f32, (tile / self.columns * TILE) as f32)
    }

    /// The triangles whose boxes touch each tile, in order.
    fn lists(&self, triangles: &[ScreenTriangle]) -> Vec<Vec<u32>> {
        let mut lists = vec![Vec::new(); self.columns * self.rows];
        for (index, triangle) in (0u32..).zip(triangles) {
            let (low, high) = bounds(&triangle.corners);
            for row in covered(low.y, high.y, TILE as f32, self.rows) {
                for column in covered(low.x, high.x, TILE as f32, self.columns) {
                    lists[row * self.columns + column].push(index);
                }
            }
        }
        lists
    }
}

fn bounds([a, b, c]: &[Vec3; 3]) -> (Vec2, Vec2) {
    let (low, high) = (a.min(*b).min(*c), a.max(*b).max(*c));
    (low.truncate(), high.truncate())
}

/// The cells of `size`, of `count`, that the interval touches.
fn covered(low: f32, high: f32, size: f32, count: usize) -> Range<usize> {
    // Casts of negative numbers and NaN give 0.
    (low / size).floor() as usize..(((high / size).floor() + 1.0) as usize).min(count)
}

fn overlap(a: &Range<usize>, b: &Range<usize>) -> Range<usize> {
    a.start.max(b.start)..a.end.min(b.end)
}

/// The samples of pixels in a tile that begins at the pixel `origin`.
fn samples_of(pixels: &Range<usize>, origin: f32, samples: usize) -> Range<usize> {
    let sample = |pixel: usize| pixel.saturating_sub(origin as usize).saturating_mul(samples);
    sample(pixels.start)..sample(pixels.end)
}

/// The samples of one tile, row by row.
struct TileSamples {
    /// Samples in a row.
    side: usize,
    depths: Vec<f32>,
    colors: Vec<Vec3>,
}

fn draw_tile(triangles: &[ScreenTriangle], list: &[u32], origin: Vec2, samples: usize) -> Vec<Vec4> {
    if list.is_empty() {
        return Vec::new();
    }
    let side = TILE * samples;
    let mut tile =
        TileSamples { side, depths: vec![f32::NEG_INFINITY; side * side], colors: vec![Vec3::ZERO; side * side] };
    for &index in list {
        draw_triangle(&mut tile, &triangles[index as usize], index, origin, samples);
    }
    resolve(&tile, samples)
}

fn draw_triangle(tile: &mut TileSamples, triangle: &ScreenTriangle, index: u32, origin: Vec2, samples: usize) {
    let surface = Surface::new(triangle.foliage, triangle.triangle);
    let scale = samples as f32;
    let corners = triangle.corners.map(|c| (c.truncate() - origin) * scale);
    let Some(edges) = Edges::new(corners, surface.double_sided()) else { return };
    let low = corners[0].min(corners[1]).min(corners[2]);
    let high = corners[0].max(corners[1]).max(corners[2]);
    let depths = Vec3::from_array(triangle.corners.map(|c| c.z));
    let Clip { columns, rows } = &triangle.clip;
    let rows = overlap(&covered(low.y - 0.5, high.y, 1.0, tile.side), &samples_of(rows, origin.y, samples));
    let columns = overlap(&covered(low.x - 0.5, high.x, 1.0, tile.side), &samples_of(columns, origin.x, samples));
    for y in rows {
        for x in columns.clone() {
            let weights = edges.weights(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
            if weights.min_element() < 0.0 {
                continue;
            }
            let depth = weights.dot(depths);
            let sample = y * tile.side + x;
            if depth <= tile.depths[sample] {
                continue;
            }
            if let Some(color) = surface.sample(weights, threshold(x % samples, y % samples, samples, index)) {
                tile.depths[sample] = depth;
                tile.colors[sample] = color;
            }
        }
    }
}

/// Barycentric weights as affine functions of the place.
struct Edges {
    origin: Vec2,
    /// Gradients of the second and third weight.
    second: Vec2,
    third: Vec2,
}

impl Edges {
    /// `None` for a triangle without area, for one whose area is beyond f32, and for one that turns its back when only fronts are drawn.
    fn new([a, b, c]: [Vec2; 3], double_sided: bool) -> Option<Self> {
        let (u, v) = (b - a, c - a);
        let twice_area = u.perp_dot(v);
        // y is down: counter-clockwise to the viewer is negative here.
        let shown = twice_area < 0.0 || (double_sided && twice_area > 0.0);
        let inverse = 1.0 / twice_area;
        (shown && twice_area.is_finite() && inverse.is_finite()).then(|| Self {
            origin: a,
            second: Vec2::new(v.y, -v.x) * inverse,
            third: Vec2::new(-u.y, u.x) * inverse,
        })
    }

    fn weights(&self, point: Vec2) -> Vec3 {
        let q = point - self.origin;
        let (second, third) = (self.second.dot(q), self.third.dot(q));
        Vec3::new(1.0 - second - third, second, third)
    }
}

/// An alpha threshold for a sample: the samples of a pixel have evenly spread ones, in an order of the triangle's own.
fn threshold(x: usize, y: usize, samples: usize, triangle: u32) -> f32 {
    let count = (samples * samples) as u32;
    // A full-period walk through the samples; 5 and the squares 1 … 256 of 1 … 16 share a factor for multiples of 5 only, 7 serves those.
    let step = if samples.is_multiple_of(5) { 7 } else { 5 };
    let place = (y * samples + x) as u32;
    let start = triangle.wrapping_mul(0x9E37_79B9) >> 16;
    ((place * step + start) % count) as f32 / count as f32
}

/// The mean of each pixel's samples.
fn resolve(tile: &TileSamples, samples: usize) -> Vec<Vec4> {
    let weight = 1.0 / (samples * samples) as f32;
    let pixel = |i: usize| {
        let (x, y) = (i % TILE * samples, i / TILE * samples);
        let mut sum = Vec4::ZERO;
        for row in y..y + samples {
            for sample in row * tile.side + x..row * tile.side + x + samples {
                if tile.depths[sample] > f32::NEG_INFINITY {
                    sum += tile.colors[sample].extend(1.0);
                }
            }
        }
        sum * weight
    };
    (0..TILE * TILE).map(pixel).collect()
}
