//! Levels to blocks in which what is cut out stays cut out.
//!
//! A block keeps alpha to some codes, to some dozens where colours and alpha go different ways; mip levels that keep their coverage have
//! most texels of an edge right beside the cutoff, and would lose it (or a quarter more than there is would pass). So alpha keeps away from
//! the cutoff by a few codes, what was compressed is looked at, and blocks in which a pixel changed sides are compressed again with their
//! alpha farther away, up to full and nothing, and in the end with colours that differ less, down to one for the block.
//!
//! Strips of a level are compressed beside each other.

use rayon::prelude::*;

use crate::uastc::{self, BLOCK, Picture};
use crate::{Codes, CutOut, Error, GoesOn, Level};

/// Rows of pixels in a strip.
const STRIP: usize = 64;

/// How far alpha keeps from the cutoff: all of it, then that of blocks that need more, and how much of their colours is their mean.
const MARGIN: u8 = 6;
const ROUNDS: [(u8, f32); 6] = [(16, 0.0), (48, 0.0), (255, 0.0), (255, 0.5), (255, 0.75), (255, 1.0)];

/// What GPUs' formats may still make of a code.
const SAFE: u8 = 2;

/// Blocks in a row of the pictures in which some are compressed again.
const COLUMNS: usize = 64;

/// The blocks of a level, rows from the top.
///
/// # Errors
/// The encoder fails, or the work does not go on.
pub fn compress(level: &Level, codes: Codes, goes_on: &GoesOn) -> Result<Vec<u8>, Error> {
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

/// Of each pixel; 0 where nothing is cut out.
fn cutoffs(level: &Level) -> Vec<u8> {
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

    /// Compresses some blocks again, and returns those that are still wrong.
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

    /// The pixels of a block with alpha so far from the cutoff, and colours that much nearer to their mean.
    fn easier(&self, block: usize, (margin, share): (u8, f32)) -> [[u8; 4]; 16] {
        let mut pixels = [[0; 4]; 16];
        self.places(block).zip(&mut pixels).for_each(|(place, pixel)| *pixel = self.apart(place, margin));
        // Of what is drawn; where nothing is, no colour counts.
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

    /// The 16 pixels of a block; the last ones again where the strip ends before.
    fn places(&self, block: usize) -> impl Iterator<Item = usize> {
        let (width, height, columns) = (self.width, self.height(), self.width.div_ceil(4));
        let (x, y) = (block % columns * 4, block / columns * 4);
        (0..16).map(move |i| (y + i / 4).min(height - 1) * width + (x + i % 4).min(width - 1))
    }

    /// A pixel whose alpha keeps away from its cutoff.
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
        // Alpha in the lower half only, a last strip of a few rows.
        let pixel = |i: usize| [(i * 7) as u8, (i / 3) as u8, 30, if i < 72 * 72 { 255 } else { (i * 5) as u8 }];
        let pixels: Vec<[u8; 4]> = (0..72 * 144).map(pixel).collect();
        let level = Level { width: 72, height: 144, pixels: &pixels, cut_outs: &[] };
        for codes in [Codes::Srgb, Codes::Linear] {
            let whole = uastc::compress(Picture { width: 72, height: 144, pixels: &pixels }, codes).unwrap();
            assert_eq!(compress(&level, codes, &|| true).unwrap(), whole.blocks().unwrap());
        }
    }
}
