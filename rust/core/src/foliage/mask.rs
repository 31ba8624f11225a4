//! Drawn area of an alpha mask: the area where alpha, bilinear between texel centers, reaches the cutoff.
//!
//! Counting texels above the cutoff gives another area. A single opaque texel covers less than its square (0.61 of it at a cutoff of ½),
//! and a gap of one texel is narrower than a texel. Counting would make needles too wide. The area is exact along rows, four per texel;
//! O(texels). Alpha comes as rows of 8-bit codes from the top, and repeats at its edges.

use crate::color::quantise;

/// Sampled rows per texel.
const ROWS: usize = 4;

/// Returns the drawn share of each texel's square, as 8-bit codes.
pub fn shares(alpha: &[u8], width: usize, cutoff: f32) -> Vec<u8> {
    let mut shares = Vec::with_capacity(alpha.len());
    for y in 0..alpha.len() / width {
        add_row(alpha, width, cutoff * 255.0, y, |share| shares.push(share));
    }
    shares
}

fn add_row(alpha: &[u8], width: usize, cutoff: f32, y: usize, mut add: impl FnMut(u8)) {
    let height = alpha.len() / width;
    let row = |y: usize| &alpha[y * width..][..width];
    let rows = [row((y + height - 1) % height), row(y), row((y + 1) % height)];
    let passes = |code: u8| u8::from(f32::from(code) >= cutoff);
    let column = |x: usize| passes(rows[0][x]) + passes(rows[1][x]) + passes(rows[2][x]);
    let (mut left, mut here) = (column(width - 1), column(0));
    for x in 0..width {
        let after = if x + 1 == width { 0 } else { x + 1 };
        let right = column(after);
        add(match left + here + right {
            0 => 0,
            9 => 255,
            _ => {
                let near = [if x == 0 { width - 1 } else { x - 1 }, x, after];
                quantise(share(rows.map(|row| near.map(|x| f32::from(row[x]))), cutoff))
            }
        });
        (left, here) = (here, right);
    }
}

/// Returns the share of the middle texel's square where bilinear interpolation of 3 × 3 texels reaches `cutoff`.
fn share(texels: [[f32; 3]; 3], cutoff: f32) -> f32 {
    let share_of = |j: usize| {
        let down = (j as f32 + 0.5) / ROWS as f32 - 0.5;
        let other = if down < 0.0 { texels[0] } else { texels[2] };
        let [left, middle, right] = std::array::from_fn(|i| texels[1][i] + (other[i] - texels[1][i]) * down.abs());
        0.5 * (share_above(0.5 * (left + middle), middle, cutoff) + share_above(middle, 0.5 * (middle + right), cutoff))
    };
    (0..ROWS).map(share_of).sum::<f32>() / ROWS as f32
}

/// Returns the share of a segment on which linear interpolation from `a` to `b` is at least `least`.
fn share_above(a: f32, b: f32, least: f32) -> f32 {
    let (low, high) = (a.min(b), a.max(b));
    if low >= least {
        1.0
    } else if high < least {
        0.0
    } else {
        (high - least) / (high - low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn total(alpha: &[u8], cutoff: f32) -> f64 {
        shares(alpha, 8, cutoff).iter().map(|&share| f64::from(share) / 255.0).sum()
    }

    #[test]
    fn a_texel_that_stands_alone() {
        // The area where (1 − x)(1 − y) ≥ c, four times: 4 · (1 − c + c · ln c).
        for cutoff in [0.3f32, 0.5, 0.8] {
            let exact = f64::from(4.0 * (1.0 - cutoff + cutoff * cutoff.ln()));
            let alone: Vec<u8> = (0..64).map(|i| if i == 27 { 255 } else { 0 }).collect();
            assert!((total(&alone, cutoff) - exact).abs() < 0.03, "{cutoff}: {} for {exact}", total(&alone, cutoff));
        }
    }

    #[test]
    fn straight_edges_lie_where_alpha_crosses_the_cutoff() {
        let half: Vec<u8> = (0..64).map(|i| if i % 8 < 4 { 255 } else { 0 }).collect();
        for (cutoff, columns) in [(0.5, 4.0), (0.25, 4.5), (0.9, 3.2)] {
            assert!((total(&half, cutoff) - 8.0 * columns).abs() < 0.1, "{cutoff}");
        }
        assert_eq!((total(&half, 0.0), total(&half, 1.1)), (64.0, 0.0));
    }
}
