//! Lines of text as pictures, in the font of the charts.

use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};
use leafcloud::error::{Error, Result};

/// Pixels of a line of text: their share of ink, row by row from the top.
#[derive(Clone, Debug)]
pub struct TextPicture {
    /// Width in pixels; at least 1.
    pub width: usize,
    /// Height in pixels, the same for every text of a size.
    pub height: usize,
    /// Share of ink of each pixel, 255 for all.
    pub ink: Vec<u8>,
}

const SIZES: std::ops::RangeInclusive<f64> = 4.0..=200.0;

/// Greatest number of characters of a line.
const LONGEST: usize = 1000;

/// Draws a line of text, `size` pixels per em. The baseline of every text of a size is in the same row.
///
/// # Errors
/// A size outside [4, 200]; more than 1000 characters.
pub fn text_picture(text: &str, size: f64) -> Result<TextPicture> {
    if !SIZES.contains(&size) {
        return Err(Error::invalid(format!("the text size is {size}; it must be from 4 to 200 pixels")));
    }
    let count = text.chars().count();
    if count > LONGEST {
        return Err(Error::invalid(format!("the text has {count} characters; it must have at most {LONGEST}")));
    }
    let font = FontRef::try_from_slice(dejavu::sans::regular())
        .map_err(|_| Error::invalid("the built-in font cannot be read"))?;
    let scale = PxScale::from(size as f32 * font.height_unscaled() / font.units_per_em().unwrap_or(1000.0));
    let (glyphs, width) = placed(text, &font, scale);
    let height = font.as_scaled(scale).height().ceil() as usize;
    let mut picture = TextPicture { width, height, ink: vec![0; width * height] };
    for glyph in glyphs {
        draw(glyph, &font, &mut picture);
    }
    Ok(picture)
}

/// Returns the glyphs on the baseline from left to right, and the width of the line in pixels.
fn placed(text: &str, font: &FontRef, scale: PxScale) -> (Vec<Glyph>, usize) {
    let scaled = font.as_scaled(scale);
    let (mut x, mut last) = (0.0, None);
    let mut glyphs = Vec::new();
    for character in text.chars() {
        let id = font.glyph_id(character);
        x += last.map_or(0.0, |last| scaled.kern(last, id));
        glyphs.push(id.with_scale_and_position(scale, point(x, scaled.ascent().round())));
        x += scaled.h_advance(id);
        last = Some(id);
    }
    (glyphs, (x.ceil() as usize).max(1))
}

fn draw(glyph: Glyph, font: &FontRef, picture: &mut TextPicture) {
    let Some(outline) = font.outline_glyph(glyph) else { return };
    let bounds = outline.px_bounds();
    outline.draw(|x, y, share| {
        let (x, y) = (bounds.min.x as i64 + i64::from(x), bounds.min.y as i64 + i64::from(y));
        if (0..picture.width as i64).contains(&x) && (0..picture.height as i64).contains(&y) {
            let pixel = &mut picture.ink[y as usize * picture.width + x as usize];
            *pixel = pixel.saturating_add((share.clamp(0.0, 1.0) * 255.0).round() as u8);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_longer_text_is_wider_and_not_higher() {
        let [short, long] = ["Level 1", "Level 1 of 3, gypq"].map(|text| text_picture(text, 16.0).unwrap());
        assert!(short.width < long.width && short.height == long.height);
        for picture in [&short, &long] {
            assert_eq!(picture.ink.len(), picture.width * picture.height);
            assert!(picture.ink.iter().any(|ink| *ink > 200));
            let edges = [0, picture.height - 1].map(|row| &picture.ink[row * picture.width..][..picture.width]);
            assert!(edges.concat().iter().all(|ink| *ink < 128), "no glyph is clipped");
        }
    }

    #[test]
    fn an_empty_text_has_no_ink() {
        let picture = text_picture("", 12.0).unwrap();
        assert_eq!((picture.width, picture.ink.iter().max()), (1, Some(&0)));
    }

    #[test]
    fn sizes_and_lengths_out_of_range_are_refused() {
        assert!(text_picture("a", 3.0).unwrap_err().to_string().contains("4 to 200"));
        assert!(text_picture("a", f64::NAN).is_err());
        assert!(text_picture(&"a".repeat(1001), 12.0).unwrap_err().to_string().contains("1001 characters"));
    }
}
