//! Coverage and colors of mip levels.

use glam::DVec2;
use proptest::prelude::*;

use super::mips::*;
use super::parts::PagePart;
use crate::atlas::Region;
use crate::foliage::Image;

fn image(width: usize, height: usize, pixel: impl Fn(usize, usize) -> [u8; 4]) -> Image {
    let pixels: Vec<[u8; 4]> = (0..width * height).map(|i| pixel(i % width, i / width)).collect();
    Image::new(width, height, pixels).unwrap()
}

const WHOLE: Region = Region { x: 0, y: 0, width: 64, height: 64 };

/// Returns a part that draws all texels of a region on a page of this size.
fn part(region: Region, (columns, rows): (usize, usize), alpha_cutoff: f32) -> PagePart {
    let Region { x, y, width, height } = region;
    let is_drawn = |i: usize| (x..x + width).contains(&(i % columns)) && (y..y + height).contains(&(i / columns));
    let drawn = (0..columns * rows).map(|i| f32::from(u8::from(is_drawn(i)))).collect();
    PagePart { regions: vec![region], alpha_cutoff, drawn }
}

/// Returns the share of a region's texels that reach a cutoff.
fn share(level: &Image, region: Region, cutoff: f32) -> f64 {
    let at = |i: usize| level.pixels()[(region.y + i / region.width) * level.width() + region.x + i % region.width][3];
    let count = region.width * region.height;
    (0..count).filter(|&i| f32::from(at(i)) / 255.0 >= cutoff).count() as f64 / count as f64
}

/// Soft discs, drawn where they cover most.
fn discs(leaves: &[(f32, f32, f32)]) -> impl Fn(usize, usize) -> f32 + use<> {
    let leaves = leaves.to_vec();
    move |x, y| {
        let inside = |&(cx, cy, r): &(f32, f32, f32)| {
            let apart = DVec2::new(x as f64 + 0.5 - f64::from(cx), y as f64 + 0.5 - f64::from(cy)).length() as f32;
            (r - apart + 0.5).clamp(0.0, 1.0)
        };
        leaves.iter().map(inside).fold(0.0, f32::max)
    }
}

#[test]
fn means_are_the_share_of_the_leaves() {
    // Stripes of one texel in four: a quarter on all levels from the second on.
    let striped = image(64, 64, |x, _| if x % 4 == 0 { [90, 200, 40, 255] } else { [0; 4] });
    for level in &means(&striped)[2..] {
        assert!(level.pixels().iter().all(|&p| p == [90, 200, 40, 64]), "{:?}", level.pixels()[0]);
    }
}

#[test]
fn no_foreign_color_at_any_level() {
    let leaf = image(64, 64, |x, y| if (x / 8 + y / 8) % 2 == 0 { [90, 0, 40, 255] } else { [0, 255, 0, 0] });
    for level in of_color(&leaf, &[part(WHOLE, (64, 64), 0.5)]).iter().skip(1) {
        assert!(level.pixels().iter().all(|p| p[1] == 0), "green lies between the leaves");
    }
}

#[test]
fn trees_on_one_page_keep_their_own_share() {
    // Faint leaves at a low cutoff on the left, strong ones at a high cutoff on the right.
    let [faint, strong] = [(7.0, 0.45), (5.0, 1.0)].map(|(radius, greatest): (f32, f32)| {
        // Not on whole texels: those of equal alpha would pass together.
        let place = |at: usize, shift: usize| (at * 16) as f32 + 8.0 + (shift * 7 % 16) as f32 / 5.0;
        let grid: Vec<_> = (0..16).map(|i| (place(i % 4, i), place(i / 4, i + 5), radius)).collect();
        let of = discs(&grid);
        move |x, y| (255.0 * greatest * of(x, y)) as u8
    });
    let page = image(128, 64, |x, y| [40, 120, 30, if x < 64 { faint(x, y) } else { strong(x - 64, y) }]);
    let right = Region { x: 64, ..WHOLE };
    let parts = [part(WHOLE, (128, 64), 0.3), part(right, (128, 64), 0.6)];
    let levels = of_color(&page, &parts);
    for (region, cutoff) in [(WHOLE, 0.3), (right, 0.6)] {
        let own = share(&page, region, cutoff);
        for (number, level) in levels.iter().enumerate().take(3).skip(1) {
            let Region { x, width, height, .. } = region;
            let seen = Region { x: x >> number, y: 0, width: width >> number, height: height >> number };
            let found = share(level, seen, cutoff);
            assert!((found / own - 1.0).abs() < 0.15, "level {number} at {cutoff}: {found} beside {own}");
        }
    }
}

#[test]
fn texels_that_are_not_drawn_do_not_count() {
    // The right half is full, but no polygon covers it.
    let page = image(64, 64, |x, y| [9, 9, 9, if x >= 32 || (x + y) % 3 == 0 { 255 } else { 0 }]);
    let left = part(Region { width: 32, ..WHOLE }, (64, 64), 0.5);
    let whole = image(64, 64, |x, y| [9, 9, 9, if (x + y) % 3 == 0 { 255 } else { 0 }]);
    let (found, expected) = (pivots(&page, &left), pivots(&whole, &part(WHOLE, (64, 64), 0.5)));
    assert!((found[1] - expected[1]).abs() < 0.05, "{found:?} and {expected:?}");
}

#[test]
fn nothing_and_everything_stay_as_they_are() {
    for alpha in [0, 255] {
        let page = image(64, 64, |_, _| [9, 9, 9, alpha]);
        assert!(pivots(&page, &part(WHOLE, (64, 64), 0.4)).iter().all(|&pivot| (pivot - 0.4).abs() < 1e-6));
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

    /// Leaves of any size anywhere: the passing share stays, as nearly as texels of equal alpha allow.
    #[test]
    fn the_share_is_kept(leaves in prop::collection::vec((0.0f32..64.0, 0.0f32..64.0, 0.3f32..9.0), 1..60), cutoff in 0.2f32..0.8) {
        let covered = discs(&leaves);
        let page = image(64, 64, |x, y| [40, 120, 30, (covered(x, y) * 255.0) as u8]);
        let (own, plain) = (share(&page, WHOLE, cutoff), means(&page));
        let part = part(WHOLE, (64, 64), cutoff);
        for (number, level) in of_color(&page, &[part]).iter().enumerate().take(4).skip(1) {
            let region = Region { x: 0, y: 0, width: 64 >> number, height: 64 >> number };
            let found = share(level, region, cutoff);
            // The most texels of one alpha pass together.
            let mut counts = [0usize; 256];
            plain[number].pixels().iter().for_each(|p| counts[usize::from(p[3])] += 1);
            let jump = counts.iter().max().copied().unwrap_or(0) as f64 / (region.width * region.height) as f64;
            prop_assert!((found - own).abs() <= jump + 0.01, "level {number}: {found} beside {own}");
        }
    }
}

#[test]
fn mip_levels_of_alpha_are_means() {
    let alphas = [0, 100, 200, 255, 10, 20, 30, 40_u8];
    let image = image(4, 2, |x, y| [7, 8, 9, alphas[4 * y + x]]);
    let levels = of_alpha(&image, 9);
    let alphas: Vec<Vec<u8>> = levels.iter().skip(1).map(|l| l.pixels().iter().map(|p| p[3]).collect()).collect();
    // (0 + 100 + 10 + 20) / 4, (200 + 255 + 30 + 40) / 4, and the mean of both.
    assert_eq!(alphas, [vec![33, 131], vec![82]]);
    assert_eq!(of_alpha(&image, 2).len(), 2);
}
