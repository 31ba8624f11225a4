//! Sharper pictures of the views. An impostor blends three of them and reads between their texels, which loses texture of the leaves. So each
//! view has more than its leaves: the distance of each texel from the mean of its surroundings is [`SHARPNESS`] times as great (unsharp
//! masking). Texels that are as far from the mean as they can be stay: the gain is less where alpha is 0 or 1. O(texels).

use glam::{Vec3, Vec4};

use crate::textures::Canvas;

/// Factor on the distance from the mean.
const SHARPNESS: f32 = 2.0;

/// Gaussian with a standard deviation of a texel.
const WEIGHTS: [f32; 5] = [0.135_335, 0.606_531, 1.0, 0.606_531, 0.135_335];

/// Sharpens a view's premultiplied colors and its alpha.
pub(super) fn sharpen(canvas: &mut Canvas) {
    let means = blurred(canvas);
    for (pixel, mean) in canvas.pixels.iter_mut().zip(means) {
        let away = |own: f32, mean: f32| mean + SHARPNESS * (own - mean);
        let alpha = away(pixel.w, mean.w).clamp(0.0, 1.0);
        let straight = |p: Vec4| if p.w > 0.0 { p.truncate() / p.w } else { Vec3::ZERO };
        let (own, mean) = (straight(*pixel), straight(mean));
        let color = Vec3::from_array(std::array::from_fn(|i| away(own[i], mean[i]))).clamp(Vec3::ZERO, Vec3::ONE);
        *pixel = (color * alpha).extend(alpha);
    }
}

/// Returns the weighted mean around each pixel; pixels outside do not count.
fn blurred(canvas: &Canvas) -> Vec<Vec4> {
    let (width, height) = (canvas.width, canvas.height);
    let along = |pixels: &[Vec4], place: usize, count: usize, first: usize, step: usize| {
        let (mut sum, mut weights) = (Vec4::ZERO, 0.0);
        for (i, weight) in WEIGHTS.into_iter().enumerate() {
            let at = (place + i).checked_sub(2).filter(|at| *at < count);
            if let Some(at) = at {
                sum += pixels[first + at * step] * weight;
                weights += weight;
            }
        }
        sum / weights
    };
    let rows = |i: usize| along(&canvas.pixels, i % width, width, i / width * width, 1);
    let rows: Vec<Vec4> = (0..width * height).map(rows).collect();
    (0..width * height).map(|i| along(&rows, i / width, height, i % width, width)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(pixel: impl Fn(usize, usize) -> Vec4) -> Canvas {
        Canvas { width: 16, height: 16, pixels: (0..256).map(|i| pixel(i % 16, i / 16)).collect() }
    }

    #[test]
    fn an_even_view_stays() {
        let mut even = view(|_, _| Vec4::new(0.1, 0.2, 0.05, 0.5));
        let before = even.clone();
        sharpen(&mut even);
        assert!(even.pixels.iter().zip(&before.pixels).all(|(a, b)| a.distance(*b) < 1e-5));
    }

    #[test]
    fn a_wave_gets_higher_by_what_the_blur_takes() {
        // The blur leaves Σ wᵢ cos(π i / 2) / Σ wᵢ = (1 − 2 · 0.135335) / 2.483732 of a wave of four texels.
        let left = (1.0 - 2.0 * 0.135_335) / 2.483_732;
        let height = |x: usize| [0.0, 0.1, 0.0, -0.1][x % 4];
        let mut wave = view(|x, _| Vec4::new(0.5 + height(x), 0.5, 0.5, 1.0));
        sharpen(&mut wave);
        for x in 4..12 {
            let expected = 0.5 + height(x) * (left + SHARPNESS * (1.0 - left));
            assert!((wave.pixels[8 * 16 + x].x - expected).abs() < 1e-5, "{x}");
        }
    }

    #[test]
    fn empty_texels_stay_empty_and_alpha_within_its_range() {
        let mut edge = view(|x, _| if x < 8 { Vec4::ZERO } else { Vec4::ONE });
        sharpen(&mut edge);
        assert!(edge.pixels.iter().enumerate().all(|(i, p)| *p == if i % 16 < 8 { Vec4::ZERO } else { Vec4::ONE }));
    }
}
