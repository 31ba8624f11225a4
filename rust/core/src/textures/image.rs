//! Image files.

use std::fs::File;
use std::io::{BufWriter, Cursor};
use std::path::Path;

use image::{ImageReader, Limits};

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

/// Greatest width and height of an image, in pixels.
const LARGEST_IMAGE: u32 = 16_384;

/// Memory limit for decoding one image: twice the largest image with four 8-bit channels.
const DECODING_BYTES: u64 = 2 << 30;

/// Returns an image file, such as a PNG or a JPEG, as 8-bit RGBA. Images larger than 16,384 pixels on a side are not decoded.
///
/// # Errors
/// The file is no image, too large or broken.
pub fn decode(encoded: &[u8]) -> Result<Image> {
    let broken = |reason: &dyn std::fmt::Display| Error::invalid(format!("the image cannot be decoded: {reason}"));
    let mut reader = ImageReader::new(Cursor::new(encoded)).with_guessed_format().map_err(|e| broken(&e))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST_IMAGE);
    limits.max_image_height = Some(LARGEST_IMAGE);
    limits.max_alloc = Some(DECODING_BYTES);
    reader.limits(limits);
    let pixels = reader.decode().map_err(|e| broken(&e))?.into_rgba8();
    let (width, height) = (pixels.width() as usize, pixels.height() as usize);
    Image::new(width, height, pixels.into_raw().as_chunks::<4>().0.to_vec())
}
