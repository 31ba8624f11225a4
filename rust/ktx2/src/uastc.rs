//! Levels to UASTC blocks, by the reference encoder.

use basis_universal::{BasisTextureFormat, ColorSpace, Compressor, CompressorParams};

use crate::{Codes, Error, Level};

/// Bytes of a block of 4 × 4 pixels.
pub const BLOCK: usize = 16;

/// The blocks of each level, rows from the top.
///
/// # Errors
/// The encoder fails, or its file is not what its header says.
pub fn compress(levels: &[Level], codes: Codes) -> Result<Vec<Vec<u8>>, Error> {
    levels.iter().map(|level| compress_one(level, codes)).collect()
}

fn compress_one(level: &Level, codes: Codes) -> Result<Vec<u8>, Error> {
    let mut params = CompressorParams::new();
    params.set_basis_format(BasisTextureFormat::UASTC4x4);
    params.set_generate_mipmaps(false);
    params.set_color_space(match codes {
        Codes::Srgb => ColorSpace::Srgb,
        Codes::Linear => ColorSpace::Linear,
    });
    let side = |length: usize| u32::try_from(length).expect("sides were checked");
    params.source_image_mut(0).init(level.pixels.as_flattened(), side(level.width), side(level.height), 4);
    let threads = std::thread::available_parallelism().map_or(1, |n| u32::try_from(n.get()).unwrap_or(1));
    let mut compressor = Compressor::new(threads);
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
