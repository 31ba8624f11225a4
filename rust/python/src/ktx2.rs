//! A level's textures as KTX2 files.

use leafcloud::lod::Level;
use leafcloud::textures::mips::Levels;
use leafcloud::{Error, Progress};
use leafcloud_ktx2::{Codes, MipLevel, encode};

/// Returns the KTX2 file of a channel with its mips.
///
/// # Errors
/// The level lacks this channel, or the channel has no mips; glTF does not allow the page's size; the encoder fails;
/// [`Error::Cancelled`].
pub fn file_of(level: &Level, channel: &str, progress: Progress) -> Result<Vec<u8>, Error> {
    let levels = mips(level, channel)?;
    let codes = if matches!(channel, "base_color" | "translucency") { Codes::Srgb } else { Codes::Linear };
    let mips =
        levels.iter().map(|image| MipLevel { width: image.width(), height: image.height(), pixels: image.pixels() });
    encode(&mips.collect::<Vec<_>>(), codes, &|| progress.tell("ktx2", 0.0).is_ok()).map_err(|error| match error {
        leafcloud_ktx2::Error::Cancelled => Error::Cancelled,
        other => Error::invalid(other.to_string()),
    })
}

/// Returns the mip levels of a channel.
///
/// # Errors
/// The level lacks this channel, or the channel has no mips.
pub fn mips(level: &Level, channel: &str) -> Result<Levels, Error> {
    level.mips(channel).ok_or_else(|| {
        let known = level.page.images().map(|(name, _)| name).filter(|name| !name.starts_with("leaf_"));
        let known: Vec<&str> = known.collect();
        Error::invalid(format!("the level has no channel {channel:?} with mips; it has {}", known.join(", ")))
    })
}
