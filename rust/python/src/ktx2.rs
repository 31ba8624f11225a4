//! A level's textures as KTX2 files.

use leafcloud::lod::Level;
use leafcloud::{Error, Progress};
use leafcloud_ktx2::{Codes, CutOut, encode};

/// Returns the KTX2 file of a channel with its mips.
///
/// # Errors
/// The level lacks this channel, or the channel has no mips; glTF does not allow the page's size; the encoder fails;
/// [`Error::Cancelled`].
pub fn file_of(level: &Level, channel: &str, progress: Progress) -> Result<Vec<u8>, Error> {
    let levels = level.mips(channel).ok_or_else(|| {
        let known = level.page.images().map(|(name, _)| name).filter(|name| !name.starts_with("leaf_"));
        let known: Vec<&str> = known.collect();
        Error::invalid(format!("the level has no channel {channel:?} with mips; it has {}", known.join(", ")))
    })?;
    let codes = if matches!(channel, "base_color" | "translucency") { Codes::Srgb } else { Codes::Linear };
    let sizes = levels.iter().map(|image| (image.width(), image.height()));
    let cut_outs: Vec<Vec<CutOut>> =
        sizes.enumerate().map(|(number, size)| cut_outs(level, channel, number, size)).collect();
    let mips = levels.iter().zip(&cut_outs).map(|(image, cut_outs)| leafcloud_ktx2::MipLevel {
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

fn cut_outs(level: &Level, channel: &str, number: usize, (columns, rows): (usize, usize)) -> Vec<CutOut> {
    let regions = level.cut_outs(channel, number, columns, rows).into_iter();
    let cut_out = |(region, code): (leafcloud::atlas::Region, u8)| CutOut {
        x: region.x,
        y: region.y,
        width: region.width,
        height: region.height,
        code,
    };
    regions.map(cut_out).collect()
}
