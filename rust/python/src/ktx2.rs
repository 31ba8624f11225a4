//! A level's textures as KTX2 files.

use leafcloud::atlas::Region;
use leafcloud::lod::{Level, Mip};
use leafcloud::{Error, Progress};
use leafcloud_ktx2::{Codes, CutOut, encode};

/// Returns the KTX2 file of a channel with its mips.
///
/// # Errors
/// The level lacks this channel, or the channel has no mips; glTF does not allow the page's size; the encoder fails;
/// [`Error::Cancelled`].
pub fn file_of(level: &Level, channel: &str, halvings: usize, progress: Progress) -> Result<Vec<u8>, Error> {
    let levels = level.mips(channel, halvings).ok_or_else(|| no_mips(level, channel))?;
    let codes = if matches!(channel, "base_color" | "translucency") { Codes::Srgb } else { Codes::Linear };
    let cut_outs: Vec<Vec<CutOut>> = levels.iter().map(|mip| mip.cut_outs.iter().map(cut_out).collect()).collect();
    let mips = levels.iter().zip(&cut_outs).map(|(Mip { image, .. }, cut_outs)| leafcloud_ktx2::MipLevel {
        width: image.width(),
        height: image.height(),
        pixels: image.pixels(),
        cut_outs,
    });
    encode(&mips.collect::<Vec<_>>(), codes, &|| progress.tell("ktx2", 0.0).is_ok()).map_err(|error| match error {
        leafcloud_ktx2::Error::Cancelled => Error::Cancelled,
        other => Error::invalid(other.to_string()),
    })
}

/// Returns the error for a channel that the level lacks, or that has no mip levels.
pub fn no_mips(level: &Level, channel: &str) -> Error {
    let known = level.page.images().map(|(name, _)| name).filter(|name| !name.starts_with("leaf_"));
    let known: Vec<&str> = known.collect();
    Error::invalid(format!("the level has no channel {channel:?} with mips; it has {}", known.join(", ")))
}

fn cut_out(&(region, code): &(Region, u8)) -> CutOut {
    let Region { x, y, width, height } = region;
    CutOut { x, y, width, height, code }
}
