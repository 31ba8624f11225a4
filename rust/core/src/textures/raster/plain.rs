//! Pictures without shading: coverage and depth.

use rayon::prelude::*;

use super::tiles::Tiles;
use super::{Samples, ScreenTriangle, TILE, Tile};

/// Returns the number of samples of each pixel that show any triangle, row by row. Triangles are drawn whatever their reach.
///
/// Which one a sample shows does not matter, so each hides those after it: blocks of samples that are covered are skipped.
#[must_use]
pub fn count_covered(
    mut triangles: Vec<ScreenTriangle<'_>>,
    width: usize,
    height: usize,
    samples: Samples,
) -> Vec<u32> {
    for (index, triangle) in triangles.iter_mut().enumerate() {
        triangle.reach = f32::INFINITY;
        triangle.corners.iter_mut().for_each(|corner| corner.z = -(index as f32));
    }
    picture(&triangles, width, height, samples, Tile::covered)
}

/// Returns the depth nearest to the viewer in the middle of each pixel, row by row; −∞ where nothing is drawn.
///
/// # Panics
/// Never: one sample is allowed.
#[must_use]
pub fn depths(triangles: &[ScreenTriangle<'_>], width: usize, height: usize) -> Vec<f32> {
    let one = Samples::new(1).expect("one sample is allowed");
    picture(triangles, width, height, one, |tile| tile.depths.rows().flatten().copied().collect())
}

/// Draws triangles, and reads a value for each pixel of a tile.
fn picture<'a, T: Copy + Send + Sync>(
    triangles: &[ScreenTriangle<'a>],
    width: usize,
    height: usize,
    samples: Samples,
    read: impl Fn(&Tile<'a>) -> Vec<T> + Sync,
) -> Vec<T> {
    let tiles = Tiles { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) };
    let lists = tiles.lists(triangles, samples);
    let draw = |tile: &mut Tile<'a>, index: usize| {
        tile.clear();
        tile.add_all(triangles, &lists[index], tiles.origin(index));
        read(tile)
    };
    let of_tiles: Vec<Vec<T>> = (0..lists.len()).into_par_iter().map_init(|| Tile::new(samples), draw).collect();
    let of_pixel = |(x, y): (usize, usize)| of_tiles[y / TILE * tiles.columns + x / TILE][y % TILE * TILE + x % TILE];
    (0..width * height).map(|i| of_pixel((i % width, i / width))).collect()
}

impl Tile<'_> {
    /// Returns the number of samples of each pixel that show a triangle, row by row.
    fn covered(&self) -> Vec<u32> {
        let mut counts = vec![0; TILE * TILE];
        for (y, row) in self.depths.rows().enumerate() {
            let counts = &mut counts[y / self.samples * TILE..][..TILE];
            for (count, of_pixel) in counts.iter_mut().zip(row.chunks(self.samples)) {
                *count += of_pixel.iter().map(|&depth| u32::from(depth > f32::NEG_INFINITY)).sum::<u32>();
            }
        }
        counts
    }
}
