//! Reader of KTX2 textures of Basis Universal (UASTC and ETC1S), by the crate `basisu`, a port of Binomial's transcoder to Rust.
//!
//! The crate allocates what the header claims. So claims that glTF's `KHR_texture_basisu` does not allow, or that are larger than the file
//! and its picture can be, are refused before (the KTX 2.0 specification, section 3).

use basisu::{DecodeFlags, SourceFormat, TargetFormat, Transcoder};

use crate::{Error, LARGEST};

/// The first bytes of a KTX2 file.
pub const SIGNATURE: [u8; 12] = *b"\xABKTX 20\xBB\r\n\x1A\n";

/// A picture: rows from the top, straight alpha. Pixels have the codes of the file: sRGB for colors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// All pixels.
    pub pixels: Vec<[u8; 4]>,
}

/// Returns the largest level of a KTX2 file.
///
/// # Errors
/// A file that is no KTX2 texture of Basis Universal as glTF allows it, is broken, or has a side above [`LARGEST`].
pub fn decode(file: &[u8]) -> Result<Picture, Error> {
    let refuse = |reason: String| Error::File(format!("{reason}; export it as PNG"));
    let (width, height) = checked_size(file).map_err(refuse)?;
    let texture = Transcoder::new(file).map_err(|_| refuse("it is no KTX2 texture of Basis Universal".to_owned()))?;
    if !matches!(texture.source_format(), SourceFormat::Etc1s | SourceFormat::UastcLdr) {
        return Err(refuse("its pixels are neither ETC1S nor UASTC".to_owned()));
    }
    let bytes = texture
        .transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE)
        .map_err(|error| refuse(format!("its pixels cannot be decoded ({error:?})")))?;
    Ok(Picture { width, height, pixels: bytes.as_chunks().0.to_vec() })
}

/// Returns width and height from the header, once the header claims no more than the file and the picture can hold.
fn checked_size(file: &[u8]) -> Result<(usize, usize), String> {
    let word = |at: usize| file.get(at..at + 4)?.try_into().ok().map(|four| u32::from_le_bytes(four) as usize);
    let long = |at: usize| file.get(at..at + 8)?.try_into().ok().map(u64::from_le_bytes);
    let (words, longs) = ([20, 24, 32, 36, 40].map(word), [64, 72, 80, 88, 96].map(long));
    let [Some(width), Some(height), Some(layers), Some(faces), Some(levels)] = words else {
        return Err("it ends within its header".to_owned());
    };
    let [Some(shared), Some(shared_bytes), Some(start), Some(bytes), Some(unpacked)] = longs else {
        return Err("it ends within its header".to_owned());
    };
    if !(1..=LARGEST).contains(&width) || !(1..=LARGEST).contains(&height) {
        return Err(format!("it has {width} × {height} pixels, and the limit is {LARGEST} on a side"));
    }
    if layers > 1 || faces != 1 || levels > LARGEST.ilog2() as usize + 1 {
        return Err(format!("it has {layers} layers, {faces} faces and {levels} levels, but must be one picture"));
    }
    let size = file.len() as u64;
    let inside = |start: u64, bytes: u64| start.checked_add(bytes).is_some_and(|end| end <= size);
    // A block of 4 × 4 pixels has 16 bytes.
    let most = 16 * width.div_ceil(4) as u64 * height.div_ceil(4) as u64;
    if !inside(shared, shared_bytes) || !inside(start, bytes) || unpacked > most {
        return Err("its header claims more bytes than there are".to_owned());
    }
    Ok((width, height))
}
