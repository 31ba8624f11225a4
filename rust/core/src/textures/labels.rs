//! Label textures: the leaf of each texel, and its texture coordinates. With them, a cloud can show another leaf texture without a new
//! bake.
//!
//! Labels cannot be averaged: a texel takes those of the triangle with the most samples in it, and renderers must sample them with nearest
//! filtering. A texture coordinate has 12 bits, a sixteenth of a texel in a texture of 256: its upper 8 bits in red (u) and green (v), the
//! lower 4 bits of both in blue. A leaf has its index modulo 65536 in red (lower byte) and green (upper byte), and its material in blue.

use glam::{Vec2, Vec3, Vec4};

use super::raster::{Canvas, Seen};

/// Material code of the trunk.
const NO_LEAF: u8 = 255;

/// Returns the texture coordinates at a point, as codes over 255.
pub fn leaf_uv(seen: &Seen) -> Vec3 {
    let uv = seen.surface.uv(seen.spot.weights);
    seen.surface.label(|material| material.leaf_uv.as_ref(), uv).unwrap_or_else(|| codes(coded(uv)))
}

/// Returns leaf and material at a point, as codes over 255.
pub fn leaf_id(seen: &Seen) -> Vec3 {
    let (foliage, triangle) = (seen.triangle.foliage, seen.triangle.triangle as usize);
    let uv = seen.surface.uv(seen.spot.weights);
    seen.surface.label(|material| material.leaf_id.as_ref(), uv).unwrap_or_else(|| {
        let [low, high, ..] = foliage.leaf_ids()[triangle].to_le_bytes();
        let material = foliage.label_of_material(triangle).map_or(NO_LEAF, |id| id.min(254) as u8);
        codes([low, high, material])
    })
}

fn coded(uv: Vec2) -> [u8; 3] {
    // Casts saturate; a coordinate rounded up to 1 takes the last code.
    let [u, v] = (uv - uv.floor()).to_array().map(|x| ((x * 4096.0) as u16).min(4095));
    [(u >> 4) as u8, (v >> 4) as u8, ((u & 15) << 4 | (v & 15)) as u8]
}

fn codes(codes: [u8; 3]) -> Vec3 {
    Vec3::from_array(codes.map(f32::from)) / 255.0
}

/// Width in texels of the labels' margin around covered texels: a cutoff draws a little beyond them.
const RINGS: usize = 3;

/// Spreads labels to pixels without coverage beside covered ones.
pub fn spread(canvas: &mut Canvas) {
    let (width, height) = (canvas.width, canvas.height);
    let mut known: Vec<bool> = canvas.pixels.iter().map(|p| p.w > 0.0).collect();
    for _ in 0..RINGS {
        let neighbour = |i: usize| {
            let (x, y) = (i % width, i / width);
            let sides = [
                (x > 0).then(|| i - 1),
                (x + 1 < width).then_some(i + 1),
                (y > 0).then(|| i - width),
                (y + 1 < height).then_some(i + width),
            ];
            sides.into_iter().flatten().find(|&side| known[side])
        };
        let found: Vec<(usize, Vec4)> = (0..known.len())
            .filter(|&i| !known[i])
            .filter_map(|i| neighbour(i).map(|j| (i, canvas.pixels[j].with_w(0.0))))
            .collect();
        for (i, pixel) in found {
            (canvas.pixels[i], known[i]) = (pixel, true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeating_texture_coordinates_keep_twelve_bits() {
        for (u, v) in [(0.0f32, 0.0f32), (0.999_99, 0.5), (0.123_4, 0.876_5), (-0.25, 7.75), (1e6, -1e6)] {
            let [r, g, b] = coded(Vec2::new(u, v)).map(u16::from);
            let [found_u, found_v] = [r << 4 | b >> 4, g << 4 | b & 15].map(|code| (f32::from(code) + 0.5) / 4096.0);
            assert!((found_u - u.rem_euclid(1.0)).abs() <= 1.0 / 8192.0 + 1e-6, "{u}: {found_u}");
            assert!((found_v - v.rem_euclid(1.0)).abs() <= 1.0 / 8192.0 + 1e-6, "{v}: {found_v}");
        }
    }

    #[test]
    fn labels_spread_three_texels_beyond_coverage() {
        let mut pixels = vec![Vec4::ZERO; 11];
        pixels[5] = Vec4::new(0.2, 0.4, 0.6, 1.0);
        let mut canvas = Canvas { width: 11, height: 1, pixels };
        spread(&mut canvas);
        let labelled: Vec<usize> = (0..11).filter(|&i| canvas.pixels[i].x == 0.2).collect();
        assert_eq!(labelled, [2, 3, 4, 5, 6, 7, 8]);
        assert!(canvas.pixels.iter().enumerate().all(|(i, p)| p.w == f32::from(u8::from(i == 5))));
    }
}
