//! Coverage and colors of mip levels.

use proptest::prelude::*;

use super::halves::{smaller, texels};
use super::mips::*;
use super::parts::PagePart;
use crate::atlas::Region;
use crate::foliage::Image;

fn image(width: usize, height: usize, pixel: impl Fn(usize, usize) -> [u8; 4]) -> Image {
    let pixels: Vec<[u8; 4]> = (0..width * height).map(|i| pixel(i % width, i / width)).collect();
    Image::new(width, height, pixels).unwrap()
}

const WHOLE: Region = Region { x: 0, y: 0, width: 64, height: 64 };

#[test]
fn thin_leaves_do_not_dissolve() {
    // Every fourth column: a quarter passes at level 0, but no mean on level 2 would reach ½.
    let striped = image(64, 64, |x, _| if x % 4 == 0 { [90, 200, 40, 255] } else { [0; 4] });
    for (number, level) in of_color(&striped, &[WHOLE], 0.5).iter().enumerate().take(5) {
        let region = smaller(WHOLE, 1 << number, level.width(), level.height());
        assert_eq!(share(level, region, 128), 0.25, "level {number}");
    }
}

#[test]
fn no_foreign_colour_at_any_level() {
    // A red and a blue checker of regions, transparent green between them.
    let regions: Vec<Region> =
        (0..16).map(|i| Region { x: i % 4 * 16 + 4, y: i / 4 * 16 + 4, width: 8, height: 8 }).collect();
    let checkers = image(64, 64, |x, y| {
        let inside = (4..12).contains(&(x % 16)) && (4..12).contains(&(y % 16));
        match (inside, (x / 16 + y / 16) % 2) {
            (false, _) => [0, 255, 0, 0],
            (true, 0) => [255, 0, 0, 255],
            (true, _) => [0, 0, 255, 255],
        }
    });
    for level in of_color(&checkers, &regions, 0.5).iter().skip(1) {
        assert!(level.pixels().iter().all(|p| p[1] == 0), "green lies between the regions");
    }
}

#[test]
fn no_foreign_colour_where_gutters_are_too_narrow() {
    // Checkers of 10 texels, 2 texels apart: a texel of level 3 reaches from one into the next.
    let regions: Vec<Region> =
        (0..25).map(|i| Region { x: i % 5 * 12 + 1, y: i / 5 * 12 + 1, width: 10, height: 10 }).collect();
    let checkers = image(64, 64, |x, y| {
        let inside = [x, y].iter().all(|at| (1..11).contains(&(at % 12)) && *at < 60);
        let [r, b] = if (x / 12 + y / 12) % 2 == 0 { [255, 0] } else { [0, 255] };
        [r, 0, b, if inside { 255 } else { 0 }]
    });
    for (number, level) in of_color(&checkers, &regions, 0.5).iter().enumerate().take(4) {
        let mixed = level.pixels().iter().filter(|p| p[3] >= 128 && p[0] > 0 && p[2] > 0);
        assert_eq!(mixed.count(), 0, "level {number}");
    }
}

#[test]
fn no_region_shows_the_rim_of_its_neighbour() {
    // A full region beside a sparse one, with a gutter of two texels, which small levels do not resolve.
    let full = Region { x: 2, y: 2, width: 28, height: 60 };
    let sparse = Region { x: 34, y: 2, width: 28, height: 60 };
    let page = image(64, 64, |x, y| {
        let shown = (2..30).contains(&x) && (2..62).contains(&y) || (46..50).contains(&x) && (30..34).contains(&y);
        [50, 99, 20, if shown { 255 } else { 0 }]
    });
    for (number, level) in of_color(&page, &[full, sparse], 0.25).iter().enumerate().take(4).skip(1) {
        let Region { x, .. } = smaller(sparse, 1 << number, level.width(), level.height());
        let alpha = |x: usize, y: usize| u32::from(level.pixels()[y * level.width() + x][3]);
        let between = (0..level.height()).filter(|&y| alpha(x - 1, y) + alpha(x, y) >= 2 * 64 && alpha(x, y) < 64);
        assert_eq!(between.count(), 0, "level {number}");
    }
}

#[test]
fn trees_on_one_page_keep_their_own_coverage() {
    // Dense leaves at a low cutoff and thin ones at a high cutoff: each on its own page, and both on a page of twice the width.
    let region = Region { x: 4, y: 4, width: 56, height: 56 };
    let dense = image(64, 64, |x, y| [200, 40, 0, if (x / 5 + y / 7) % 2 == 0 { 90 } else { 30 }]);
    let thin = image(64, 64, |x, y| [0, 40, 200, if (x + 2 * y) % 5 == 0 { 230 } else { 120 }]);
    let page = image(128, 64, |x, y| if x < 64 { dense.pixels()[y * 64 + x] } else { thin.pixels()[y * 64 + x - 64] });
    let part = |x: usize, alpha_cutoff: f32| PagePart {
        regions: vec![Region { x, ..region }],
        gutter: 4,
        alpha_cutoff,
        drawn: vec![1.0; 128 * 64],
        first_seen: 0,
    };
    let together = of_parts(&page, &[part(4, 0.3), part(68, 0.8)], |_, mips| Ok(mips)).unwrap();
    for (own, alpha_cutoff, right) in [(&dense, 0.3, 0), (&thin, 0.8, 64)] {
        let alone = of_color(own, &[region], alpha_cutoff);
        let cutoff = code_at_least(alpha_cutoff);
        for number in 0..4 {
            let (side, columns, from) = (64 >> number, 128 >> number, right >> number);
            let seen = smaller(region, 1 << number, side, side);
            let there = texels(Region { x: seen.x + from, ..seen }, columns).map(|i| together[number].pixels()[i]);
            let there: Vec<[u8; 4]> = there.collect();
            let passing = there.iter().filter(|p| p[3] >= cutoff).count();
            let expected = texels(seen, side).filter(|&i| alone[number].pixels()[i][3] >= cutoff).count();
            assert_eq!(passing, expected, "level {number}");
            assert!(there.iter().all(|p| p[if right > 0 { 0 } else { 2 }] == 0), "no foreign color on level {number}");
        }
    }
}

#[test]
fn regions_of_one_alpha_keep_their_area() {
    // A full rectangle, a uniformly translucent one, and one with a soft edge.
    let regions = [4, 44, 84].map(|x| Region { x, y: 48, width: 32, height: 32 });
    let page = image(128, 128, |x, y| {
        let inside = (48..80).contains(&y) && regions.iter().any(|region| (region.x..region.x + 32).contains(&x));
        [40, 120, 30, if inside { [255, 200, if x == 84 { 180 } else { 255 }][x / 43] } else { 0 }]
    });
    let levels = of_color(&page, &regions, 0.5);
    let first = area(&page, 0.5);
    // At level 3, with 4 × 4 texels, the rounded corners of the filter are 5 % of the area.
    for (number, level) in levels.iter().enumerate().take(4) {
        let off = area(level, 0.5) / first - 1.0;
        assert!(off.abs() < 0.06, "level {number}: {off}");
    }
}

#[test]
fn a_region_that_shows_nothing_stays_empty() {
    let faint = image(64, 64, |x, _| [9, 9, 9, if x < 32 { 100 } else { 255 }]);
    let left = Region { width: 32, ..WHOLE };
    let right = Region { x: 32, width: 32, ..WHOLE };
    for (number, level) in of_color(&faint, &[left, right], 0.5).iter().enumerate().take(5) {
        let at = |region: Region| share(level, smaller(region, 1 << number, level.width(), level.height()), 128);
        assert_eq!((at(left), at(right)), (0.0, 1.0), "level {number}");
    }
}

#[test]
fn many_small_regions_keep_their_area_together() {
    // 256 regions of 6 × 6 texels, each with a leaf of 2 × 4. From level 2 on no region has four texels along a side.
    let regions: Vec<Region> =
        (0..256).map(|i| Region { x: i % 16 * 8 + 1, y: i / 16 * 8 + 1, width: 6, height: 6 }).collect();
    let page = image(128, 128, |x, y| {
        let leaf = (3..5).contains(&(x % 8)) && (2..6).contains(&(y % 8));
        [50, 120, 30, if leaf { 255 } else { 0 }]
    });
    let seen = |level: &Image| {
        let scale = 128 / level.width();
        let alpha = |x: f64, y: f64| {
            let place = |at: f64| ((at / scale as f64 - 0.5).max(0.0), level.width() - 1);
            let ((x, last), (y, _)) = (place(x), place(y));
            let at = |x: f64, y: f64| {
                f64::from(level.pixels()[(y as usize).min(last) * level.width() + (x as usize).min(last)][3])
            };
            let (i, j, u, v) = (x.floor(), y.floor(), x.fract(), y.fract());
            (at(i, j) * (1.0 - u) + at(i + 1.0, j) * u) * (1.0 - v)
                + (at(i, j + 1.0) * (1.0 - u) + at(i + 1.0, j + 1.0) * u) * v
        };
        // Four places along each side of the regions' texels.
        let places = regions.iter().flat_map(|region| {
            (0..24 * 24).map(move |i| {
                (region.x as f64 + f64::from(i % 24) / 4.0 + 0.125, region.y as f64 + f64::from(i / 24) / 4.0 + 0.125)
            })
        });
        let (count, shown) =
            places.fold((0, 0), |(count, shown), (x, y)| (count + 1, shown + i32::from(alpha(x, y) >= 64.0)));
        f64::from(shown) / f64::from(count)
    };
    let first = seen(&page);
    for (number, level) in of_color(&page, &regions, 0.25).iter().enumerate().take(6).skip(1) {
        let off = seen(level) / first - 1.0;
        assert!(off.abs() < 0.1, "level {number}: {off}");
    }
}

#[test]
fn shares_are_means_and_normals_stay_as_long_as_1() {
    // Two columns lean to the left, two to the right, by 45°: together they point at the viewer.
    let leaning = image(4, 4, |x, _| [if x % 2 == 0 { 218 } else { 37 }, 128, 218, 255]);
    let normal = of_normals(&leaning)[1].pixels()[0];
    assert!(normal[0].abs_diff(128) <= 1 && normal[1].abs_diff(128) <= 1 && normal[2] >= 254, "{normal:?}");
    let checkers = image(4, 4, |x, y| if (x + y) % 2 == 0 { [0, 100, 255, 255] } else { [200, 100, 255, 255] });
    let levels = of_shares(&checkers);
    assert_eq!(levels.iter().map(Image::width).collect::<Vec<_>>(), [4, 2, 1]);
    assert!(levels[1..].iter().all(|level| level.pixels().iter().all(|p| *p == [100, 100, 255, 255])));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Leaves of any size anywhere: the passing share stays, down to 8 × 8 texels.
    #[test]
    fn coverage_is_kept(leaves in prop::collection::vec((0.0f32..64.0, 0.0f32..64.0, 0.3f32..9.0), 1..60), cutoff in 0.2f32..0.8) {
        let covered = |x: usize, y: usize| {
            let inside = |&(cx, cy, r): &(f32, f32, f32)| {
                let apart = ((x as f32 + 0.5 - cx).powi(2) + (y as f32 + 0.5 - cy).powi(2)).sqrt();
                (r - apart + 0.5).clamp(0.0, 1.0)
            };
            leaves.iter().map(inside).fold(0.0, f32::max)
        };
        let page = image(64, 64, |x, y| [40, 120, 30, (covered(x, y) * 255.0) as u8]);
        let code = code_at_least(cutoff);
        let first = share(&page, WHOLE, code);
        for (number, level) in of_color(&page, &[WHOLE], cutoff).iter().enumerate().take(4) {
            let region = smaller(WHOLE, 1 << number, level.width(), level.height());
            let texels = (region.width * region.height) as f64;
            let off = (share(level, region, code) - first).abs() * texels;
            // Transparent texels of a level never pass, and a visible region never vanishes.
            prop_assert!(off <= (0.01 * texels).max(1.0), "level {number}: {off} texels off");
        }
    }
}
