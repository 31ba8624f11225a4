//! Alpha moved to another cutoff by two lines: from 0 to the pivot it becomes 0 to the cutoff, from there to 1 it becomes the cutoff to 1.
//!
//! The outline at the pivot moves to the cutoff, by a fraction of a texel where alpha rises within a texel: leaves become wider or narrower.
//! Shaders can undo it, because both lines rise.

use crate::color::quantise;
use crate::foliage::Image;

/// Returns the image with alpha bent, so that the pivot becomes the cutoff; both in (0, 1).
pub fn bent(image: &Image, pivot: f32, cutoff: f32) -> Image {
    let table = table(pivot, cutoff);
    image.mapped(|[r, g, b, alpha]| [r, g, b, table[alpha as usize]])
}

/// Returns the code of bent alpha for each code.
pub fn table(pivot: f32, cutoff: f32) -> [u8; 256] {
    std::array::from_fn(|code| {
        let alpha = code as f32 / 255.0;
        let moved = if alpha < pivot {
            alpha / pivot * cutoff
        } else {
            cutoff + (alpha - pivot) / (1.0 - pivot).max(1e-3) * (1.0 - cutoff)
        };
        quantise(moved)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pivot_becomes_the_cutoff_and_the_ends_stay() {
        for (pivot, cutoff) in [(0.2, 0.5), (0.5, 0.5), (0.7, 0.4)] {
            let table = table(pivot, cutoff);
            assert_eq!((table[0], table[255]), (0, 255));
            assert!(table[(255.0 * pivot) as usize].abs_diff((255.0 * cutoff) as u8) <= 2, "{pivot}");
            assert!(table.is_sorted());
        }
        assert_eq!(table(0.5, 0.5), std::array::from_fn(|code| code as u8));
    }
}
