//! Compression of levels that keeps every pixel on its side of the alpha cutoff.
//!
//! A block keeps alpha to within a few codes, or some dozens if color and alpha vary differently. Mip levels that keep their coverage have
//! most edge texels right beside the cutoff, and compression could move them across it (or draw a quarter more than before). So alpha is
//! first moved a few codes away from the cutoff. Then the compressed blocks are decoded. Blocks in which a pixel changed sides are
//! compressed again with alpha farther away, up to 0 and 255, and finally with fewer color differences, down to one color for the block.
//!
//! Strips of a level are compressed in parallel.

use rayon::prelude::*;

use crate::uastc::{self, BLOCK, Picture};
use crate::{Codes, CutOut, Error, GoesOn, MipLevel};

/// Rows of pixels in a strip.
const STRIP: usize = 64;

/// Distance of alpha from the cutoff in codes: `MARGIN` for all pixels, then, for each round on the remaining blocks, the distance and the
/// share by which colors move to their mean.
const MARGIN: u8 = 6;
const ROUNDS: [(u8, f32); 6] = [(16, 0.0), (48, 0.0), (255, 0.0), (255, 0.5), (255, 0.75), (255, 1.0)];

/// Distance in codes that decoded alpha must keep from the cutoff, because transcoding to a GPU's format may still change a code.
const SAFE: u8 = 2;

/// Blocks in a row of the picture that collects blocks for another round.
const COLUMNS: usize = 64;

/// Returns the blocks of a level, rows from the top.
///
/// # Errors
/// A failure of the encoder; [`Error::Cancelled`] once `goes_on` returns false.
pub fn compress(level: &MipLevel, codes: Codes, goes_on: &GoesOn) -> Result<Vec<u8>, Error> {
    let cutoffs = cutoffs(level);
    let strips = level.pixels.par_chunks(level.width * STRIP).zip(cutoffs.par_chunks(level.width * STRIP));
    let strips = strips.map(|(pixels, cutoffs)| {
        if !goes_on() {
            return Err(Error::Cancelled);
        }
        Strip { width: level.width, pixels, cutoffs }.compress(codes)
    });
    Ok(strips.collect::<Result<Vec<_>, _>>()?.concat())
}

/// Returns the cutoff of each pixel; 0 if nothing is cut out there.
fn cutoffs(level: &MipLevel) -> Vec<u8> {
    let mut cutoffs = vec![0; level.pixels.len()];
    for &CutOut { x, y, width, height, code } in level.cut_outs {
        let columns = x.min(level.width)..(x + width).min(level.width);
        for row in cutoffs.chunks_mut(level.width).skip(y).take(height) {
            row[columns.clone()].fill(code);
        }
    }
    cutoffs
}

/// Some rows of a level.
struct Strip<'a> {
    width: usize,
    pixels: &'a [[u8; 4]],
    cutoffs: &'a [u8],
}

impl Strip<'_> {
    fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    fn compress(&self, codes: Codes) -> Result<Vec<u8>, Error> {
        let (width, height) = (self.width, self.height());
        if self.cutoffs.iter().all(|&cutoff| cutoff == 0) {
            return Ok(uastc::compress(Picture { width, height, pixels: self.pixels }, codes)?.blocks()?.to_vec());
        }
        let apart: Vec<[u8; 4]> = (0..self.pixels.len()).map(|i| self.apart(i, MARGIN)).collect();
        let compressed = uastc::compress(Picture { width, height, pixels: &apart }, codes)?;
        let (mut blocks, shown) = (compressed.blocks()?.to_vec(), compressed.seen()?);
        let changed = |block: &usize| self.places(*block).any(|i| self.changes_sides(i, shown[i][3]));
        let mut wrong: Vec<usize> = (0..blocks.len() / BLOCK).filter(changed).collect();
        for round in ROUNDS {
            if wrong.is_empty() {
                break;
            }
            wrong = self.again(&wrong, round, codes, &mut blocks)?;
        }
        Ok(blocks)
    }

    /// Compresses some blocks again; returns those that are still wrong.
    fn again(&self, wrong: &[usize], round: (u8, f32), codes: Codes, blocks: &mut [u8]) -> Result<Vec<usize>, Error> {
        let columns = wrong.len().min(COLUMNS);
        let (width, height) = (4 * columns, 4 * wrong.len().div_ceil(columns));
        let mut pixels = vec![[0; 4]; width * height];
        let at = |number: usize, i: usize| (number / columns * 4 + i / 4) * width + number % columns * 4 + i % 4;
        for (number, &block) in wrong.iter().enumerate() {
            self.easier(block, round).iter().enumerate().for_each(|(i, pixel)| pixels[at(number, i)] = *pixel);
        }
        let compressed = uastc::compress(Picture { width, height, pixels: &pixels }, codes)?;
        let (anew, shown) = (compressed.blocks()?, compressed.seen()?);
        let mut left = Vec::new();
        for (number, &block) in wrong.iter().enumerate() {
            blocks[block * BLOCK..][..BLOCK].copy_from_slice(&anew[number * BLOCK..][..BLOCK]);
            if self.places(block).enumerate().any(|(i, place)| self.changes_sides(place, shown[at(number, i)][3])) {
                left.push(block);
            }
        }
        Ok(left)
    }

    /// Returns the pixels of a block with alpha at least `margin` away from the cutoff and colors moved to their mean by `share`.
    fn easier(&self, block: usize, (margin, share): (u8, f32)) -> [[u8; 4]; 16] {
        let mut pixels = [[0; 4]; 16];
        self.places(block).zip(&mut pixels).for_each(|(place, pixel)| *pixel = self.apart(place, margin));
        // Weight colors by alpha; if alpha is 0 everywhere, all pixels count alike.
        let weight = |pixel: &[u8; 4]| f32::from(pixel[3]) + 1e-3;
        let whole: f32 = pixels.iter().map(weight).sum();
        for channel in 0..3 {
            let mean = pixels.iter().map(|p| weight(p) * f32::from(p[channel])).sum::<f32>() / whole;
            for pixel in &mut pixels {
                let code = f32::from(pixel[channel]);
                pixel[channel] = (code + share * (mean - code)).round() as u8;
            }
        }
        pixels
    }

    /// Returns the indices of the 16 pixels of a block; pixels on the strip's last row and column repeat beyond it.
    fn places(&self, block: usize) -> impl Iterator<Item = usize> {
        let (width, height, columns) = (self.width, self.height(), self.width.div_ceil(4));
        let (x, y) = (block % columns * 4, block / columns * 4);
        (0..16).map(move |i| (y + i / 4).min(height - 1) * width + (x + i % 4).min(width - 1))
    }

    /// Returns a pixel with alpha at least `margin` away from its cutoff.
    fn apart(&self, i: usize, margin: u8) -> [u8; 4] {
        let ([r, g, b, alpha], cutoff) = (self.pixels[i], self.cutoffs[i]);
        let apart = match cutoff {
            0 => alpha,
            _ if alpha >= cutoff => alpha.max(cutoff.saturating_add(margin)),
            _ => alpha.min((cutoff - 1).saturating_sub(margin)),
        };
        [r, g, b, apart]
    }

    fn changes_sides(&self, i: usize, shown: u8) -> bool {
        match self.cutoffs[i] {
            0 => false,
            cutoff if self.pixels[i][3] >= cutoff => shown < cutoff.saturating_add(SAFE),
            cutoff => shown > (cutoff - 1).saturating_sub(SAFE),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_have_the_blocks_of_the_whole() {
        // Alpha in the lower half only; the last strip has a few rows.
        let pixel = |i: usize| [(i * 7) as u8, (i / 3) as u8, 30, if i < 72 * 72 { 255 } else { (i * 5) as u8 }];
        let pixels: Vec<[u8; 4]> = (0..72 * 144).map(pixel).collect();
        let level = MipLevel { width: 72, height: 144, pixels: &pixels, cut_outs: &[] };
        for codes in [Codes::Srgb, Codes::Linear] {
            let whole = uastc::compress(Picture { width: 72, height: 144, pixels: &pixels }, codes).unwrap();
            assert_eq!(compress(&level, codes, &|| true).unwrap(), whole.blocks().unwrap());
        }
    }
}
