//! An orthographic rasterizer with supersampled coverage, a depth buffer and an alpha test.
//!
//! The canvas is cut into tiles that fit a core's cache. One thread draws each tile from the ordered list of triangles that touch it, so
//! the result does not depend on the number of threads. First each sample finds its triangle: the fragment nearest to the viewer that
//! passes the alpha test; among equally near ones, the first triangle's. Then each shader runs, once for each triangle visible in a
//! pixel (or, on request, in each part of a pixel), in the middle of its samples there. O(fragments · samples²), with one alpha test for
//! each sample that passes the depth test. Near triangles are drawn first, and blocks of samples behind all that is drawn are skipped (Greene,
//! Kass and Miller, "Hierarchical Z-Buffer Visibility", 1993).
//!
//! Error bound: sample positions are exact; edges are decided in f32 at coordinates up to 2¹⁴, within 2⁻⁸ of a texel.

mod depths;
mod layers;
mod plain;
mod seen;
mod tiles;
mod visibility;

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use glam::{Mat3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use self::depths::Depths;
use self::tiles::{Tiles, bounds};
use super::samples::{Edges, Samples, TILE, Thresholds};
use crate::error::Result;
use crate::foliage::{Foliage, Spot, Surface};
use crate::progress::Progress;

pub use layers::Layers;
pub use plain::{count_covered, depths};
pub use seen::{SeenInPixel, SeenTriangles, count_seen, seen_among};

/// A triangle in pixels: x to the right, y down from the upper left corner, z toward the viewer.
#[derive(Clone)]
pub struct ScreenTriangle<'a> {
    /// Corners on screen.
    pub corners: [Vec3; 3],
    /// The foliage of the triangle.
    pub foliage: &'a Foliage,
    /// Index of the triangle in `foliage`.
    pub triangle: u32,
    /// Clip window and view axes.
    pub window: &'a Window,
    /// Greatest |z| up to which it is drawn.
    pub reach: f32,
}

impl ScreenTriangle<'_> {
    /// Returns the depth of its nearest corner.
    fn nearest(&self) -> f32 {
        self.corners.iter().map(|corner| corner.z).fold(f32::NEG_INFINITY, f32::max)
    }

    /// Returns whether it may cover any part of its window.
    pub(super) fn is_within(&self) -> bool {
        let (low, high) = bounds(&self.corners);
        let overlaps =
            |low: f32, high: f32, pixels: &Range<usize>| high >= pixels.start as f32 && low <= pixels.end as f32;
        overlaps(low.x, high.x, &self.window.columns) && overlaps(low.y, high.y, &self.window.rows)
    }
}

/// A part of the canvas with its own view axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Columns that may be covered, from the left.
    pub columns: Range<usize>,
    /// Rows that may be covered, from the top.
    pub rows: Range<usize>,
    /// Rotation from the foliage's axes to right, up, toward the viewer.
    pub view: Mat3,
}

impl Window {
    /// All pixels, seen along −z.
    pub const WHOLE: Self = Self { columns: 0..usize::MAX, rows: 0..usize::MAX, view: Mat3::IDENTITY };
}

/// A visible point of a triangle.
pub struct Seen<'a> {
    /// Surface of the triangle.
    pub surface: &'a Surface<'a>,
    /// The triangle on screen.
    pub triangle: &'a ScreenTriangle<'a>,
    /// Position on the triangle, and number of samples.
    pub spot: Spot,
    /// Whether the visible side is the one with counter-clockwise winding.
    pub front: bool,
}

/// A rule for the values of a picture.
pub trait Shader: Sync {
    /// Returns the value at a visible point.
    fn shade(&self, seen: &Seen) -> Vec3;

    /// Returns whether a pixel takes the mean of its samples. Otherwise it takes the value of the triangle with the most samples in it.
    fn averages(&self) -> bool {
        true
    }
}

/// A picture of one shader, premultiplied by coverage; row 0 on top.
#[derive(Clone)]
pub struct Canvas {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// All pixels.
    pub pixels: Vec<Vec4>,
}

/// Draws the triangles on one canvas for each shader, each `width` × `height` pixels, both at least 1.
///
/// # Panics
/// Never: nobody cancels.
#[must_use]
pub fn rasterise(
    triangles: &[ScreenTriangle<'_>],
    width: usize,
    height: usize,
    samples: Samples,
    shaders: &[impl Shader],
) -> Vec<Canvas> {
    let drawn = rasterise_timed(triangles, width, height, samples, shaders, Progress::silent());
    drawn.expect("nobody cancels a silent progress").0
}

/// Draws as [`rasterise`] does; also returns the seconds for shading each canvas, as its share of all threads' time. Visibility is not
/// included. Reports progress after each row of tiles.
///
/// # Errors
/// [`crate::Error::Cancelled`].
pub(crate) fn rasterise_timed<'a>(
    triangles: &[ScreenTriangle<'a>],
    width: usize,
    height: usize,
    samples: Samples,
    shaders: &[impl Shader],
    progress: Progress,
) -> Result<(Vec<Canvas>, Vec<f64>)> {
    let started = Instant::now();
    // Nanoseconds for visibility, then for each shader.
    let spent: Vec<AtomicU64> = (0..=shaders.len()).map(|_| AtomicU64::new(0)).collect();
    let tiles = Tiles { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) };
    let lists = tiles.lists(triangles, samples);
    let empty = || Canvas { width, height, pixels: vec![Vec4::ZERO; width * height] };
    let mut canvases: Vec<Canvas> = shaders.iter().map(|_| empty()).collect();
    // Each row of tiles is a separate band of every canvas.
    let mut bands: Vec<Vec<&mut [Vec4]>> = (0..tiles.rows).map(|_| Vec::new()).collect();
    for canvas in &mut canvases {
        for (band, pixels) in bands.iter_mut().zip(canvas.pixels.chunks_mut(width * TILE)) {
            band.push(pixels);
        }
    }
    let rows_done = Mutex::new(0);
    let draw = |tile: &mut Tile<'a>, (row, mut band): (usize, Vec<&mut [Vec4]>)| {
        for column in 0..tiles.columns {
            let index = row * tiles.columns + column;
            let mut before = Instant::now();
            let mut spend = |on: usize| {
                let now = Instant::now();
                spent[on].fetch_add((now - before).as_nanos() as u64, Ordering::Relaxed);
                before = now;
            };
            tile.draw(triangles, &lists[index], tiles.origin(index));
            spend(0);
            for (number, (shader, pixels)) in shaders.iter().zip(&mut band).enumerate() {
                for (y, line) in pixels.chunks_mut(width).enumerate() {
                    let end = width.min((column + 1) * TILE);
                    tile.resolve(triangles, shader, y, &mut line[column * TILE..end]);
                }
                spend(1 + number);
            }
        }
        // The lock keeps the reports of all threads in order.
        let mut done = rows_done.lock().unwrap_or_else(PoisonError::into_inner);
        *done += 1;
        progress.tell("bake", f64::from(*done) / tiles.rows as f64)
    };
    bands.into_par_iter().enumerate().try_for_each_init(|| Tile::new(samples), draw)?;
    let spent: Vec<f64> = spent.into_iter().map(|nanoseconds| nanoseconds.into_inner() as f64).collect();
    let share = started.elapsed().as_secs_f64() / spent.iter().sum::<f64>().max(1.0);
    Ok((canvases, spent[1..].iter().map(|each| each * share).collect()))
}

/// Marks a sample without a visible triangle.
const NOTHING: u32 = u32::MAX;

/// The samples of one tile, row by row: visible fragment and depth.
struct Tile<'a> {
    samples: usize,
    /// Parts along each side of a pixel that are shaded separately.
    parts: usize,
    /// Width of the texture filter, as a multiple of the distance between samples.
    filter: f32,
    /// Samples in a row.
    side: usize,
    depths: Depths,
    /// Indices into `drawn`.
    seen: Vec<u32>,
    drawn: Vec<Fragment<'a>>,
    pieces: Vec<PixelPiece>,
}

/// The visible samples of a triangle in a part of a pixel.
struct PixelPiece {
    /// Index of the pixel in the tile, row by row; pieces are in the order of their pixels.
    pixel: usize,
    /// Index of the part in the pixel.
    part: usize,
    /// Index into `drawn`.
    fragment: u32,
    /// Number of samples.
    count: u32,
    /// Sum of the sample positions, in samples.
    places: Vec2,
}

impl PixelPiece {
    /// Returns the mean of its sample positions.
    fn middle(&self) -> Vec2 {
        self.places / self.count as f32
    }
}

/// A triangle with visible samples in a tile.
struct Fragment<'a> {
    index: u32,
    edges: Edges,
    surface: Surface<'a>,
}

impl<'a> Tile<'a> {
    fn new(Samples { side: samples, parts, filter }: Samples) -> Self {
        let side = TILE * samples;
        Self {
            samples,
            parts,
            filter,
            side,
            depths: Depths::new(side),
            seen: vec![NOTHING; side * side],
            drawn: Vec::new(),
            pieces: Vec::new(),
        }
    }

    fn draw(&mut self, triangles: &[ScreenTriangle<'a>], list: &[u32], origin: Vec2) {
        self.pieces.clear();
        if list.is_empty() {
            return;
        }
        self.clear();
        self.add_all(triangles, list, origin);
        self.gather_all();
    }

    fn clear(&mut self) {
        self.depths.clear();
        self.seen.fill(NOTHING);
        self.drawn.clear();
        self.pieces.clear();
    }

    fn add_all(&mut self, triangles: &[ScreenTriangle<'a>], list: &[u32], origin: Vec2) {
        for &index in list {
            self.add(&triangles[index as usize], index, origin);
        }
    }

    fn gather_all(&mut self) {
        if self.drawn.is_empty() {
            return;
        }
        for pixel in 0..TILE * TILE {
            self.gather(pixel);
        }
    }

    /// Adds the pieces of one pixel.
    fn gather(&mut self, pixel: usize) {
        let first = self.pieces.len();
        let (left, top) = (pixel % TILE * self.samples, pixel / TILE * self.samples);
        for y in top..top + self.samples {
            for (x, &fragment) in (left..).zip(&self.seen[y * self.side + left..][..self.samples]) {
                if fragment == NOTHING {
                    continue;
                }
                let place = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let part = (y - top) * self.parts / self.samples * self.parts + (x - left) * self.parts / self.samples;
                let known = |piece: &&mut PixelPiece| (piece.fragment, piece.part) == (fragment, part);
                match self.pieces[first..].iter_mut().rev().find(known) {
                    Some(piece) => (piece.count, piece.places) = (piece.count + 1, piece.places + place),
                    None => self.pieces.push(PixelPiece { pixel, part, fragment, count: 1, places: place }),
                }
            }
        }
    }

    /// Fills a row of pixels, empty before, with the shaded visible pieces.
    fn resolve(&self, triangles: &[ScreenTriangle], shader: &impl Shader, row: usize, pixels: &mut [Vec4]) {
        let first = self.pieces.partition_point(|piece| piece.pixel < row * TILE);
        let last = self.pieces.partition_point(|piece| piece.pixel < (row + 1) * TILE);
        let pieces = &self.pieces[first..last];
        let shade = |piece: &PixelPiece, place: Vec2| {
            let fragment = &self.drawn[piece.fragment as usize];
            let triangle = &triangles[fragment.index as usize];
            let weights = fragment.edges.weights(place);
            let spot = Spot { weights, samples: piece.count as f32 };
            shader.shade(&Seen { surface: &fragment.surface, triangle, spot, front: fragment.edges.front }).extend(1.0)
        };
        if shader.averages() {
            // The mean of sample positions in a triangle lies in the triangle.
            self.average(pieces, |piece| shade(piece, piece.middle()), pixels);
        } else {
            choose(pieces, |piece| shade(piece, self.place_nearest_middle(piece)), pixels);
        }
    }

    /// Returns the sample of a piece nearest to its middle: the triangle is visible there, but not always in the exact middle.
    fn place_nearest_middle(&self, piece: &PixelPiece) -> Vec2 {
        let middle = piece.middle();
        let (left, top) = (piece.pixel % TILE * self.samples, piece.pixel / TILE * self.samples);
        let places = (0..self.samples * self.samples).map(|i| (left + i % self.samples, top + i / self.samples));
        let own = places.filter(|(x, y)| self.seen[y * self.side + x] == piece.fragment);
        let centres = own.map(|(x, y)| Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
        centres.min_by(|a, b| a.distance_squared(middle).total_cmp(&b.distance_squared(middle))).unwrap_or(middle)
    }

    /// Adds the mean over the samples to each pixel.
    fn average(&self, pieces: &[PixelPiece], shade: impl Fn(&PixelPiece) -> Vec4, pixels: &mut [Vec4]) {
        for piece in pieces {
            // Triangles that reach beyond the canvas are drawn on whole tiles.
            let Some(pixel) = pixels.get_mut(piece.pixel % TILE) else { continue };
            *pixel += shade(piece) * piece.count as f32;
        }
        // Dividing at the end gives exact shares: full coverage is 1.
        let count = (self.samples * self.samples) as f32;
        for pixel in pixels {
            *pixel /= count;
        }
    }
}

/// Sets each pixel to the value of its piece with the most samples; among equals, the first.
fn choose(pieces: &[PixelPiece], shade: impl Fn(&PixelPiece) -> Vec4, pixels: &mut [Vec4]) {
    for of_pixel in pieces.chunk_by(|a, b| a.pixel == b.pixel) {
        let most = of_pixel.iter().reduce(|most, piece| if piece.count > most.count { piece } else { most });
        let (Some(most), Some(pixel)) = (most, pixels.get_mut(of_pixel[0].pixel % TILE)) else { continue };
        *pixel = shade(most);
    }
}
