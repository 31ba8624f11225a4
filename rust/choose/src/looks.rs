//! Figures of a level's picture against the leaves' picture: difference, contrast inside the crown, coverage and mean color.

use leafcloud::Image;
use leafcloud_flip::Base;

/// Color behind the tree for the texture of the crown: a sky, in [0, 1].
const GROUND: [f32; 3] = [0.55, 0.66, 0.78];

/// Standard deviations in pixels of the blurs whose differences are the finest octaves.
const BLURS: [f32; 3] = [1.0, 2.0, 4.0];

/// Number of octaves.
pub const OCTAVES: usize = BLURS.len();

/// A pixel is inside the crown if more than this share of its surroundings is covered.
const INSIDE: f32 = 0.6;

/// Fewest pixels inside the crown for its contrast to count: a few pixels between two gaps are no texture.
const LEAST_INSIDE: usize = 40;

/// Cells along a side of a picture.
const CELLS: usize = 16;

/// Figures of one picture beside another. Means over views are [`Looks::mean`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Looks {
    /// FLIP inside both silhouettes; in [0, 1].
    pub flip: f64,
    /// Root mean square of the finest octaves of luminance inside the crown, over the leaves'. 0.3 in the first is a blur, 1.3 in the others
    /// lumps.
    pub contrast: [f64; OCTAVES],
    /// Sum of alpha over the leaves'.
    pub coverage: f64,
    /// Sum over cells of the differences of their covered share, over the covered share.
    pub cells: f64,
    /// Greatest difference of the mean color of a channel, in codes over 255.
    pub color: f64,
}

/// A picture of the leaves, with the figures of its own that those of all levels need.
pub struct Leaves {
    image: Image,
    flip: Base,
    covered: f64,
    inside: Vec<bool>,
    octaves: [f64; OCTAVES],
    color: [f64; 3],
}

impl Leaves {
    /// `None` if the picture is empty.
    #[must_use]
    pub fn of(image: &Image) -> Option<Self> {
        let covered = alpha(image).sum::<f64>();
        (covered > 0.0).then(|| {
            let inside = inside(image);
            Self {
                image: image.clone(),
                flip: Base::of(image),
                covered,
                octaves: octaves(image, &inside),
                inside,
                color: mean_color(image),
            }
        })
    }
}

impl Looks {
    /// Compares a picture with one of the leaves, of the same size.
    #[must_use]
    pub fn of(leaves: &Leaves, other: &Image) -> Self {
        let Leaves { image, flip, covered, inside, octaves: own, color } = leaves;
        let others = octaves(other, inside);
        let counts = inside.iter().filter(|within| **within).count() >= LEAST_INSIDE;
        let ratio = |i: usize| if counts && own[i] > 1e-4 { others[i] / own[i] } else { 1.0 };
        let mean = mean_color(other);
        Self {
            flip: flip.flip(other),
            contrast: std::array::from_fn(ratio),
            coverage: alpha(other).sum::<f64>() / covered,
            cells: cells(image, other),
            color: (0..3).map(|i| (color[i] - mean[i]).abs()).fold(0.0, f64::max),
        }
    }

    /// Returns the mean of the figures of some views; `None` without any.
    #[must_use]
    pub fn mean(views: &[Self]) -> Option<Self> {
        let mean = |each: &dyn Fn(&Self) -> f64| views.iter().map(each).sum::<f64>() / views.len() as f64;
        (!views.is_empty()).then(|| Self {
            flip: mean(&|view| view.flip),
            contrast: std::array::from_fn(|i| mean(&|view| view.contrast[i])),
            coverage: mean(&|view| view.coverage),
            cells: mean(&|view| view.cells),
            color: mean(&|view| view.color),
        })
    }
}

/// Returns the alpha of each pixel, in [0, 1].
fn alpha(image: &Image) -> impl Iterator<Item = f64> {
    image.pixels().iter().map(|pixel| f64::from(pixel[3]) / 255.0)
}

/// Returns the mean color, weighted by alpha, as codes over 255; black for an empty picture.
fn mean_color(image: &Image) -> [f64; 3] {
    let covered = alpha(image).sum::<f64>().max(f64::MIN_POSITIVE);
    let sum =
        |i: usize| image.pixels().iter().map(|p| f64::from(p[i]) * f64::from(p[3]) / (255.0 * 255.0)).sum::<f64>();
    std::array::from_fn(|i| sum(i) / covered)
}

fn cells(base: &Image, other: &Image) -> f64 {
    let sums = |image: &Image| {
        let mut sums = vec![0.0; CELLS * CELLS];
        let (width, height) = (image.width(), image.height());
        for (i, alpha) in alpha(image).enumerate() {
            sums[i / width * CELLS / height * CELLS + i % width * CELLS / width] += alpha;
        }
        sums
    };
    let (base, other) = (sums(base), sums(other));
    let apart: f64 = base.iter().zip(&other).map(|(a, b)| (a - b).abs()).sum();
    apart / base.iter().sum::<f64>().max(f64::MIN_POSITIVE)
}

/// Returns which pixels lie inside the crown.
fn inside(image: &Image) -> Vec<bool> {
    let alpha: Vec<f32> = image.pixels().iter().map(|pixel| f32::from(pixel[3]) / 255.0).collect();
    blurred(&alpha, image.width(), BLURS[OCTAVES - 1]).into_iter().map(|share| share > INSIDE).collect()
}

/// Returns the root mean square of the differences between each blur and the one before it.
fn octaves(image: &Image, inside: &[bool]) -> [f64; OCTAVES] {
    let luminance = |pixel: &[u8; 4]| {
        let alpha = f32::from(pixel[3]) / 255.0;
        let over = |i: usize| f32::from(pixel[i]) / 255.0 * alpha + GROUND[i] * (1.0 - alpha);
        0.2126 * over(0) + 0.7152 * over(1) + 0.0722 * over(2)
    };
    let sharp: Vec<f32> = image.pixels().iter().map(luminance).collect();
    let mut fine = sharp.clone();
    std::array::from_fn(|i| {
        let coarse = blurred(&sharp, image.width(), BLURS[i]);
        let (mut sum, mut count) = (0.0, 0usize);
        for (pixel, within) in inside.iter().enumerate() {
            if *within {
                sum += f64::from(fine[pixel] - coarse[pixel]).powi(2);
                count += 1;
            }
        }
        fine = coarse;
        if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
    })
}

/// Returns an image blurred by a Gaussian that ends at four standard deviations; the image is mirrored at its borders.
fn blurred(image: &[f32], width: usize, deviation: f32) -> Vec<f32> {
    let reach = (4.0 * deviation + 0.5) as isize;
    let weights: Vec<f32> =
        (-reach..=reach).map(|i| libm::expf(-0.5 * (i as f32 / deviation) * (i as f32 / deviation))).collect();
    let sum: f32 = weights.iter().sum();
    let weights: Vec<f32> = weights.into_iter().map(|weight| weight / sum).collect();
    let height = image.len() / width.max(1);
    let mirrored = |i: isize, count: usize| {
        let i = i.rem_euclid(2 * count as isize) as usize;
        if i < count { i } else { 2 * count - 1 - i }
    };
    let mut rows = vec![0.0; image.len()];
    for y in 0..height {
        for (k, weight) in weights.iter().enumerate() {
            let row = mirrored(y as isize + k as isize - reach, height);
            let from = &image[row * width..(row + 1) * width];
            for (to, from) in rows[y * width..(y + 1) * width].iter_mut().zip(from) {
                *to += weight * from;
            }
        }
    }
    let mut padded = vec![0.0; width + 2 * reach as usize];
    let mut result = vec![0.0; image.len()];
    for y in 0..height {
        let row = &rows[y * width..(y + 1) * width];
        for (i, to) in padded.iter_mut().enumerate() {
            *to = row[mirrored(i as isize - reach, width)];
        }
        let to = &mut result[y * width..(y + 1) * width];
        for (k, weight) in weights.iter().enumerate() {
            for (to, from) in to.iter_mut().zip(&padded[k..]) {
                *to += weight * from;
            }
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixel: impl Fn(usize, usize) -> [u8; 4]) -> Image {
        Image::new(64, 64, (0..64 * 64).map(|i| pixel(i % 64, i / 64)).collect::<Vec<_>>()).unwrap()
    }

    fn looks(leaves: &Image, other: &Image) -> Looks {
        Looks::of(&Leaves::of(leaves).unwrap(), other)
    }

    fn board(dark: u8, light: u8, side: usize) -> Image {
        picture(|x, y| {
            [0, 0, 0, 255]
                .map(|alpha: u8| alpha.max(if (x / side + y / side).is_multiple_of(2) { dark } else { light }))
        })
    }

    #[test]
    fn a_picture_looks_like_itself() {
        let board = board(20, 200, 2);
        let found = looks(&board, &board);
        let same = Looks { contrast: [1.0; 3], coverage: 1.0, ..Looks::default() };
        assert_eq!(found, same);
        assert!(Leaves::of(&picture(|_, _| [9, 9, 9, 0])).is_none());
    }

    #[test]
    fn half_of_the_contrast_is_half_in_every_octave() {
        let found = looks(&board(20, 220, 2), &board(70, 170, 2));
        assert!(found.contrast.iter().all(|ratio| (ratio - 0.5).abs() < 1e-3), "{found:?}");
        assert!(found.color < 1e-9 && found.cells < 1e-12);
    }

    #[test]
    fn a_few_pixels_inside_say_nothing_about_contrast() {
        let spot = |side: usize, board: &Image| {
            let pixels = board.pixels().iter().enumerate();
            let within = |i: usize| i % 64 < side && i / 64 < side;
            let pixels = pixels.map(|(i, pixel)| if within(i) { *pixel } else { [0; 4] });
            Image::new(64, 64, pixels.collect::<Vec<_>>()).unwrap()
        };
        let contrast = |side| looks(&spot(side, &board(20, 220, 1)), &spot(side, &board(70, 170, 1))).contrast[0];
        assert!(contrast(4) == 1.0 && contrast(40) < 0.6, "{} {}", contrast(4), contrast(40));
    }

    #[test]
    fn a_blur_lacks_the_finest_octave() {
        let found = looks(&board(20, 220, 1), &picture(|_, _| [120, 120, 120, 255]));
        assert!(found.contrast[0] < 1e-3, "{found:?}");
    }

    #[test]
    fn cells_tell_where_leaves_are_missing_and_coverage_how_many() {
        let rows =
            |from: usize, to: usize| picture(move |_, y| if (from..to).contains(&y) { [9, 9, 9, 255] } else { [0; 4] });
        let moved = looks(&rows(0, 32), &rows(32, 64));
        assert_eq!((moved.coverage, moved.cells), (1.0, 2.0));
        let half = looks(&rows(0, 32), &rows(0, 16));
        assert_eq!((half.coverage, half.cells), (0.5, 0.5));
    }

    #[test]
    fn a_blurred_point_is_a_gaussian() {
        let mut point = vec![0.0; 33 * 33];
        point[16 * 33 + 16] = 1.0;
        let found = blurred(&point, 33, 2.0);
        let expected = |d: f32| libm::expf(-d * d / 8.0) / (8.0 * std::f32::consts::PI);
        for (x, y) in [(16, 16), (18, 16), (16, 19), (13, 20)] {
            let squared = ((x as f32 - 16.0).powi(2) + (y as f32 - 16.0).powi(2)).sqrt();
            assert!((found[y * 33 + x] / expected(squared) - 1.0).abs() < 2e-3, "{x} {y}");
        }
        assert!((found.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    }
}
