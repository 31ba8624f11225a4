//! The depth buffer of a tile, with the farthest depth of each of its cells. A triangle behind that depth is hidden in the whole cell.

use std::ops::Range;

use crate::foliage::BLOCK;

/// Depths of the samples of a tile, toward the viewer; −∞ where nothing is drawn.
pub(super) struct Depths {
    /// Samples in a row, a multiple of [`BLOCK`].
    side: usize,
    samples: Vec<f32>,
    /// The farthest depth in each cell of [`BLOCK`] × [`BLOCK`] samples, row by row.
    farthest: Vec<f32>,
}

impl Depths {
    /// Returns the buffer of a tile with `side` samples along each side.
    pub fn new(side: usize) -> Self {
        let cells = side / BLOCK;
        let nothing = |count: usize| vec![f32::NEG_INFINITY; count];
        Self { side, samples: nothing(side * side), farthest: nothing(cells * cells) }
    }

    pub fn clear(&mut self) {
        self.samples.fill(f32::NEG_INFINITY);
        self.farthest.fill(f32::NEG_INFINITY);
    }

    pub fn copy_from(&mut self, other: &Self) {
        self.samples.copy_from_slice(&other.samples);
        self.farthest.copy_from_slice(&other.farthest);
    }

    /// Returns the depth of a sample.
    pub fn get(&self, sample: usize) -> f32 {
        self.samples[sample]
    }

    /// Returns the depths of `count` samples of a row, and ∞ after them.
    pub fn run(&self, first: usize, count: usize) -> [f32; BLOCK] {
        let mut run = [f32::INFINITY; BLOCK];
        run[..count].copy_from_slice(&self.samples[first..first + count]);
        run
    }

    /// Sets the depth of a sample. The cells still have their old depths; see [`Self::note`].
    pub fn set(&mut self, sample: usize, depth: f32) {
        self.samples[sample] = depth;
    }

    /// Returns the depths of the samples, row by row.
    pub fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.samples.chunks(self.side)
    }

    /// Returns whether all samples of a rectangle, which is not empty, show something nearer than `depth`.
    pub fn hide(&self, columns: &Range<usize>, rows: &Range<usize>, depth: f32) -> bool {
        let row = |row: usize| &self.farthest[row * (self.side / BLOCK)..][cells(columns)];
        cells(rows).all(|y| row(y).iter().all(|&farthest| depth < farthest))
    }

    /// Updates the cells that a rectangle touches.
    pub fn note(&mut self, columns: &Range<usize>, rows: &Range<usize>) {
        for y in cells(rows) {
            for x in cells(columns) {
                let of_row = |row: usize| &self.samples[(y * BLOCK + row) * self.side + x * BLOCK..][..BLOCK];
                let mut farthest = [f32::INFINITY; BLOCK];
                for row in 0..BLOCK {
                    for (farthest, &depth) in farthest.iter_mut().zip(of_row(row)) {
                        // `min` takes three instructions for the sake of NaN, which no depth is.
                        *farthest = if depth < *farthest { depth } else { *farthest };
                    }
                }
                let farthest = farthest.into_iter().fold(f32::INFINITY, f32::min);
                self.farthest[y * (self.side / BLOCK) + x] = farthest;
            }
        }
    }
}

/// Returns the cells that samples along one axis touch.
fn cells(samples: &Range<usize>) -> Range<usize> {
    samples.start / BLOCK..samples.end.div_ceil(BLOCK)
}
