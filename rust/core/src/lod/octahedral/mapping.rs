//! The hemi-octahedral map between directions and the grid of views (Cigolla, Wang, Dong, Haine, Sillion, "Survey of Efficient
//! Representations for Independent Unit Vectors", 2014), and the three views around a direction.
//!
//! Directions have the length 1 and z up. Trees are also seen from a little below, as on a slope, so z counts as z + [`BELOW`] (|x| + |y|). A
//! direction is divided by its |x| + |y| + z, counted so; then u = x + y and v = x − y go from −1 to 1 over the grid, with up in the middle and the
//! lowest views along the border: 27° to 35° below the horizon. Closed forms, exact to rounding.

use glam::{DVec2, DVec3};

/// How far the views reach below the horizon: the tangent of the angle, toward the axes.
pub const BELOW: f64 = 0.5;

/// A view of the grid, and its weight in the picture from a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weighted {
    /// Column, from the left.
    pub column: usize,
    /// Row, from the top.
    pub row: usize,
    /// Weight; the three weights sum to 1.
    pub weight: f64,
}

/// Returns the direction of the grid's point `place`, in views: the inverse of [`to_grid`].
#[must_use]
pub fn from_grid(place: DVec2, grid: usize) -> DVec3 {
    let p = place * (2.0 / (grid - 1) as f64) - 1.0;
    let (x, y) = (0.5 * (p.x + p.y), 0.5 * (p.x - p.y));
    let sum = x.abs() + y.abs();
    DVec3::new(x, y, (1.0 - sum).max(0.0) - BELOW * sum).normalize()
}

/// Returns the place of a direction on the grid, in views: x is the column, y the row. Directions below the lowest views have the place of the
/// lowest.
#[must_use]
pub fn to_grid(direction: DVec3, grid: usize) -> DVec2 {
    let level = direction.x.abs() + direction.y.abs();
    let sum = level + (direction.z + BELOW * level).max(0.0);
    let (x, y) = (direction.x / sum.max(f64::MIN_POSITIVE), direction.y / sum.max(f64::MIN_POSITIVE));
    (DVec2::new(x + y, x - y) * 0.5 + 0.5) * (grid - 1) as f64
}

/// Returns the three views around a direction: the corners of its triangle on the grid. Their weights are the squares of the barycentric ones,
/// over the sum of the squares: the nearest view counts more, so that less of the leaves' texture is lost in the blend. Each cell is divided
/// along the diagonal from its first corner. Weights are continuous in the direction.
#[must_use]
pub fn around(direction: DVec3, grid: usize) -> [Weighted; 3] {
    let place = to_grid(direction, grid);
    let cell = place.floor().clamp(DVec2::ZERO, DVec2::splat((grid - 2) as f64));
    let within = (place - cell).clamp(DVec2::ZERO, DVec2::ONE);
    let (column, row) = (cell.x as usize, cell.y as usize);
    let right = usize::from(within.x > within.y);
    let near =
        [1.0 - within.max_element(), (within.x - within.y).abs(), within.min_element()].map(|share| share * share);
    let sum: f64 = near.iter().sum();
    let [first, second, third] = near.map(|square| square / sum);
    [
        Weighted { column, row, weight: first },
        Weighted { column: column + right, row: row + 1 - right, weight: second },
        Weighted { column: column + 1, row: row + 1, weight: third },
    ]
}

/// Returns the axes to the right and up of a picture seen from `direction`. Straight from above, x is to the right.
#[must_use]
pub fn axes(direction: DVec3) -> [DVec3; 2] {
    let across = DVec3::new(-direction.y, direction.x, 0.0);
    let right = if across.length() > 1e-6 { across.normalize() } else { DVec3::X };
    [right, direction.cross(right)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common::random::Random;

    fn directions() -> impl Iterator<Item = DVec3> {
        let mut random = Random(7);
        std::iter::repeat_with(move || DVec3::from_array(std::array::from_fn(|_| random.signed())))
            .filter(|d| d.length() > 0.1)
            .map(|d| DVec3::new(d.x, d.y, d.z.max(-BELOW * (d.x.abs() + d.y.abs()))).normalize())
            .take(2000)
    }

    #[test]
    fn the_grid_has_up_in_its_middle_and_the_axes_below_the_horizon_in_its_corners() {
        let close = |a: DVec3, b: DVec3| assert!(a.distance(b) < 1e-12, "{a} {b}");
        close(from_grid(DVec2::splat(2.0), 5), DVec3::Z);
        let lowest = |x: f64, y: f64| DVec3::new(x, y, -0.5).normalize();
        close(from_grid(DVec2::new(4.0, 4.0), 5), lowest(1.0, 0.0));
        close(from_grid(DVec2::new(4.0, 0.0), 5), lowest(0.0, 1.0));
        close(from_grid(DVec2::new(0.0, 0.0), 5), lowest(-1.0, 0.0));
        close(from_grid(DVec2::new(0.0, 4.0), 5), lowest(0.0, -1.0));
        // The middle of a side lies between two axes.
        close(from_grid(DVec2::new(4.0, 2.0), 5), lowest(0.5, 0.5));
        // Along an axis, z = 0 at 1 − s − s / 2 = 0, which is two thirds of the way from the middle to the corner.
        close(from_grid(DVec2::splat(2.0 + 2.0 * 2.0 / 3.0), 5), DVec3::X);
    }

    #[test]
    fn directions_survive_the_way_to_the_grid_and_back() {
        for direction in directions() {
            let back = from_grid(to_grid(direction, 16), 16);
            assert!(back.distance(direction) < 1e-12, "{direction} {back}");
        }
    }

    #[test]
    fn weights_sum_to_one_and_restore_the_place() {
        for direction in directions() {
            let views = around(direction, 16);
            let sum: f64 = views.iter().map(|view| view.weight).sum();
            let roots: f64 = views.iter().map(|view| view.weight.sqrt()).sum();
            let part = |v: &Weighted| DVec2::new(v.column as f64, v.row as f64) * v.weight.sqrt() / roots;
            let place: DVec2 = views.iter().map(part).sum();
            assert!((sum - 1.0).abs() < 1e-12 && views.iter().all(|view| view.weight >= 0.0));
            assert!(
                place.distance(to_grid(direction, 16)) < 1e-12,
                "the roots are barycentric: they restore the point"
            );
            assert!(views.iter().all(|view| view.column < 16 && view.row < 16));
        }
    }

    #[test]
    fn a_view_of_the_grid_is_drawn_alone() {
        for (column, row) in [(0, 0), (3, 5), (15, 0), (15, 15), (7, 8)] {
            let views = around(from_grid(DVec2::new(column as f64, row as f64), 16), 16);
            let own: f64 = views.iter().filter(|v| (v.column, v.row) == (column, row)).map(|v| v.weight).sum();
            assert!((own - 1.0).abs() < 1e-12, "{views:?}");
        }
    }

    #[test]
    fn below_the_lowest_views_the_lowest_are_drawn() {
        let lowest = DVec3::new(0.6, 0.8, -0.7).normalize();
        let lower = DVec3::new(0.3, 0.4, -0.9).normalize();
        assert!(to_grid(lower, 16).distance(to_grid(lowest, 16)) < 1e-12);
        assert!(to_grid(DVec3::NEG_Z, 16).is_finite());
    }

    #[test]
    fn axes_are_right_handed_and_upright() {
        for direction in directions().chain([DVec3::Z, DVec3::X]) {
            let [right, up] = axes(direction);
            assert!(right.cross(up).distance(direction) < 1e-12);
            assert!(right.z == 0.0 && up.z >= 0.0);
        }
    }
}
