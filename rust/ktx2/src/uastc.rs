//! Conversion of pictures to UASTC blocks and back, by the reference encoder and transcoder.
//!
//! The encoder's own thread pool sometimes hangs: it signals the stop without the lock that its threads wait with, so a thread may miss it,
//! most likely on levels so small that the thread has hardly started. So each encoder uses one thread here.

use basis_universal::{
    BasisTextureFormat, ColorSpace, Compressor, CompressorParams, TranscodeParameters, Transcoder,
    TranscoderTextureFormat,
};

use crate::{Codes, Error};

/// Bytes of a block of 4 × 4 pixels.
pub const BLOCK: usize = 16;

/// A picture: rows from the top.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    pub width: usize,
    pub height: usize,
    pub pixels: &'a [[u8; 4]],
}

/// A compressed picture: a .basis file.
pub struct Compressed {
    file: Vec<u8>,
    blocks: usize,
}

/// Compresses a picture; each block is independent of its neighbors.
///
/// # Errors
/// The encoder fails.
pub fn compress(picture: Picture, codes: Codes) -> Result<Compressed, Error> {
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
    Ok(Compressed { file: compressor.basis_file().to_vec(), blocks })
}

impl Compressed {
    /// Returns the blocks, rows from the top.
    ///
    /// # Errors
    /// The encoder's file does not match its header.
    pub fn blocks(&self) -> Result<&[u8], Error> {
        let blocks = only_slice(&self.file).filter(|blocks| blocks.len() == self.blocks * BLOCK);
        blocks.ok_or_else(|| Error::Encoder("its file is cut short".to_owned()))
    }

    /// Returns the decoded pixels.
    ///
    /// # Errors
    /// The encoder's file cannot be read.
    pub fn seen(&self) -> Result<Vec<[u8; 4]>, Error> {
        let unread = |what: &dyn std::fmt::Debug| Error::Encoder(format!("its file cannot be read: {what:?}"));
        let mut transcoder = Transcoder::new();
        transcoder.prepare_transcoding(&self.file).map_err(|error| unread(&error))?;
        let format = TranscoderTextureFormat::RGBA32;
        let pixels = transcoder.transcode_image_level(&self.file, format, TranscodeParameters::default());
        Ok(pixels.map_err(|error| unread(&error))?.as_chunks().0.to_vec())
    }
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
            compress(picture, Codes::Srgb).unwrap();
        }
    }
}
