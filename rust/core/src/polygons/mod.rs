//! Tight polygons: several convex polygons around the visible texels of a billboard, in place of its whole rectangle.
//!
//! Most of a billboard is transparent, and a renderer pays for each fragment of it. A binary tree of cuts divides each billboard
//! ([`tree`]): a cut is the line, of 16 directions, that leaves the least area in the convex hulls of both sides ([`cuts`]). Every node of the
//! tree has polygons of few corners around its cells ([`convex`]). One price per triangle for the whole level decides which nodes are drawn:
//! each tree is pruned from its leaves upward, so the area saved by a further triangle is the same everywhere. If that is more than the
//! budget of triangles, the price rises until they fit.
//!
//! The price is what a triangle costs to draw ([`Scale`]). Cuts are chosen one after another, so they are not the best set of cuts.
//! O(cells · depth) for each billboard; billboards are independent.

mod cells;
mod convex;
mod cuts;
mod tree;

use glam::DVec2;
use rayon::prelude::*;

pub use cells::Cells;
use tree::Tree;

/// A convex polygon in texels of a region, counter-clockwise: x to the right, y up, the origin in the lower left corner.
pub type Polygon = Vec<DVec2>;

/// Price of a triangle in fragments. Its vertices are transformed like fragments are shaded, about one vertex for each triangle, and its edges
/// are set up while the card could shade one or two quads. Eight fragments are two quads: a triangle that covers less costs mostly this.
pub const FRAGMENTS_PER_TRIANGLE: f64 = 8.0;

/// The size at which billboards are drawn, which sets the costs of edges and triangles relative to those of area.
///
/// A renderer shades quads of 2 × 2 pixels. A triangle hits those with a pixel center inside it. The centers of a quad are the corners of a
/// square of side 1. So in the mean over all positions, the fragments are at most the area of the triangle grown by that square, A + X + Y + 1,
/// where X and Y are its extents, and hardly less unless it is thinner than a pixel. In the mean over all directions of view and turns, A is
/// half of the triangle's own area, and X + Y half of its own perimeter (Cauchy).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Pixels along a unit of length, above 0. The unit of polygons is a texel.
    pub pixels_per_unit: f64,
    /// Triangles drawn for each triangle of a polygon: 2 for pairs of front and back billboards, else 1.
    pub copies: usize,
}

impl Scale {
    /// Returns the cost of a rectangle of this size, drawn as two triangles, in fragments.
    #[must_use]
    pub fn rectangle(self, size: DVec2) -> f64 {
        let (area, edges) = (size.element_product(), 2.0 * (size.element_sum() + size.length()));
        let fragments = 0.5 * self.pixels_per_unit * self.pixels_per_unit;
        fragments * (area + self.edge() * edges + 2.0 * self.triangle())
    }

    /// Returns the area that costs as much as an edge of length 1.
    fn edge(self) -> f64 {
        1.0 / self.pixels_per_unit
    }

    /// Returns the area that costs as much as a triangle of no size.
    fn triangle(self) -> f64 {
        let fragments = 1.0 + FRAGMENTS_PER_TRIANGLE * self.copies as f64;
        2.0 * fragments / (self.pixels_per_unit * self.pixels_per_unit)
    }
}

/// Settings of tight polygons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolygonSettings {
    /// Most corners of a polygon, at least 4.
    pub corners: usize,
    /// Most triangles of all polygons together, copies included. A billboard has at least one polygon, so there may be more.
    pub triangles: usize,
    /// The size at which the level is drawn.
    pub scale: Scale,
}

/// Returns polygons that cover the cells of each billboard and do not overlap by more than a tenth of a texel. A billboard without cells gets
/// its whole region.
#[must_use]
pub fn tight(billboards: &[Cells], settings: PolygonSettings) -> Vec<Vec<Polygon>> {
    let trees: Vec<Tree> = billboards.par_iter().map(|cells| Tree::grow(cells, &settings)).collect();
    let price = price(&trees, settings);
    trees.par_iter().map(|tree| tree.cheapest(price).polygons).collect()
}

/// Doublings of the price, and halvings between two doublings, in the search for the least one that meets the budget.
const DOUBLINGS: usize = 40;
const HALVINGS: usize = 7;

/// Returns the least price of a triangle, in texels, from its own cost up, at which all trees together meet the budget.
fn price(trees: &[Tree], settings: PolygonSettings) -> f64 {
    let least = settings.scale.triangle();
    let meets = |price: f64| {
        let triangles: usize = trees.iter().map(|tree| tree.cheapest(price).triangles).sum();
        triangles * settings.scale.copies <= settings.triangles
    };
    if meets(least) {
        return least;
    }
    let Some(high) = (1..DOUBLINGS).map(|n| least * (1u64 << n) as f64).find(|&price| meets(price)) else {
        return f64::MAX / 1e9; // One triangle less is worth any area.
    };
    let halve = |(low, high): (f64, f64), _| {
        let middle = (low * high).sqrt();
        if meets(middle) { (low, middle) } else { (middle, high) }
    };
    (0..HALVINGS).fold((high / 2.0, high), halve).1
}

#[cfg(test)]
mod tests;
