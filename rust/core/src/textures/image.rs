//! PNG files.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use crate::error::{Error, Result};
use crate::foliage::Image;

/// Writes an image as an 8-bit sRGB PNG. The same pixels give the same bytes.
///
/// # Errors
/// The file cannot be written.
pub fn write_png(path: &Path, image: &Image) -> Result<()> {
    let fail = |reason: String| Error::File { path: path.display().to_string(), reason };
    let file = File::create(path).map_err(|e| fail(e.to_string()))?;
    let mut encoder = png::Encoder::new(BufWriter::new(file), image.width() as u32, image.height() as u32);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Balanced);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().map_err(|e| fail(e.to_string()))?;
    writer.write_image_data(image.pixels().as_flattened()).map_err(|e| fail(e.to_string()))?;
    writer.finish().map_err(|e| fail(e.to_string()))
}
