//! Pictures with mip levels of their own as KTX2: Basis Universal UASTC, which GPUs of all kinds are served from, with Zstandard.
//!
//! The crate `basis-universal` compresses each level to UASTC blocks (Binomial's reference encoder); the container around them is written here,
//! by the KTX 2.0 specification of the Khronos Group, as `KHR_texture_basisu` in glTF wants it. On one machine the same pictures give the
//! same bytes; the encoder's arithmetic may differ between machines.

mod container;
mod cut_out;
mod uastc;

use thiserror::Error;

/// One level: rows from the top, straight alpha.
#[derive(Clone, Copy, Debug)]
pub struct Level<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// All pixels.
    pub pixels: &'a [[u8; 4]],
    /// Where alpha is cut out: there each pixel stays on its side of the cutoff. Of those that overlap, the last counts.
    pub cut_outs: &'a [CutOut],
}

/// Pixels of a level that are drawn where their alpha is at least `code`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CutOut {
    /// The first column.
    pub x: usize,
    /// The first row.
    pub y: usize,
    /// Columns; those beyond the level do not count.
    pub width: usize,
    /// Rows, likewise.
    pub height: usize,
    /// The least alpha that is drawn, at least 1.
    pub code: u8,
}

/// What the codes mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Codes {
    /// Colours.
    Srgb,
    /// Data.
    Linear,
}

/// Why there is no file.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum Error {
    /// The levels are no mip chain of a picture that glTF takes.
    #[error("{0}")]
    Levels(String),
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// The encoder gave up.
    #[error("the Basis Universal encoder failed: {0}")]
    Encoder(String),
}

/// The longest side that is taken.
pub const LARGEST: usize = 16_384;

/// Whether the work goes on; asked before every strip of a level, from any thread.
pub type GoesOn<'a> = dyn Fn() -> bool + Sync + 'a;

/// The file: `levels` from the largest on, each half the size of the one before (rounded down, at least 1).
///
/// # Errors
/// No levels; a first level whose sides are no multiples of 4 (glTF asks for them) or above [`LARGEST`]; another that is not half of the one
/// before, or has other than width × height pixels; a failure of the encoder; [`Error::Cancelled`] once `goes_on` is false.
pub fn encode(levels: &[Level], codes: Codes, goes_on: &GoesOn) -> Result<Vec<u8>, Error> {
    check(levels)?;
    let blocks = levels.iter().map(|level| cut_out::compress(level, codes, goes_on)).collect::<Result<Vec<_>, _>>()?;
    container::write(levels, &blocks, codes)
}

fn check(levels: &[Level]) -> Result<(), Error> {
    let refuse = |message: String| Err(Error::Levels(message));
    let Some(first) = levels.first() else { return refuse("there are no levels; give one at least".to_owned()) };
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
        return refuse(format!("there are {} levels; there can be {most}", levels.len()));
    }
    Ok(())
}
