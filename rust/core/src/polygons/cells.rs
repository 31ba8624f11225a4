//! The cells of a billboard that must be drawn: unit squares centered on the corners of texels.
//!
//! A texture filter interpolates between the centers of four texels. These centers are the corners of a cell, so a cell shows something if
//! any of its four texels does, and a polygon that covers all such cells loses nothing.

use glam::DVec2;

use super::convex::{HalfPlane, clipped};
use crate::geometry::convex_hull;

/// Half the side of a cell.
const HALF: f64 = 0.5;

/// A cell, by its center: column and row, from the lower left corner of the region.
pub(super) type Cell = [u16; 2];

/// Visible cells of a billboard's region.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cells {
    size: DVec2,
    centers: Vec<Cell>,
}

impl Cells {
    /// Returns the cells of a region of `width` × `height` texels for which `shows` holds. `shows` gets the column and row of a cell's center,
    /// from the lower left corner: 0 to `width` and 0 to `height`. Cells on the rim count with the part inside the region.
    #[must_use]
    pub fn new(width: usize, height: usize, shows: impl Fn(usize, usize) -> bool) -> Self {
        let all = (0..=height).flat_map(|row| (0..=width).map(move |column| (column, row)));
        let centers = all.filter(|&(column, row)| shows(column, row)).map(|(x, y)| [x as u16, y as u16]).collect();
        Self { size: DVec2::new(width as f64, height as f64), centers }
    }

    pub(super) fn centers(&self) -> &[Cell] {
        &self.centers
    }

    /// Returns the four half-planes of the region.
    pub(super) fn frame(&self) -> Vec<HalfPlane> {
        let line = |normal, offset| HalfPlane { normal, offset };
        vec![line(DVec2::NEG_X, 0.0), line(DVec2::NEG_Y, 0.0), line(DVec2::X, self.size.x), line(DVec2::Y, self.size.y)]
    }

    /// Returns the whole region.
    pub(super) fn region(&self) -> Vec<DVec2> {
        rectangle(DVec2::ZERO, self.size)
    }

    /// Returns the rectangle around all cells, within the region.
    pub(super) fn bounds(&self) -> Vec<DVec2> {
        let center = |c: &Cell| at(*c);
        let low = self.centers.iter().map(center).fold(DVec2::INFINITY, DVec2::min) - HALF;
        let high = self.centers.iter().map(center).fold(DVec2::NEG_INFINITY, DVec2::max) + HALF;
        rectangle(low.max(DVec2::ZERO), high.min(self.size))
    }
}

fn rectangle(low: DVec2, high: DVec2) -> Vec<DVec2> {
    vec![low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)]
}

pub(super) fn at(cell: Cell) -> DVec2 {
    DVec2::new(f64::from(cell[0]), f64::from(cell[1]))
}

/// Returns the distance from a cell's center within which a line with this unit normal meets the cell.
pub(super) fn reach(normal: DVec2) -> f64 {
    HALF * (normal.x.abs() + normal.y.abs())
}

/// Returns the cells that reach into a half-plane.
pub(super) fn within(cells: &[Cell], half: HalfPlane) -> Vec<Cell> {
    let least = half.offset + reach(half.normal) - 1e-9;
    cells.iter().copied().filter(|&cell| half.normal.dot(at(cell)) < least).collect()
}

/// Returns the convex hull of the cells' parts within all half-planes. Cells are sorted by rows.
pub(super) fn hull(cells: &[Cell], lines: &[HalfPlane]) -> Vec<DVec2> {
    let rows = cells.chunk_by(|a, b| a[1] == b[1]);
    let ends = rows.flat_map(|row| {
        let (first, last) = (at(row[0]), at(row[row.len() - 1]));
        [first + DVec2::new(-HALF, -HALF), first + DVec2::new(-HALF, HALF), last + DVec2::new(HALF, -HALF), last + HALF]
    });
    let hull = convex_hull(&ends.collect::<Vec<_>>());
    lines.iter().fold(hull, |polygon, line| clipped(&polygon, *line))
}
