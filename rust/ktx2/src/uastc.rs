//! Levels to UASTC blocks, by the reference encoder.
//!
//! A block knows nothing of its neighbours, so strips of a level are compressed beside each other, each by an encoder of one thread. The encoder's
//! own pool of threads sometimes never ends: it is told to stop without the lock that its threads wait with, so that one of them
//! may miss it, most likely at levels so small that it has hardly begun.

use basis_universal::{BasisTextureFormat, ColorSpace, Compressor, CompressorParams};
use rayon::prelude::*;

use crate::{Codes, Error, Level};

/// Bytes of a block of 4 × 4 pixels.
pub const BLOCK: usize = 16;

/// Rows of pixels in a strip.
const STRIP: usize = 64;

/// The blocks of each level, rows from the top.
///
/// # Errors
/// The encoder fails, or its file is not what its header says.
pub fn compress(levels: &[Level], codes: Codes) -> Result<Vec<Vec<u8>>, Error> {
    let of_level = |level: &Level| {
        let strips: Vec<Vec<u8>> =
            strips(level).map(|strip| compress_strip(&strip, codes)).collect::<Result<_, _>>()?;
        Ok(strips.concat())
    };
    levels.iter().map(of_level).collect()
}

fn strips<'a>(level: &Level<'a>) -> impl IndexedParallelIterator<Item = Level<'a>> {
    let width = level.width;
    let strip = move |pixels: &'a [[u8; 4]]| Level { width, height: pixels.len() / width, pixels };
    level.pixels.par_chunks(width * STRIP).map(strip)
}

fn compress_strip(level: &Level, codes: Codes) -> Result<Vec<u8>, Error> {
    let mut params = CompressorParams::new();
    params.set_basis_format(BasisTextureFormat::UASTC4x4);
    params.set_generate_mipmaps(false);
    params.set_color_space(match codes {
        Codes::Srgb => ColorSpace::Srgb,
        Codes::Linear => ColorSpace::Linear,
    });
    let side = |length: usize| u32::try_from(length).expect("sides were checked");
    params.source_image_mut(0).init(level.pixels.as_flattened(), side(level.width), side(level.height), 4);
    let mut compressor = Compressor::new(1);
    // SAFETY: the parameters are the wrapper's defaults and a picture whose size was checked against its data: what the encoder does not validate
    // (an unset quality level, pictures of other sizes than they say) cannot occur.
    #[allow(unsafe_code)]
    let accepted = unsafe { compressor.init(&params) };
    if !accepted {
        return Err(Error::Encoder("it refused its parameters".to_owned()));
    }
    // SAFETY: as above; it was initialised, and is used by this thread alone.
    #[allow(unsafe_code)]
    let done = unsafe { compressor.process() };
    done.map_err(|code| Error::Encoder(format!("{code:?}")))?;
    let count = level.width.div_ceil(4) * level.height.div_ceil(4);
    let blocks = only_slice(compressor.basis_file()).filter(|blocks| blocks.len() == count * BLOCK);
    blocks.map(<[u8]>::to_vec).ok_or_else(|| Error::Encoder("its file is cut short".to_owned()))
}

/// The data of the first slice of a .basis file: its header says at byte 65 where the slices are described; a description has the place of the
/// data at byte 13 and its size at byte 17.
fn only_slice(file: &[u8]) -> Option<&[u8]> {
    let number = |at: usize| {
        let bytes = file.get(at..at.checked_add(4)?)?;
        usize::try_from(u32::from_le_bytes(bytes.try_into().ok()?)).ok()
    };
    let description = number(65)?;
    let (start, size) = (number(description.checked_add(13)?)?, number(description.checked_add(17)?)?);
    file.get(start..start.checked_add(size)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_have_the_blocks_of_the_whole() {
        // Alpha in the lower half only, a last strip of a few rows.
        let pixel = |i: usize| [(i * 7) as u8, (i / 3) as u8, 30, if i < 72 * 72 { 255 } else { (i * 5) as u8 }];
        let pixels: Vec<[u8; 4]> = (0..72 * 144).map(pixel).collect();
        let level = Level { width: 72, height: 144, pixels: &pixels };
        for codes in [Codes::Srgb, Codes::Linear] {
            assert_eq!(compress(&[level], codes).unwrap(), [compress_strip(&level, codes).unwrap()]);
        }
    }

    #[test]
    fn tiny_pictures_come_to_an_end() {
        let level = Level { width: 4, height: 4, pixels: &[[40, 120, 30, 255]; 16] };
        for _ in 0..3000 {
            compress(&[level], Codes::Srgb).unwrap();
        }
    }
}
