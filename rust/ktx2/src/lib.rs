//! Writer for KTX2 textures with given mip levels, as Basis Universal UASTC with Zstandard, and reader of the largest level of others.
//! UASTC transcodes to the formats of all GPUs.
//!
//! The crate `basis-universal` (Binomial's reference encoder) compresses each level to UASTC blocks. This crate writes the container, by
//! the KTX 2.0 specification of the Khronos Group, as `KHR_texture_basisu` in glTF requires. On one machine the same pixels give the same
//! bytes; the encoder's arithmetic may differ between machines.

mod container;
mod decode;
mod strips;
mod uastc;

pub use decode::{Picture, SIGNATURE, decode};
use thiserror::Error;

/// One mip level: rows from the top, straight alpha.
#[derive(Clone, Copy, Debug)]
pub struct MipLevel<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// All pixels.
    pub pixels: &'a [[u8; 4]],
}

/// Meaning of the pixel codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Codes {
    /// Colors.
    Srgb,
    /// Data.
    Linear,
}

/// Reasons for a failure.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum Error {
    /// The levels are not a mip chain that glTF allows.
    #[error("{0}")]
    Levels(String),
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// The file cannot be decoded.
    #[error("{0}")]
    File(String),
    /// The encoder failed.
    #[error("the Basis Universal encoder failed: {0}")]
    Encoder(String),
}

/// Longest side in pixels.
pub const LARGEST: usize = 16_384;

/// Callback that returns false to cancel the work. Called before every strip of a level, from any thread.
pub type GoesOn<'a> = dyn Fn() -> bool + Sync + 'a;

/// Returns the bytes of a KTX2 file with these levels, largest first, each half the size of the one before (rounded down, at least 1).
///
/// # Errors
/// No levels; a side of the first level that is above [`LARGEST`] or no multiple of 4 (glTF requires that); a level that is not half the
/// size of the one before or does not have width × height pixels; too many levels; a failure of the encoder; [`Error::Cancelled`] once
/// `goes_on` returns false.
pub fn encode(levels: &[MipLevel], codes: Codes, goes_on: &GoesOn) -> Result<Vec<u8>, Error> {
    check(levels)?;
    let blocks = levels.iter().map(|level| strips::compress(level, codes, goes_on)).collect::<Result<Vec<_>, _>>()?;
    container::write(levels, &blocks, codes)
}

fn check(levels: &[MipLevel]) -> Result<(), Error> {
    let refuse = |message: String| Err(Error::Levels(message));
    let Some(first) = levels.first() else { return refuse("there are no levels; give at least one".to_owned()) };
    let side = |length: usize| (4..=LARGEST).contains(&length) && length.is_multiple_of(4);
    if !side(first.width) || !side(first.height) {
        return refuse(format!(
            "the first level has {} × {} pixels; both sides must be multiples of 4 up to {LARGEST}",
            first.width, first.height
        ));
    }
    for (number, level) in levels.iter().enumerate() {
        let expected = ((first.width >> number).max(1), (first.height >> number).max(1));
        if (level.width, level.height) != expected || level.pixels.len() != level.width * level.height {
            return refuse(format!(
                "level {number} has {} × {} pixels with data for {}; it must have {} × {}",
                level.width,
                level.height,
                level.pixels.len(),
                expected.0,
                expected.1
            ));
        }
    }
    let most = first.width.max(first.height).ilog2() as usize + 1;
    if levels.len() > most {
        return refuse(format!("there are {} levels; the limit for this size is {most}", levels.len()));
    }
    Ok(())
}
