//! sRGB and linear light (IEC 61966-2-1), by tables built with `libm`: the same on every machine.

use std::sync::LazyLock;

/// Entries of the encoding table; at 14 bits the steepest part of the curve still moves less than a quarter of a code per entry.
const ENCODE: usize = 1 << 14;

static DECODED: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| decode_exactly(code as f64 / 255.0) as f32));

static ENCODED: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let encode = |i: usize| (encode_exactly(i as f64 / (ENCODE - 1) as f64) * 255.0).round() as u8;
    (0..ENCODE).map(encode).collect()
});

fn decode_exactly(x: f64) -> f64 {
    if x <= 0.04045 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) }
}

fn encode_exactly(x: f64) -> f64 {
    if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * libm::pow(x, 1.0 / 2.4) - 0.055 }
}

/// Returns the table from sRGB codes to linear light in [0, 1].
pub fn decode_table() -> &'static [f32; 256] {
    &DECODED
}

/// Converts linear light to the nearest sRGB code, within ¾ of a code. Clamps to [0, 1]; NaN gives 0.
pub fn encode(linear: f32) -> u8 {
    let index = linear.clamp(0.0, 1.0) * (ENCODE - 1) as f32 + 0.5;
    ENCODED[index as usize]
}

/// Converts a share in [0, 1] to an 8-bit code.
pub fn quantise(share: f32) -> u8 {
    (share.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::stability::{case, worse};

    #[test]
    fn codes_are_as_near_as_is_said() {
        let exactly = |x: f64| if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        let share = |i: u32| i as f32 / (1u32 << 20) as f32;
        let off = |i| (f64::from(encode(share(i))) - exactly(f64::from(share(i))) * 255.0).abs();
        let worst = (0..=1 << 20).map(off).fold(0.0, worse);
        case("Kernels", "linear light to an sRGB code, in codes", "the standard's formula in f64; the stated bound")
            .holds(worst, 0.75);
        let off = |i| (f64::from(quantise(share(i))) - f64::from(share(i)) * 255.0).abs();
        let worst = (0..=1 << 20).map(off).fold(0.0, worse);
        case("Kernels", "a share to a code, in codes", "definition: half a code and the rounding of f32")
            .holds(worst, 0.5 + 255.0 * 2f64.powi(-23));
    }

    #[test]
    fn codes_survive_the_round_trip() {
        for code in 0..=255u8 {
            assert_eq!(encode(decode_table()[code as usize]), code);
        }
    }

    #[test]
    fn known_values() {
        assert_eq!([encode(0.0), encode(1.0), encode(7.0), encode(-1.0), encode(f32::NAN)], [0, 255, 255, 0, 0]);
        // 0.735 358 and 0.461 356 by the standard's formula.
        assert_eq!([encode(0.5), encode(0.18)], [188, 118]);
        assert_eq!([quantise(0.0), quantise(0.5), quantise(1.0)], [0, 128, 255]);
    }
}
