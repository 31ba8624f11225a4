//! A tree of cuts through the cells of one billboard, and the polygons that are cheapest at a price.

use super::cells::{Cell, Cells, hull, within};
use super::convex::{HalfPlane, Shape, reduced, widened};
use super::cuts::cuts;
use super::{Polygon, PolygonSettings};

/// Cuts that are tried exactly, of the best of all directions.
const TRIED: usize = 3;

/// Most cuts from the whole billboard to a polygon.
const DEEPEST: usize = 12;

/// Width by which the two sides of a cut overlap beyond it, texels. Polygons that meet without sharing their corners would show gaps of single
/// pixels, where coordinates round apart.
const OVERLAP: f64 = 0.05;

/// Number of half-planes of a region.
const FRAME: usize = 4;

/// Part of a billboard: polygons around its cells, and its two halves if cutting it may pay.
struct Node {
    shapes: Vec<Shape>,
    halves: Option<[usize; 2]>,
}

/// All nodes of a billboard, parents before their halves.
pub(super) struct Tree {
    nodes: Vec<Node>,
    /// Area that costs as much as an edge of a texel.
    edge: f64,
}

/// Polygons of a billboard, with the number of their triangles.
#[derive(Debug, Default)]
pub(super) struct Choice {
    pub triangles: usize,
    pub polygons: Vec<Polygon>,
}

/// Cells on one side of all cuts so far.
struct Part {
    cells: Vec<Cell>,
    lines: Vec<HalfPlane>,
    shapes: Vec<Shape>,
}

impl Part {
    /// Returns the parts on both sides of a cut; `None` if no polygon of few corners holds the cells of a side.
    fn halves(&self, cut: HalfPlane, corners: usize) -> Option<[Self; 2]> {
        let side = |half: HalfPlane| {
            let (cells, lines) = (within(&self.cells, half), [&self.lines[..], &[half]].concat());
            let shapes = reduced(hull(&cells, &lines), &lines, corners);
            (!shapes.is_empty()).then_some(Self { cells, lines, shapes })
        };
        Some([side(cut)?, side(HalfPlane { normal: -cut.normal, offset: -cut.offset })?])
    }

    /// Returns the shapes, widened beyond the cuts.
    fn overlapping(&self) -> Vec<Shape> {
        let (frame, cuts) = self.lines.split_at(FRAME);
        let wider = |shape: &Shape| {
            let corners =
                cuts.iter().fold(shape.corners.clone(), |corners, cut| widened(corners, *cut, OVERLAP, frame));
            Shape::new(corners)
        };
        self.shapes.iter().map(wider).collect()
    }
}

impl Tree {
    /// Returns the tree in which every cut may pay at the cost of a triangle.
    pub fn grow(cells: &Cells, settings: &PolygonSettings) -> Self {
        let mut tree = Self { nodes: Vec::new(), edge: settings.scale.edge() };
        let lines = cells.frame();
        if cells.centers().is_empty() {
            tree.nodes.push(Node { shapes: vec![Shape::new(cells.region())], halves: None });
            return tree;
        }
        // The rectangle makes sure that there is a polygon.
        let mut shapes = reduced(hull(cells.centers(), &lines), &lines, settings.corners);
        shapes.push(Shape::new(cells.bounds()));
        tree.add(&Part { cells: cells.centers().to_vec(), lines, shapes }, settings, DEEPEST);
        tree
    }

    /// Adds a part and what cutting it gives, and returns its number.
    fn add(&mut self, part: &Part, settings: &PolygonSettings, depth: usize) -> usize {
        let number = self.nodes.len();
        let halves = if depth > 0 { self.best_halves(part, settings) } else { None };
        self.nodes.push(Node { shapes: part.overlapping(), halves: None });
        if let Some(halves) = halves {
            let halves = halves.map(|half| self.add(&half, settings, depth - 1));
            self.nodes[number].halves = Some(halves);
        }
        number
    }

    /// Returns the halves of the cheapest cut; `None` if the part's empty area costs less than another triangle.
    fn best_halves(&self, part: &Part, settings: &PolygonSettings) -> Option<[Part; 2]> {
        let price = settings.scale.triangle();
        let least = |part: &Part| part.shapes.iter().map(|shape| self.cost(shape, price)).fold(f64::INFINITY, f64::min);
        let area = part.shapes.iter().map(|shape| shape.area).fold(f64::INFINITY, f64::min);
        if area - part.cells.len() as f64 <= price {
            return None;
        }
        let halves = cuts(&part.cells).into_iter().take(TRIED).filter_map(|cut| part.halves(cut, settings.corners));
        let judged = halves.map(|halves| (least(&halves[0]) + least(&halves[1]), halves));
        judged.reduce(|a, b| if b.0 < a.0 { b } else { a }).map(|(_, halves)| halves)
    }

    fn cost(&self, shape: &Shape, price: f64) -> f64 {
        shape.area + self.edge * shape.edges + price * shape.triangles() as f64
    }

    /// Returns the cheapest polygons at this price of a triangle, in texels. O(nodes).
    pub fn cheapest(&self, price: f64) -> Choice {
        let mut costs = vec![0.0; self.nodes.len()];
        let mut whole = vec![None; self.nodes.len()];
        for (number, node) in self.nodes.iter().enumerate().rev() {
            let own = |shape: &Shape| self.cost(shape, price);
            let best = node.shapes.iter().reduce(|a, b| if own(b) < own(a) { b } else { a }).expect("a shape each");
            let parted = node.halves.map_or(f64::INFINITY, |halves| halves.map(|half| costs[half]).iter().sum());
            costs[number] = own(best).min(parted);
            whole[number] = (own(best) <= parted).then_some(best);
        }
        let mut choice = Choice::default();
        let mut open = vec![0];
        while let Some(number) = open.pop() {
            match (whole[number], self.nodes[number].halves) {
                (Some(shape), _) => {
                    choice.triangles += shape.triangles();
                    choice.polygons.push(shape.corners.clone());
                }
                (None, halves) => open.extend(halves.into_iter().flatten().rev()),
            }
        }
        choice
    }
}
