//! Conversion of pictures to UASTC blocks, by the reference encoder.
//!
//! The encoder's own thread pool sometimes hangs: it signals the stop without the lock that its threads wait with, so a thread may miss it,
//! most likely on levels so small that the thread has hardly started. So each encoder uses one thread here.

use basis_universal::{BasisTextureFormat, ColorSpace, Compressor, CompressorParams};

use crate::{Codes, Error};

/// Bytes of a block of 4 × 4 pixels.
const BLOCK: usize = 16;

/// A picture: rows from the top.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    pub width: usize,
    pub height: usize,
    pub pixels: &'a [[u8; 4]],
}

/// Returns the blocks of a picture, rows from the top.
///
/// # Errors
/// The encoder fails.
pub fn compressed(picture: Picture, codes: Codes) -> Result<Vec<u8>, Error> {
    let mut params = CompressorParams::new();
    params.set_basis_format(BasisTextureFormat::UASTC4x4);
    params.set_generate_mipmaps(false);
    params.set_color_space(match codes {
        Codes::Srgb => ColorSpace::Srgb,
        Codes::Linear => ColorSpace::Linear,
    });
    let side = |length: usize| u32::try_from(length).expect("sides were checked");
    params.source_image_mut(0).init(picture.pixels.as_flattened(), side(picture.width), side(picture.height), 4);
    let mut compressor = Compressor::new(1);
    // SAFETY: the parameters are the wrapper's defaults, and the size of the picture was checked against its data. So the cases that the
    // encoder does not validate (an unset quality level, a picture of the wrong size) cannot occur.
    #[allow(unsafe_code)]
    let accepted = unsafe { compressor.init(&params) };
    if !accepted {
        return Err(Error::Encoder("it refused its parameters".to_owned()));
    }
    // SAFETY: as above; the compressor is initialized and only this thread uses it.
    #[allow(unsafe_code)]
    let done = unsafe { compressor.process() };
    done.map_err(|code| Error::Encoder(format!("{code:?}")))?;
    let blocks = picture.width.div_ceil(4) * picture.height.div_ceil(4);
    let found = only_slice(compressor.basis_file()).filter(|found| found.len() == blocks * BLOCK);
    Ok(found.ok_or_else(|| Error::Encoder("its file is cut short".to_owned()))?.to_vec())
}

/// Returns the data of the first slice of a .basis file. Byte 65 of the file header holds the offset of the slice descriptions; a
/// description holds the offset of its data at byte 13 and their size at byte 17.
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
    fn tiny_pictures_come_to_an_end() {
        let picture = Picture { width: 4, height: 4, pixels: &[[40, 120, 30, 255]; 16] };
        for _ in 0..3000 {
            compressed(picture, Codes::Srgb).unwrap();
        }
    }
}
