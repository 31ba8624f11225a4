//! Compression of a level in strips, in parallel. Blocks are independent of each other, so the bytes are those of the whole.

use rayon::prelude::*;

use crate::uastc::{Picture, compressed};
use crate::{Codes, Error, GoesOn, MipLevel};

/// Rows of pixels in a strip.
const STRIP: usize = 64;

/// Returns the blocks of a level, rows from the top.
///
/// # Errors
/// A failure of the encoder; [`Error::Cancelled`] once `goes_on` returns false.
pub fn compress(level: &MipLevel, codes: Codes, goes_on: &GoesOn) -> Result<Vec<u8>, Error> {
    let strips = level.pixels.par_chunks(level.width * STRIP).map(|pixels| {
        if !goes_on() {
            return Err(Error::Cancelled);
        }
        compressed(Picture { width: level.width, height: pixels.len() / level.width, pixels }, codes)
    });
    Ok(strips.collect::<Result<Vec<_>, _>>()?.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_have_the_blocks_of_the_whole() {
        // Alpha in the lower half only; the last strip has a few rows.
        let pixel = |i: usize| [(i * 7) as u8, (i / 3) as u8, 30, if i < 72 * 72 { 255 } else { (i * 5) as u8 }];
        let pixels: Vec<[u8; 4]> = (0..72 * 144).map(pixel).collect();
        let level = MipLevel { width: 72, height: 144, pixels: &pixels };
        for codes in [Codes::Srgb, Codes::Linear] {
            let whole = compressed(Picture { width: 72, height: 144, pixels: &pixels }, codes).unwrap();
            assert_eq!(compress(&level, codes, &|| true).unwrap(), whole);
        }
    }
}
