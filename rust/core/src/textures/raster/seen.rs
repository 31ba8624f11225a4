//! Visible triangles, without shading.

use rayon::prelude::*;

use glam::Vec2;

use super::tiles::Tiles;
use super::{PixelPiece, Samples, ScreenTriangle, TILE, Tile};

/// The visible samples of a triangle in one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SeenInPixel {
    /// Index of the pixel, row by row from the top.
    pub pixel: u32,
    /// Index of the triangle.
    pub triangle: u32,
    /// Number of samples.
    pub count: u32,
}

/// Visible triangles of a picture.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SeenTriangles {
    /// By tile, then by pixel.
    pub pieces: Vec<SeenInPixel>,
    /// Number of samples that show any triangle, also one in front.
    pub covered: u64,
}

/// Draws pictures of `width` × `height` pixels. `common` triangles are in all of them, and drawn once; each item of `others` is in one.
/// Returns the visible triangles of each item, without common ones.
#[must_use]
pub fn seen_among<'a>(
    common: &[ScreenTriangle<'a>],
    others: &[Vec<ScreenTriangle<'a>>],
    width: usize,
    height: usize,
    samples: Samples,
) -> Vec<SeenTriangles> {
    let tiles = Tiles { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) };
    let common_lists = tiles.lists(common, samples);
    let lists: Vec<_> = others.iter().map(|other| tiles.lists(other, samples)).collect();
    let draw = |(behind, tile): &mut (Tile<'a>, Tile<'a>), index: usize| -> Vec<SeenTriangles> {
        let origin = tiles.origin(index);
        behind.clear();
        behind.add_all(common, &common_lists[index], origin);
        let picture = |(other, lists): (&Vec<ScreenTriangle<'a>>, &Vec<Vec<u32>>)| {
            tile.clear();
            tile.depths.copy_from(&behind.depths);
            tile.add_all(other, &lists[index], origin);
            tile.gather_all();
            tile.seen_triangles(origin, width, height)
        };
        others.iter().zip(&lists).map(picture).collect()
    };
    let pair = || (Tile::new(samples), Tile::new(samples));
    let of_tiles: Vec<_> = (0..common_lists.len()).into_par_iter().map_init(pair, draw).collect();
    let mut pictures = vec![SeenTriangles::default(); others.len()];
    for of_tile in of_tiles {
        for (picture, seen) in pictures.iter_mut().zip(of_tile) {
            picture.covered += seen.covered;
            picture.pieces.extend(seen.pieces);
        }
    }
    pictures
}

/// Returns the number of samples at which each triangle is visible on a canvas of `width` × `height` pixels.
#[must_use]
pub fn count_seen(triangles: Vec<ScreenTriangle<'_>>, width: usize, height: usize, samples: Samples) -> Vec<u32> {
    let mut counts = vec![0; triangles.len()];
    for picture in seen_among(&[], &[triangles], width, height, samples) {
        for seen in picture.pieces {
            counts[seen.triangle as usize] += seen.count;
        }
    }
    counts
}

impl Tile<'_> {
    /// Returns the visible triangles on a canvas of `width` × `height` pixels: triangles that reach beyond it are drawn on whole tiles.
    fn seen_triangles(&self, origin: Vec2, width: usize, height: usize) -> SeenTriangles {
        let (left, top) = (origin.x as usize, origin.y as usize);
        let seen = |piece: &PixelPiece| {
            let (column, row) = (left + piece.pixel % TILE, top + piece.pixel / TILE);
            let triangle = self.drawn[piece.fragment as usize].index;
            let inside = column < width && row < height;
            inside.then_some(SeenInPixel { pixel: (row * width + column) as u32, triangle, count: piece.count })
        };
        let (columns, rows) = (TILE.min(width - left) * self.samples, TILE.min(height - top) * self.samples);
        let covered = |row: &[f32]| row[..columns].iter().filter(|&&depth| depth > f32::NEG_INFINITY).count() as u64;
        SeenTriangles {
            pieces: self.pieces.iter().filter_map(seen).collect(),
            covered: self.depths.rows().take(rows).map(covered).sum(),
        }
    }
}
