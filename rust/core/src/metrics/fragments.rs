//! An exact counter of the quads, samples and pixels that triangles cover in one picture.
//!
//! Each triangle takes time for its rows and not for its pixels: in each row its edges leave an interval of pixels, found by one division each.

/// Steps of a corner's place in a pixel, as graphics cards have them.
const STEPS: i64 = 256;

/// Counts in one picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    /// Quads of 2 × 2 pixels with a covered pixel, for each triangle.
    pub quads: u64,
    /// Covered pixels, for each triangle.
    pub samples: u64,
    /// Pixels that any triangle covers.
    pub pixels: u64,
}

/// A picture that counts while triangles are drawn.
pub(super) struct Counter {
    /// Half of the picture's side, in pixels: an even number, so that quads begin at the picture's center.
    half: i64,
    /// Words of 64 pixels in a row.
    words: usize,
    covered: Vec<u64>,
    quads: u64,
    samples: u64,
}

impl Counter {
    /// Makes a picture that holds all places within `reach` pixels of its center.
    pub fn new(reach: f64) -> Self {
        let half = 2 * ((reach / 2.0) as i64 + 1);
        let words = (2 * half as usize).div_ceil(64);
        Self { half, words, covered: vec![0; words * 2 * half as usize], quads: 0, samples: 0 }
    }

    /// Draws a triangle; `corners` in pixels to the right of the center and above it, counterclockwise as seen on its front.
    pub fn draw(&mut self, corners: [[f64; 2]; 3], double_sided: bool) {
        let middle = (self.half * STEPS) as f64 + 0.5;
        // Rows go down. Adding a half rounds, because all places are above 0.
        let snapped = |[x, y]: [f64; 2]| [(middle + x * STEPS as f64) as i64, (middle - y * STEPS as f64) as i64];
        let [a, mut b, mut c] = corners.map(snapped);
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area == 0 || (area > 0 && !double_sided) {
            return;
        }
        if area < 0 {
            (b, c) = (c, b);
        }
        let [columns, rows] = [0, 1].map(|axis| {
            let (low, high) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            Interval { first: first_center(low), last: first_center(high + 1) - 1 }
        });
        if columns.length() == 0 || rows.length() == 0 {
            return;
        }
        let edges = [Edge::between(a, b), Edge::between(b, c), Edge::between(c, a)];
        for pair in rows.first / 2..=rows.last / 2 {
            let [upper, lower] = [2 * pair, 2 * pair + 1].map(|row| {
                let inside = edges.iter().fold(Interval::ALL, |inside, edge| inside.common(edge.columns(row)));
                self.cover(row, inside);
                inside
            });
            let both = upper.quads().common(lower.quads());
            self.quads += upper.quads().length() + lower.quads().length() - both.length();
        }
    }

    /// Returns the counts so far.
    pub fn counts(&self) -> Counts {
        let pixels = self.covered.iter().map(|word| u64::from(word.count_ones())).sum();
        Counts { quads: self.quads, samples: self.samples, pixels }
    }

    fn cover(&mut self, row: i64, columns: Interval) {
        if columns.length() == 0 {
            return;
        }
        self.samples += columns.length();
        let (first, last) = (columns.first as usize, columns.last as usize);
        let start = row as usize * self.words;
        for word in first / 64..=last / 64 {
            let low = first.max(64 * word) - 64 * word;
            let high = last.min(64 * word + 63) - 64 * word;
            self.covered[start + word] |= (u64::MAX >> (63 - (high - low))) << low;
        }
    }
}

/// Returns the number of the first pixel with its center at `place` or behind it, in steps.
fn first_center(place: i64) -> i64 {
    (place - STEPS / 2 + STEPS - 1).div_euclid(STEPS)
}

/// Pixels, or quads, of a row from `first` to `last`; none if `last` is before `first`.
#[derive(Clone, Copy, Debug)]
struct Interval {
    first: i64,
    last: i64,
}

impl Interval {
    const ALL: Self = Self { first: i64::MIN, last: i64::MAX };
    const NONE: Self = Self { first: i64::MAX, last: i64::MIN };

    fn common(self, other: Self) -> Self {
        Self { first: self.first.max(other.first), last: self.last.min(other.last) }
    }

    fn length(self) -> u64 {
        if self.first > self.last { 0 } else { (self.last - self.first) as u64 + 1 }
    }

    fn quads(self) -> Self {
        if self.length() == 0 { Self::NONE } else { Self { first: self.first / 2, last: self.last / 2 } }
    }
}

/// The half plane beside an edge of a triangle: `across` · x + `down` · y + `constant` ≥ 0, in steps.
struct Edge {
    across: i64,
    down: i64,
    constant: i64,
}

impl Edge {
    /// Returns the half plane to the right of the way from `a` to `b`, as seen with rows going down. A center on the edge belongs to the
    /// triangle if the edge is on its left or on its top, so that of two triangles with a common edge only one covers it.
    fn between(a: [i64; 2], b: [i64; 2]) -> Self {
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let owns = dy < 0 || (dy == 0 && dx > 0);
        Self { across: -dy, down: dx, constant: dy * a[0] - dx * a[1] - i64::from(!owns) }
    }

    /// Returns the pixels of a row with their centers in the half plane.
    fn columns(&self, row: i64) -> Interval {
        let rest = self.constant + self.down * (STEPS * row + STEPS / 2) + self.across * (STEPS / 2);
        if self.across == 0 {
            return if rest < 0 { Interval::NONE } else { Interval::ALL };
        }
        let steps = rest.div_euclid(self.across.abs() * STEPS);
        if self.across > 0 {
            Interval { first: -steps, ..Interval::ALL }
        } else {
            Interval { last: steps, ..Interval::ALL }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::random::Random;

    /// Counts by a test of every pixel, exact in integers. The rule for centers on edges, by its definition: a center counts as if it lay
    /// slightly to the right, and even less down.
    fn counted(triangles: &[[[f64; 2]; 3]], double_sided: bool, half: i64) -> Counts {
        const HAIR: i128 = 1 << 40;
        let mut counts = Counts::default();
        let mut any = vec![false; (4 * half * half) as usize];
        for corners in triangles {
            let [a, b, c] = corners.map(|[x, y]| {
                let round = |place: f64| i128::from((place * 256.0 + 0.5).floor() as i64);
                [round(x + half as f64), round(half as f64 - y)].map(|place| place * HAIR * HAIR)
            });
            let side = |p: [i128; 2], q: [i128; 2], at: [i128; 2]| {
                // Places up to 2^16 steps times 2^80: one factor without hairs keeps products below 2^127.
                let [dx, dy] = [q[0] - p[0], q[1] - p[1]].map(|d| d / (HAIR * HAIR));
                dx * (at[1] - p[1]) - dy * (at[0] - p[0])
            };
            let front = side(a, b, c) < 0;
            if side(a, b, c) == 0 || !(front || double_sided) {
                continue;
            }
            let mut quads = std::collections::HashSet::new();
            for (row, column) in (0..2 * half).flat_map(|row| (0..2 * half).map(move |column| (row, column))) {
                let place = |pixel: i64| i128::from(256 * pixel + 128) * HAIR * HAIR;
                let at = [place(column) + HAIR, place(row) + 1];
                let sides = [side(a, b, at), side(b, c, at), side(c, a, at)];
                if sides.iter().all(|s| *s > 0) || sides.iter().all(|s| *s < 0) {
                    counts.samples += 1;
                    quads.insert((row / 2, column / 2));
                    any[(row * 2 * half + column) as usize] = true;
                }
            }
            counts.quads += quads.len() as u64;
        }
        counts.pixels = any.iter().filter(|covered| **covered).count() as u64;
        counts
    }

    fn drawn(triangles: &[[[f64; 2]; 3]], double_sided: bool, reach: f64) -> Counts {
        let mut counter = Counter::new(reach);
        for corners in triangles {
            counter.draw(*corners, double_sided);
        }
        counter.counts()
    }

    #[test]
    fn counts_are_those_of_a_test_of_every_pixel() {
        let mut random = Random(7);
        for round in 0..300 {
            // Large and small triangles; every third round with corners on centers and edges of pixels, where rules decide.
            let size = [15.0, 3.0, 0.7][round % 3];
            let place = |random: &mut Random, middle: f64| {
                let place = (middle + random.signed() * size).clamp(-15.9, 15.9);
                if round % 9 < 3 { (2.0 * place).round() / 2.0 } else { place }
            };
            let triangles: Vec<[[f64; 2]; 3]> = (0..8)
                .map(|_| {
                    let middle = [random.signed() * 12.0, random.signed() * 12.0];
                    [(); 3].map(|()| middle.map(|m| place(&mut random, m)))
                })
                .collect();
            for double_sided in [false, true] {
                let found = drawn(&triangles, double_sided, 15.9);
                assert_eq!(found, counted(&triangles, double_sided, 16), "round {round}: {triangles:?}");
            }
        }
    }

    #[test]
    fn a_fan_covers_each_pixel_once() {
        let mut random = Random(8);
        for _ in 0..50 {
            let rim: Vec<[f64; 2]> = (0..12)
                .map(|i| {
                    let (radius, angle) = (30.0 + 20.0 * random.signed(), f64::from(i) * std::f64::consts::TAU / 12.0);
                    [radius * libm::cos(angle), radius * libm::sin(angle)]
                })
                .collect();
            let fan: Vec<[[f64; 2]; 3]> = (0..12).map(|i| [[0.1, 0.2], rim[i], rim[(i + 1) % 12]]).collect();
            let found = drawn(&fan, false, 60.0);
            assert_eq!(found.samples, found.pixels);
            assert!(4 * found.quads > found.samples);
        }
    }
}
