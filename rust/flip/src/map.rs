//! FLIP of each pixel: how much two pictures differ for a viewer who flips between them (Andersson et al., "FLIP: A Difference Evaluator for
//! Alternating Images", 2020; the filters are separable, as in the authors' supplement).
//!
//! Colors are compared after the blur of the eye, in `CIELab` with saturation that grows with lightness; edges and points of luminance raise the
//! difference. O(pixels · filter width). Single precision, by additions, multiplications, divisions, roots and the functions of `libm` alone, so the
//! result is the same on any machine. Error bound: within 0.001 of the authors' code at any pixel, which the tests compare with.

use std::f32::consts::PI;
use std::sync::OnceLock;

use leafcloud::Image;

/// Pixels in a degree of the field of view: a screen of 0.7 m and 3840 pixels, 0.7 m away.
const PIXELS_PER_DEGREE: f32 = 67.020_6;

/// Sensitivity to contrast of luminance, red against green, and blue against yellow: amplitude and width of Gaussians.
const LUMINANCE: [(f32, f32); 1] = [(1.0, 0.0047)];
const RED_GREEN: [(f32, f32); 1] = [(1.0, 0.0053)];
const BLUE_YELLOW: [(f32, f32); 2] = [(34.1, 0.04), (13.5, 0.025)];

/// Width of the filter for edges and points, in degrees.
const FEATURE: f32 = 0.082;

/// Exponent of differences of color.
const COLOR_POWER: f32 = 0.7;

/// Differences of color up to the first share of the greatest one are stretched to the second share.
const USUAL: f32 = 0.4;
const STRETCHED: f32 = 0.95;

/// From linear light to X, Y and Z as shares of those of white, and from X, Y and Z to linear light.
const TO_XYZ: [[f32; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];
const FROM_XYZ: [[f32; 3]; 3] = [
    [3.241_003_3, -1.537_398_9, -0.498_615_86],
    [-0.969_224_33, 1.875_930_1, 0.041_554_224],
    [0.055_639_423, -0.204_011_2, 1.057_148_9],
];
const WHITE: [f32; 3] = [0.950_428_55, 1.0, 1.088_900_4];

/// A plane of values, row by row.
type Plane = Vec<f32>;

/// What a viewer sees of each pixel of a picture.
pub(crate) struct Viewed {
    /// The blurred color in `CIELab`, with saturation times lightness.
    colors: Vec<[f32; 3]>,
    /// Lengths of the first and of the second derivative of luminance.
    features: [Plane; 2],
}

impl Viewed {
    /// `image` is shown over mid-gray.
    pub fn of(image: &Image) -> Self {
        let (width, filters) = (image.width(), Filters::get());
        let [y, red_green, blue_yellow] = opponents(image);
        let [smooth, first, second] = &filters.derivatives;
        let smooth_across = across(&y, width, smooth);
        let features = [first, second].map(|kernel| {
            let [along, against] =
                [down(&across(&y, width, kernel), width, smooth), down(&smooth_across, width, kernel)];
            along.iter().zip(against).map(|(x, y)| (x * x + y * y).sqrt()).collect()
        });
        let y = blurred(&y, width, &filters.luminance);
        let red_green = blurred(&red_green, width, &filters.red_green);
        let blue_yellow = blurred(&blue_yellow, width, &filters.blue_yellow);
        let color = |((y, red_green), blue_yellow): ((f32, f32), f32)| {
            let xyz = [(y + red_green) * WHITE[0], y * WHITE[1], (y - blue_yellow) * WHITE[2]];
            lab(product(&FROM_XYZ, xyz).map(|light| light.clamp(0.0, 1.0)))
        };
        Self { colors: y.into_iter().zip(red_green).zip(blue_yellow).map(color).collect(), features }
    }

    /// Returns FLIP of a pixel.
    pub fn difference(&self, other: &Self, pixel: usize) -> f32 {
        let greatest = Filters::get().greatest;
        let color = power(apart(self.colors[pixel], other.colors[pixel]), COLOR_POWER);
        let usual = USUAL * greatest;
        let color = if color < usual {
            color * STRETCHED / usual
        } else {
            STRETCHED + (color - usual) / (greatest - usual) * (1.0 - STRETCHED)
        };
        let of_feature = |number: usize| (self.features[number][pixel] - other.features[number][pixel]).abs();
        let feature = (of_feature(0).max(of_feature(1)) / 2f32.sqrt()).sqrt();
        power(color, 1.0 - feature)
    }
}

/// Returns a plane filtered by the sum of the products of each kernel with itself.
fn blurred(plane: &[f32], width: usize, kernels: &[Plane]) -> Plane {
    let mut parts = kernels.iter().map(|kernel| down(&across(plane, width, kernel), width, kernel));
    let first = parts.next().unwrap_or_default();
    parts.fold(first, |sum, part| sum.iter().zip(part).map(|(sum, part)| sum + part).collect())
}

/// Returns Y, X − Y and Y − Z of each pixel over mid-gray, as shares of white.
fn opponents(image: &Image) -> [Plane; 3] {
    let light = decoded();
    let mut planes: [Plane; 3] = std::array::from_fn(|_| Vec::with_capacity(image.pixels().len()));
    for &[r, g, b, alpha] in image.pixels() {
        let [x, y, z] = of_white([r, g, b].map(|code| light[usize::from(over_grey(code, alpha))]));
        for (plane, value) in planes.iter_mut().zip([y, x - y, y - z]) {
            plane.push(value);
        }
    }
    planes
}

/// Composites a color code over mid-gray by its alpha.
fn over_grey(code: u8, alpha: u8) -> u8 {
    let (code, alpha) = (u32::from(code), u32::from(alpha));
    ((code * alpha + 128 * (255 - alpha) + 127) / 255) as u8
}

/// Returns the linear light of each code of sRGB.
fn decoded() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|code| {
            let code = code as f32 / 255.0;
            if code <= 0.040_45 { code / 12.92 } else { libm::powf((code + 0.055) / 1.055, 2.4) }
        })
    })
}

fn product(matrix: &[[f32; 3]; 3], [x, y, z]: [f32; 3]) -> [f32; 3] {
    matrix.map(|[a, b, c]| a * x + b * y + c * z)
}

/// Returns X, Y and Z of linear light, as shares of white.
fn of_white(light: [f32; 3]) -> [f32; 3] {
    let xyz = product(&TO_XYZ, light);
    std::array::from_fn(|i| xyz[i] / WHITE[i])
}

/// Returns linear light in `CIELab`, with saturation times lightness (the effect of Hunt).
fn lab(light: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = of_white(light)
        .map(|share| if share > 216.0 / 24_389.0 { cube_root(share) } else { share * (841.0 / 108.0) + 4.0 / 29.0 });
    let lightness = 116.0 * y - 16.0;
    [lightness, 5.0 * (x - y) * lightness, 2.0 * (y - z) * lightness]
}

/// Returns the cube root of a number above 0, within 4 · 10⁻⁷ of itself: two steps of Halley from a guess by the exponent.
fn cube_root(x: f32) -> f32 {
    let mut root = f32::from_bits(x.to_bits() / 3 + 709_921_077);
    for _ in 0..2 {
        let cube = root * root * root;
        root *= (cube + 2.0 * x) / (2.0 * cube + x);
    }
    root
}

/// Returns x to the power y, for x of at least 0 and y in [0, 1], within 10⁻⁶ of itself: by the series of the logarithm of a number near 1 and of the
/// exponential of a number near 0. Half of the time of FLIP would go into the powers of `libm`.
fn power(x: f32, y: f32) -> f32 {
    if x < f32::MIN_POSITIVE {
        return if y > 0.0 { 0.0 } else { 1.0 };
    }
    // x = m · 2ⁿ with m in [√½, √2).
    let shifted = x.to_bits().wrapping_sub(0.5f32.sqrt().to_bits());
    let exponent = (shifted as i32) >> 23;
    let mantissa = f32::from_bits(x.to_bits().wrapping_sub((exponent << 23) as u32));
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let square = t * t;
    let logarithm = 2.0 * t * (1.0 + square * (1.0 / 3.0 + square * (0.2 + square * (1.0 / 7.0 + square / 9.0))));
    let power = y * (exponent as f32 + logarithm * std::f32::consts::LOG2_E);
    let whole = (power + 0.5).floor();
    let rest = (power - whole) * std::f32::consts::LN_2;
    let near = 1.0
        + rest * (1.0 + rest / 2.0 * (1.0 + rest / 3.0 * (1.0 + rest / 4.0 * (1.0 + rest / 5.0 * (1.0 + rest / 6.0)))));
    near * f32::from_bits(((whole as i32 + 127) << 23) as u32)
}

/// Returns the distance of two colors: along lightness plus across.
fn apart(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [lightness, x, y] = std::array::from_fn(|i| a[i] - b[i]);
    lightness.abs() + (x * x + y * y).sqrt()
}

/// Separable filters. Those of a color are sums of products of a kernel with itself.
struct Filters {
    luminance: Vec<Plane>,
    red_green: Vec<Plane>,
    blue_yellow: Vec<Plane>,
    /// A Gaussian with its first and second derivative; the positive weights of a derivative sum to 1, the negative ones to −1.
    derivatives: [Plane; 3],
    /// The greatest difference of colors: of green and blue.
    greatest: f32,
}

impl Filters {
    fn get() -> &'static Self {
        static FILTERS: OnceLock<Filters> = OnceLock::new();
        FILTERS.get_or_init(|| Self {
            luminance: sensitivity(&LUMINANCE),
            red_green: sensitivity(&RED_GREEN),
            blue_yellow: sensitivity(&BLUE_YELLOW),
            derivatives: derivatives(),
            greatest: power(apart(lab([0.0, 1.0, 0.0]), lab([0.0, 0.0, 1.0])), COLOR_POWER),
        })
    }
}

/// Returns a kernel for each Gaussian, so that the products of each with itself sum to 1 together.
fn sensitivity(gaussians: &[(f32, f32)]) -> Vec<Plane> {
    let deviation = |width: f32| (width / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE;
    let kernel = |&(amplitude, width): &(f32, f32)| -> Plane {
        // All filters of the authors end at three deviations of the widest. There narrow ones have weights of nothing.
        let reach = (3.0 * deviation(BLUE_YELLOW[0].1)).min(5.5 * deviation(width)).ceil() as i32;
        let weight = |x: i32| {
            let degrees = x as f32 / PIXELS_PER_DEGREE;
            (amplitude * (PI / width).sqrt()).sqrt() * libm::expf(-PI * PI * degrees * degrees / width)
        };
        (-reach..=reach).map(weight).collect()
    };
    let kernels: Vec<Plane> = gaussians.iter().map(kernel).collect();
    let total: f32 = kernels.iter().map(|kernel| kernel.iter().sum::<f32>().powi(2)).sum::<f32>().sqrt();
    kernels.into_iter().map(|kernel| kernel.into_iter().map(|weight| weight / total).collect()).collect()
}

fn derivatives() -> [Plane; 3] {
    let deviation = 0.5 * FEATURE * PIXELS_PER_DEGREE;
    let reach = (3.0 * deviation).ceil() as i32;
    let at = |x: i32| {
        let x = x as f32;
        let smooth = libm::expf(-x * x / (2.0 * deviation * deviation));
        [smooth, -x * smooth, (x * x / (deviation * deviation) - 1.0) * smooth]
    };
    [0, 1, 2].map(|order| {
        let kernel: Plane = (-reach..=reach).map(|x| at(x)[order]).collect();
        let [above, below] = [1.0, -1.0].map(|sign: f32| kernel.iter().map(|w| (sign * w).max(0.0)).sum::<f32>());
        kernel
            .into_iter()
            .map(|weight| weight / if weight > 0.0 { above } else { below.max(f32::MIN_POSITIVE) })
            .collect()
    })
}

/// Returns a plane filtered along its rows; pixels outside are as the nearest one inside.
fn across(plane: &[f32], width: usize, kernel: &[f32]) -> Plane {
    let reach = kernel.len() / 2;
    let mut filtered = vec![0.0; plane.len()];
    let mut padded = vec![0.0; width + 2 * reach];
    for (row, to) in plane.chunks(width).zip(filtered.chunks_mut(width)) {
        padded[..reach].fill(row[0]);
        padded[reach..reach + width].copy_from_slice(row);
        padded[reach + width..].fill(row[width - 1]);
        add_weighted(to, kernel, |k| &padded[k..]);
    }
    filtered
}

/// Returns a plane filtered along its columns, as [`across`] does along rows.
fn down(plane: &[f32], width: usize, kernel: &[f32]) -> Plane {
    let (reach, height) = (kernel.len() / 2, plane.len() / width);
    let mut filtered = vec![0.0; plane.len()];
    for (y, to) in filtered.chunks_mut(width).enumerate() {
        add_weighted(to, kernel, |k| {
            let row = (y + k).saturating_sub(reach).min(height - 1);
            &plane[row * width..][..width]
        });
    }
    filtered
}

/// Values that are summed at once, in registers.
const LANES: usize = 16;

/// Adds the rows of some values, each with its weight.
fn add_weighted<'a>(to: &mut [f32], weights: &[f32], row: impl Fn(usize) -> &'a [f32]) {
    for (number, to) in to.chunks_mut(LANES).enumerate() {
        let mut sums = [0.0; LANES];
        for (k, weight) in weights.iter().enumerate() {
            let from = &row(k)[number * LANES..];
            match from.first_chunk::<LANES>() {
                Some(from) => sums.iter_mut().zip(from).for_each(|(sum, from)| *sum += weight * from),
                None => sums.iter_mut().zip(from).for_each(|(sum, from)| *sum += weight * from),
            }
        }
        to.iter_mut().zip(sums).for_each(|(to, sum)| *to += sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A number in [0, 1) that looks random.
    fn noise(i: usize) -> f64 {
        let x = ((i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 11) as f64 / (1u64 << 53) as f64;
        (x * 7919.0).fract()
    }

    fn picture((width, height): (usize, usize), pixel: impl Fn(usize, usize) -> [f64; 3]) -> Image {
        let code = |i: usize| {
            let [r, g, b] = pixel(i % width, i / width).map(|x| (x * 255.0) as u8);
            [r, g, b, 255]
        };
        Image::new(width, height, (0..width * height).map(code).collect::<Vec<_>>()).unwrap()
    }

    /// The greatest difference of a map from the authors'. Colors are composited over mid-gray by the definition.
    fn off_by(a: &Image, b: &Image) -> f32 {
        let over = |code: u8, alpha: u8| {
            ((f64::from(code) * f64::from(alpha) + 128.0 * (255.0 - f64::from(alpha))) / 255.0).round() as u8
        };
        let codes = |image: &Image| -> Vec<u8> {
            image.pixels().iter().flat_map(|p| [p[0], p[1], p[2]].map(|code| over(code, p[3]))).collect()
        };
        let (width, height) = (a.width() as u32, a.height() as u32);
        let authors = |image| nv_flip::FlipImageRgb8::with_data(width, height, &codes(image));
        let expected = nv_flip::flip(authors(a), authors(b), nv_flip::DEFAULT_PIXELS_PER_DEGREE).to_vec();
        let found = crate::flip_map(a, b);
        found.iter().zip(expected).map(|(found, expected)| (found - expected).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn maps_are_those_of_the_authors() {
        let mut worst: f32 = 0.0;
        for sides in [(48, 48), (1, 1), (7, 50), (33, 20)] {
            let blocks = |size: usize, first: usize| {
                picture(sides, move |x, y| [0, 1, 2].map(|c| noise(first + (x / size * 97 + y / size) * 3 + c)))
            };
            let ramp = picture(sides, |x, y| [x as f64 / 50.0, y as f64 / 50.0, 0.5]);
            let saturated =
                picture(sides, |x, y| if (x / 6 + y / 6) % 2 == 0 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] });
            let faint = |i: usize, [r, g, b, _]: [u8; 4]| [r, g, b, (noise(i) * 255.0) as u8];
            let pixels: Vec<[u8; 4]> = ramp.pixels().iter().enumerate().map(|(i, pixel)| faint(i, *pixel)).collect();
            let faint = Image::new(sides.0, sides.1, pixels).unwrap();
            let pictures = [blocks(1, 0), blocks(1, 5), blocks(3, 9), blocks(8, 2), ramp, saturated, faint];
            for a in &pictures {
                worst = pictures.iter().map(|b| off_by(a, b)).fold(worst, f32::max);
            }
        }
        assert!(worst < 1e-3, "{worst}");
    }

    #[test]
    fn powers_are_exact_to_some_roundings() {
        for i in 0..3000 {
            let (x, y) = (noise(i) as f32 * 10f32.powi(i as i32 % 7 - 4), noise(i + 1) as f32);
            let exact = f64::from(x).powf(f64::from(y));
            assert!((f64::from(power(x, y)) / exact - 1.0).abs() < 1e-6, "{x} {y}");
        }
        assert_eq!([power(0.0, 0.7), power(0.0, 0.0), power(1.0, 0.3)], [0.0, 1.0, 1.0]);
    }

    #[test]
    fn cube_roots_are_exact_to_some_roundings() {
        for i in 1..10_000 {
            let x = i as f32 / 10_000.0;
            let exact = f64::from(x).cbrt();
            assert!((f64::from(cube_root(x)) / exact - 1.0).abs() < 4e-7, "{x}");
        }
    }
}
