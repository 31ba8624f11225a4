//! What a fit decides: planes, the parent of every triangle, and how far each really moves.

use crate::foliage::Foliage;
use crate::geometry::Plane;
use crate::sums::Total;

/// A set of planes that stands for a foliage mesh.
#[derive(Clone, Debug)]
pub struct Cloud {
    /// In the foliage's local frame.
    pub planes: Vec<Plane>,
    /// The plane of each triangle.
    pub parents: Vec<u32>,
    /// The greatest distance of each triangle's vertices to its plane, caller's units, in f64.
    pub deviations: Vec<f64>,
    /// The bound that holds for all of `deviations`, caller's units.
    pub bound: f64,
}

impl Cloud {
    /// Measures the deviations of an assignment.
    #[must_use]
    pub fn new(foliage: &Foliage, planes: Vec<Plane>, parents: Vec<u32>, bound: f64) -> Self {
        let radius = foliage.frame().radius;
        let deviation = |(triangle, &parent): (usize, &u32)| {
            let plane = planes[parent as usize];
            foliage.corners(triangle).map(|p| plane.height(p).abs()).into_iter().fold(0.0, f64::max) * radius
        };
        let deviations = parents.iter().enumerate().map(deviation).collect();
        Self { planes, parents, deviations, bound }
    }

    /// The greatest deviation, caller's units.
    #[must_use]
    pub fn max_deviation(&self) -> f64 {
        self.deviations.iter().copied().fold(0.0, f64::max)
    }

    /// The area-weighted mean of the deviations, caller's units.
    #[must_use]
    pub fn mean_deviation(&self, foliage: &Foliage) -> f64 {
        let (mut moved, mut whole) = (Total::default(), Total::default());
        for (t, deviation) in self.deviations.iter().enumerate() {
            let area = foliage.area_vector(t).length();
            moved.add(area * deviation);
            whole.add(area);
        }
        moved.get() / whole.get()
    }
}
