//! PNG files in memory: still pictures and animations (APNG), in all colors or in a palette.

use png::{BitDepth, ColorType, Compression, Encoder, Filter, SrgbRenderingIntent};

use super::palette::Palette;
use crate::error::{Error, Result};
use crate::foliage::Image;

/// Encodes frames of one size as an 8-bit sRGB PNG. More than one frame are an animation (APNG) that repeats without end. The same frames
/// give the same bytes.
///
/// `milliseconds`: duration of each frame of an animation. `colors`: number of colors of a palette, in [2, 256]; the file then has no alpha.
/// `None`: all colors, with alpha.
///
/// # Errors
/// No frames; frames of different sizes; an animation without one duration per frame; a number of colors out of range.
pub fn encode_png(frames: &[Image], milliseconds: &[u16], colors: Option<usize>) -> Result<Vec<u8>> {
    check(frames, milliseconds)?;
    let palette = colors.map(|colors| Palette::of(frames, colors)).transpose()?;
    let mut file = Vec::new();
    write(&mut file, frames, milliseconds, palette.as_ref())
        .map_err(|error| Error::invalid(format!("the PNG cannot be encoded: {error}")))?;
    Ok(file)
}

fn check(frames: &[Image], milliseconds: &[u16]) -> Result<()> {
    let Some(first) = frames.first() else {
        return Err(Error::invalid("there are 0 frames; a PNG needs at least 1"));
    };
    let size = |frame: &Image| (frame.width(), frame.height());
    if let Some(other) = frames.iter().find(|frame| size(frame) != size(first)) {
        let ((width, height), (other_width, other_height)) = (size(first), size(other));
        return Err(Error::invalid(format!(
            "a frame has {other_width} × {other_height} pixels and the first {width} × {height}; all must have one size"
        )));
    }
    if frames.len() > 1 && frames.len() != milliseconds.len() {
        return Err(Error::invalid(format!(
            "there are {} frames and {} durations; give one duration for each frame",
            frames.len(),
            milliseconds.len()
        )));
    }
    Ok(())
}

fn write(
    file: &mut Vec<u8>,
    frames: &[Image],
    milliseconds: &[u16],
    palette: Option<&Palette>,
) -> std::result::Result<(), png::EncodingError> {
    let is_animated = frames.len() > 1;
    let mut encoder = Encoder::new(file, frames[0].width() as u32, frames[0].height() as u32);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    encoder.set_compression(Compression::Balanced);
    encoder.set_color(ColorType::Rgba);
    if let Some(palette) = palette {
        encoder.set_color(ColorType::Indexed);
        encoder.set_palette(palette.colors.as_flattened().to_vec());
        encoder.set_filter(Filter::NoFilter); // Differences of indices mean nothing.
    }
    if is_animated {
        encoder.set_animated(frames.len() as u32, 0)?;
    }
    let mut writer = encoder.write_header()?;
    for (number, frame) in frames.iter().enumerate() {
        if is_animated {
            writer.set_frame_delay(milliseconds[number], 1000)?;
        }
        match palette {
            Some(palette) => writer.write_image_data(&palette.indices(frame))?,
            None => writer.write_image_data(frame.pixels().as_flattened())?,
        }
    }
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    /// Returns a frame with a gray ramp and a red column.
    fn frame(column: usize) -> Image {
        let gray = |row: usize| [8 * row as u8, 8 * row as u8, 8 * row as u8, 255];
        let pixel = |i: usize| if i % 32 == column { [255, 0, 0, 255] } else { gray(i / 32) };
        Image::new(32, 32, (0..1024).map(pixel).collect::<Vec<_>>()).unwrap()
    }

    /// Returns the pixels of all frames, and their durations in milliseconds.
    fn decoded(file: &[u8]) -> (Vec<Vec<u8>>, Vec<u16>) {
        let mut decoder = png::Decoder::new(Cursor::new(file));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        let count = reader.info().animation_control().map_or(1, |control| control.num_frames);
        let (mut frames, mut durations) = (Vec::new(), Vec::new());
        for _ in 0..count {
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut pixels).unwrap();
            pixels.truncate(info.buffer_size());
            frames.push(pixels);
            durations.extend(reader.info().frame_control().map(|control| control.delay_num));
        }
        (frames, durations)
    }

    #[test]
    fn one_frame_is_a_still_picture_in_all_colors() {
        let (frames, durations) = decoded(&encode_png(&[frame(3)], &[], None).unwrap());
        assert_eq!(frames, [frame(3).pixels().as_flattened()]);
        assert!(durations.is_empty());
    }

    #[test]
    fn an_animation_keeps_its_frames_and_durations() {
        let frames = [frame(1), frame(9), frame(30)];
        let (shown, durations) = decoded(&encode_png(&frames, &[40, 40, 900], None).unwrap());
        let expected: Vec<_> = frames.iter().map(|frame| frame.pixels().as_flattened().to_vec()).collect();
        assert_eq!((shown, durations), (expected, vec![40, 40, 900]));
    }

    #[test]
    fn a_palette_is_close() {
        let frames = [frame(1), frame(9)];
        let file = encode_png(&frames, &[40, 40], Some(16)).unwrap();
        for (shown, frame) in decoded(&file).0.iter().zip(&frames) {
            for (code, pixel) in shown.as_chunks::<3>().0.iter().zip(frame.pixels()) {
                for (a, b) in code.iter().zip(pixel) {
                    assert!(a.abs_diff(*b) <= 12, "{code:?} {pixel:?}");
                }
            }
        }
    }

    #[test]
    fn wrong_frames_are_refused() {
        let small = Image::new(1, 1, vec![[0; 4]]).unwrap();
        for (frames, milliseconds, colors, said) in [
            (vec![], vec![], None, "0 frames"),
            (vec![frame(0), small], vec![9, 9], None, "1 × 1 pixels"),
            (vec![frame(0), frame(1)], vec![9], None, "1 durations"),
            (vec![frame(0)], vec![], Some(1), "1 colors"),
            (vec![frame(0)], vec![], Some(257), "257 colors"),
        ] {
            let error = encode_png(&frames, &milliseconds, colors).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
