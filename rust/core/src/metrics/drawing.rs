//! What triangles cost a graphics card to draw, by a model: the fragments of their pixels, and a price for each triangle.
//!
//! A card shades quads of 2 × 2 pixels: a triangle that covers the center of any pixel of a quad costs four fragments. The counter sees the
//! triangles along parallel rays from [`VIEWS`] directions, culls the backs of single-sided triangles, and knows no early depth test, which
//! alpha-tested materials mostly lack. Corners lie on the grid of a card (1/256 of a pixel) and counts are integers, so results are exact and
//! the same with any number of threads.

use glam::DVec3;
use rayon::prelude::*;

use super::{Views, fragments::Counter};
use crate::error::{Error, Result};
use crate::foliage::Foliage;
use crate::polygons::FRAGMENTS_PER_TRIANGLE;
use crate::progress::Progress;
use crate::textures::Samples;

/// Number of directions.
const VIEWS: usize = 6;

/// Returns the views in which the cost of drawing is counted.
#[must_use]
pub fn counted_views(up: DVec3) -> Views {
    Views { count: VIEWS, size: 1, samples: Samples::default(), up, turn: 0.0 }
}

/// Greatest side of a counted picture, in pixels. Larger pictures are counted at this size, and their fragments scaled by area.
const LARGEST: f64 = 4096.0;

/// Cost of drawing a set of triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawingCost {
    /// Number of triangles.
    pub triangles: usize,
    /// Area of all sides that are drawn, in the caller's units squared: a double-sided triangle counts twice, a single-sided triangle once. So
    /// a pair of a front and a back billboard has the area of one double-sided billboard.
    pub area: f64,
    /// Fragment invocations, as the mean over the views.
    pub fragments: f64,
    /// Mean number of triangles that cover a pixel, over the pixels of all views that any triangle covers; 0 without such pixels.
    pub layers: f64,
}

impl DrawingCost {
    /// Returns the whole cost in fragments: a triangle costs [`FRAGMENTS_PER_TRIANGLE`].
    #[must_use]
    pub fn total(&self) -> f64 {
        self.fragments + FRAGMENTS_PER_TRIANGLE * self.triangles as f64
    }
}

/// Returns the cost of drawing all parts where a length of 1, in the caller's units, covers `scale` pixels. `up` is the trees' up direction.
///
/// # Errors
/// No parts; a `scale` that is not above 0 and finite; an `up` without a finite length above 0; [`Error::Cancelled`].
pub fn drawing_cost(parts: &[&Foliage], scale: f64, up: DVec3, progress: Progress) -> Result<DrawingCost> {
    let Some(first) = parts.first() else {
        return Err(Error::invalid("there are no parts to draw; give at least one foliage"));
    };
    check_scale(scale, up)?;
    let axes: Vec<[DVec3; 2]> = counted_views(up).around(first.frame()).map(|view| view.axes(view.direction)).collect();
    counted(parts, scale, &axes, progress)
}

/// Checks that a length of 1 covers a number of pixels, and that `up` is a direction.
pub(crate) fn check_scale(scale: f64, up: DVec3) -> Result<()> {
    if !(scale > 0.0 && scale.is_finite()) {
        return Err(Error::invalid(format!(
            "a length of 1 covers {scale:?} pixels; the number must be above 0 and finite"
        )));
    }
    check_up(up)
}

/// Checks that `up` is a direction.
pub(crate) fn check_up(up: DVec3) -> Result<()> {
    if up.is_finite() && up.try_normalize().is_some() {
        return Ok(());
    }
    Err(Error::invalid(format!("up is {:?}; it needs a finite length above 0", up.to_array())))
}

/// Returns the cost in views with these axes of the picture, to the right and up.
fn counted(parts: &[&Foliage], scale: f64, axes: &[[DVec3; 2]], progress: Progress) -> Result<DrawingCost> {
    let centre = parts[0].frame().centre;
    let reach = parts.iter().map(|part| part.frame().centre.distance(centre) + part.frame().radius).fold(0.0, f64::max);
    let shrunk = (2.0 * reach * scale / LARGEST).max(1.0);
    let seen = |&[right, up]: &[DVec3; 2]| {
        progress.tell("draw", 0.0)?;
        let mut counter = Counter::new(reach * scale / shrunk);
        for part in parts {
            let place = |corner: DVec3| {
                let q = (part.frame().to_caller(corner) - centre) * (scale / shrunk);
                [right.dot(q), up.dot(q)]
            };
            for triangle in 0..part.triangle_count() {
                counter.draw(part.corners(triangle).map(place), part.material(triangle).double_sided);
            }
        }
        Ok(counter.counts())
    };
    let views: Vec<_> = axes.par_iter().map(seen).collect::<Result<_>>()?;
    let sum = |each: fn(&super::fragments::Counts) -> u64| views.iter().map(each).sum::<u64>() as f64;
    Ok(DrawingCost {
        triangles: parts.iter().map(|part| part.triangle_count()).sum(),
        area: parts.iter().map(|part| drawn_area(part)).sum(),
        fragments: 4.0 * sum(|view| view.quads) * shrunk * shrunk / axes.len() as f64,
        layers: sum(|view| view.samples) / sum(|view| view.pixels).max(1.0),
    })
}

fn drawn_area(part: &Foliage) -> f64 {
    let sides = |triangle| if part.material(triangle).double_sided { 2.0 } else { 1.0 };
    let local: f64 = (0..part.triangle_count()).map(|t| sides(t) * part.area_vector(t).length()).sum();
    local * part.frame().radius * part.frame().radius
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::{Attributes, Material};

    const FRONT: [[DVec3; 2]; 1] = [[DVec3::X, DVec3::Y]];
    const BACK: [[DVec3; 2]; 1] = [[DVec3::NEG_X, DVec3::Y]];

    /// Squares of 2 × 2 that face +z, one for each height, single- or double-sided.
    fn squares(heights: &[f64], double_sided: bool) -> Foliage {
        let corner = |z: f64| [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z));
        let positions: Vec<DVec3> = heights.iter().flat_map(|&z| corner(z)).collect();
        let triangles = (0..heights.len() as u32).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| 4 * i + k)));
        let material = Material { double_sided, ..Material::default() };
        Foliage::new(&positions, triangles.collect(), Attributes::default(), vec![material]).unwrap()
    }

    fn cost(foliage: &Foliage, scale: f64, axes: &[[DVec3; 2]]) -> DrawingCost {
        counted(&[foliage], scale, axes, Progress::silent()).unwrap()
    }

    #[test]
    fn a_square_costs_its_pixels_and_the_quads_of_its_diagonal_twice() {
        for pixels in [4.0, 16.0, 200.0] {
            let found = cost(&squares(&[0.0], true), pixels / 2.0, &FRONT);
            assert_eq!(found.fragments, pixels * pixels + 2.0 * pixels, "{pixels} pixels");
            assert_eq!((found.layers, found.triangles), (1.0, 2), "no pixel of the diagonal counts twice");
            assert!((found.area - 8.0).abs() < 1e-12, "two sides");
        }
    }

    #[test]
    fn pictures_that_are_too_large_are_scaled() {
        let pixels = 65_536.0;
        let found = cost(&squares(&[0.0], true), pixels / 2.0, &FRONT).fragments;
        assert!((found / (pixels * pixels) - 1.0).abs() < 2e-3, "{found}");
    }

    #[test]
    fn layers_add_up_and_backs_are_culled() {
        let (one, three) = (squares(&[0.0], false), squares(&[-0.1, 0.0, 0.1], false));
        let (single, stack) = (cost(&one, 8.0, &FRONT), cost(&three, 8.0, &FRONT));
        assert_eq!((stack.layers, stack.fragments), (3.0, 3.0 * single.fragments));
        assert_eq!((cost(&three, 8.0, &BACK).fragments, cost(&three, 8.0, &BACK).layers), (0.0, 0.0));
        assert_eq!(cost(&squares(&[0.0], true), 8.0, &BACK), cost(&squares(&[0.0], true), 8.0, &FRONT));
        assert!((single.area - 4.0).abs() < 1e-12, "one side");
        assert_eq!(single.total(), single.fragments + 16.0);
    }

    #[test]
    fn parts_add_up_and_threads_change_nothing() {
        let (leaves, trunk) = (squares(&[-0.2, 0.3], true), squares(&[0.0], false));
        let found = |parts: &[&Foliage]| drawing_cost(parts, 31.0, DVec3::Z, Progress::silent()).unwrap();
        let (both, alone) = (found(&[&leaves, &trunk]), found(&[&leaves]));
        assert!(both.fragments > alone.fragments && both.triangles == 6);
        for threads in [1, 2, 7] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert_eq!(pool.install(|| found(&[&leaves, &trunk])), both);
        }
    }

    #[test]
    fn a_convex_body_costs_a_quarter_of_its_area_on_average() {
        // Cauchy: the mean shadow of a convex body is a quarter of its surface, here 6 · 4; six directions come near it.
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let side = |i: usize| {
            let (n, u, v) = (axes[i % 3], axes[(i + 1) % 3], axes[(i + 2) % 3]);
            let (n, u) = if i < 3 { (n, u) } else { (-n, -u) };
            [n - u - v, n + u - v, n + u + v, n - u + v]
        };
        let positions: Vec<DVec3> = (0..6).flat_map(side).collect();
        let triangles = (0..6u32).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| 4 * i + k))).collect();
        let material = Material { double_sided: false, ..Material::default() };
        let cube = Foliage::new(&positions, triangles, Attributes::default(), vec![material]).unwrap();
        let found = drawing_cost(&[&cube], 200.0, DVec3::new(0.3, 0.2, 0.9), Progress::silent()).unwrap();
        let shadow = 24.0 / 4.0 * 200.0 * 200.0;
        assert!((found.fragments / shadow - 1.0).abs() < 0.1, "{} of {shadow}", found.fragments);
        assert_eq!(found.layers, 1.0, "culling leaves the sides that face the eye");
    }

    #[test]
    fn wrong_input_is_refused() {
        let leaf = squares(&[0.0], true);
        let refused = |parts: &[&Foliage], scale, up| drawing_cost(parts, scale, up, Progress::silent()).is_err();
        assert!(refused(&[], 1.0, DVec3::Z));
        for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(refused(&[&leaf], scale, DVec3::Z), "{scale}");
        }
        assert!(refused(&[&leaf], 1.0, DVec3::ZERO));
        let stopped = drawing_cost(&[&leaf], 1.0, DVec3::Z, Progress::new(&|_, _| false));
        assert!(matches!(stopped, Err(Error::Cancelled)));
    }
}
