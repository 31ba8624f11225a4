//! The lines along which cutting a set of cells leaves the least area in the convex hulls of both sides.
//!
//! For each direction the cells fall into strips across it. Only the ends of each strip matter for hulls, so the areas of the hulls of the
//! first k strips follow for all k from one pass of the monotone chain, and so do those of the last k: O(cells + strips) for a direction.

use glam::DVec2;

use super::cells::{Cell, at, reach};
use super::convex::HalfPlane;

/// Directions of cuts, spread over 180°.
const DIRECTIONS: usize = 16;

/// Strips across each direction, at most; a strip is at least a texel wide.
const STRIPS: usize = 48;

/// Returns the best cut of each direction, the least area first.
pub(super) fn cuts(cells: &[Cell]) -> Vec<HalfPlane> {
    let mut found: Vec<(f64, HalfPlane)> = directions().filter_map(|normal| best(cells, normal)).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.into_iter().map(|(_, cut)| cut).collect()
}

fn directions() -> impl Iterator<Item = DVec2> {
    (0..DIRECTIONS).map(|number| {
        let (sine, cosine) = libm::sincos(std::f64::consts::PI * number as f64 / DIRECTIONS as f64);
        DVec2::new(cosine, sine)
    })
}

/// Returns the cut with this normal that leaves the least area, with that area; `None` for cells of a single strip.
fn best(cells: &[Cell], normal: DVec2) -> Option<(f64, HalfPlane)> {
    let along = |cell: &Cell| normal.dot(at(*cell));
    let range = |(low, high): (f64, f64), x: f64| (low.min(x), high.max(x));
    let (first, last) = cells.iter().map(along).fold((f64::INFINITY, f64::NEG_INFINITY), range);
    // Strips along an axis begin and end between cells.
    let beside = reach(normal);
    let (low, length) = (first - beside, last - first + 2.0 * beside);
    let count = (length.round() as usize).clamp(1, STRIPS);
    let width = length / count as f64;
    let mut strips = vec![(f64::INFINITY, f64::NEG_INFINITY); count];
    for cell in cells {
        let number = (((along(cell) - low) / width) as usize).min(count - 1);
        strips[number] = range(strips[number], normal.perp_dot(at(*cell)));
    }
    let ends: Vec<Option<Strip>> = (0u32..)
        .zip(strips)
        .map(|(number, (least, most))| {
            let from = low + f64::from(number) * width;
            (least <= most).then_some(Strip { from, to: from + width, low: least - beside, high: most + beside })
        })
        .collect();
    let before = areas(ends.iter().copied());
    let after = areas(ends.iter().rev().map(|strip| strip.map(Strip::reversed)));
    let total = |number: usize| before[number - 1] + after[count - 1 - number];
    let number = (1..count).reduce(|a, b| if total(b) < total(a) { b } else { a })?;
    Some((total(number), HalfPlane { normal, offset: low + number as f64 * width }))
}

/// A strip across the direction, between `from` and `to`: all of its cells lie between `low` and `high`.
#[derive(Clone, Copy)]
struct Strip {
    from: f64,
    to: f64,
    low: f64,
    high: f64,
}

impl Strip {
    fn reversed(self) -> Self {
        Self { from: -self.to, to: -self.from, ..self }
    }
}

/// Returns the area of the convex hull of the first 1, 2, … strips, ascending in x.
fn areas(strips: impl Iterator<Item = Option<Strip>>) -> Vec<f64> {
    let (mut upper, mut lower) = (Chain::default(), Chain::default());
    let mut area = 0.0;
    let with = |strip: Option<Strip>| {
        if let Some(Strip { from, to, low, high }) = strip {
            for x in [from, to] {
                area = upper.with(DVec2::new(x, high)) + lower.with(DVec2::new(x, -low));
            }
        }
        area
    };
    strips.map(with).collect()
}

/// The upper convex chain of points ascending in x.
#[derive(Default)]
struct Chain {
    /// Each point of the chain, with the area under the chain up to there.
    points: Vec<(DVec2, f64)>,
}

impl Chain {
    /// Adds a point and returns the area under the chain.
    fn with(&mut self, p: DVec2) -> f64 {
        while let [.., (a, _), (b, _)] = self.points[..] {
            if (b - a).perp_dot(p - a) < 0.0 {
                break;
            }
            self.points.pop();
        }
        let area = self.points.last().map_or(0.0, |&(q, area)| area + 0.5 * (q.y + p.y) * (p.x - q.x));
        self.points.push((p, area));
        area
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::convex_hull;

    #[test]
    fn areas_of_the_first_strips_are_those_of_their_hulls() {
        let strip = |i: u32, low: f64, high: f64| Some(Strip { from: f64::from(i), to: f64::from(i) + 1.0, low, high });
        let strips = [strip(0, 0.0, 1.0), strip(1, -1.0, 4.0), None, strip(3, 2.0, 2.5), strip(4, -3.0, 0.0)];
        let mut points = Vec::new();
        for (number, area) in areas(strips.into_iter()).into_iter().enumerate() {
            points.extend(
                strips[number].iter().flat_map(|s| {
                    [s.from, s.to].into_iter().flat_map(|x| [DVec2::new(x, s.low), DVec2::new(x, s.high)])
                }),
            );
            let hull = convex_hull(&points);
            let exact: f64 =
                hull.windows(2).map(|pair| (pair[0] - hull[0]).perp_dot(pair[1] - hull[0])).sum::<f64>() / 2.0;
            assert!((area - exact).abs() < 1e-12, "{area} after {number} strips, {exact} expected");
        }
    }
}
