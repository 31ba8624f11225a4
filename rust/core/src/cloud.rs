//! Result of a fit: planes, the parent plane of each triangle, and the deviation of each triangle.

use crate::foliage::Foliage;
use crate::geometry::Plane;
use crate::sums::Total;

/// A set of planes that replaces a foliage mesh.
#[derive(Clone, Debug)]
pub struct Cloud {
    /// The planes, in the foliage's local frame.
    pub planes: Vec<Plane>,
    /// Index of the plane of each triangle.
    pub parents: Vec<u32>,
    /// The greatest distance of each triangle's corners from its plane, in the caller's units, measured in f64.
    pub deviations: Vec<f64>,
    /// Upper bound of `deviations`, in the caller's units.
    pub bound: f64,
}

impl Cloud {
    /// Makes a cloud and measures its deviations.
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

    /// Returns the greatest deviation, in the caller's units.
    #[must_use]
    pub fn max_deviation(&self) -> f64 {
        self.deviations.iter().copied().fold(0.0, f64::max)
    }

    /// Returns the area-weighted mean deviation, in the caller's units.
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
