//! Offsets and tilts of planes inside their slabs.
//!
//! In each pair of pictures every plane has a random offset and two random tilts, and the opposite ones in the second picture. The credits
//! estimate the slope of the error (simultaneous perturbation; Spall 1992), and each parameter steps against it as in Adam (Kingma and Ba,
//! 2015), as far as the plane still holds all its leaves.

use glam::{DVec2, DVec3};

use super::parts::{Parts, Places};
use crate::geometry::Plane;
use crate::groups::Groups;
use crate::random::Stream;

/// Change of each parameter in a pair of pictures, and its greatest step, as shares of the greatest bound.
const CHANGE: f64 = 0.1;
const RATE: f64 = 0.1;

/// Share by which steps have become smaller at the end: each step has other views, and steps of one size would not come to rest.
const SLOWER: f64 = 0.8;

/// Memory of the mean slope and of the mean squared slope.
const MEMORY: (f64, f64) = (0.8, 0.9);

/// Tries to move a plane back until it holds all its leaves, and shares of the way that are tried then.
const TRIES: usize = 16;
const WAYS: [f64; 4] = [1.0, 0.5, 0.25, 0.125];

/// Share of a bound to which planes move back, so that rounding does not exceed it.
const INSIDE: f64 = 1.0 - 1e-4;

/// Least spread of a plane's leaves in R: smaller billboards do not tilt more.
const LEAST_SPREAD: f64 = 0.01;

/// A plane and its parameters: the offset, and the tilts as heights at the spread of its leaves; all in local units.
struct Slab {
    plane: Plane,
    centre: DVec3,
    /// Axes in the plane over the spread along them.
    axes: [DVec3; 2],
    at: DVec3,
    slope: DVec3,
    squared: DVec3,
}

impl Slab {
    fn new(plane: Plane, parts: &Parts, members: &[u32]) -> Self {
        let foliage = parts.foliage;
        let triangles = || members.iter().flat_map(|&part| parts.triangles(part as usize)).map(|&t| t as usize);
        let weighted =
            |t: usize| (foliage.corners(t).into_iter().sum::<DVec3>() / 3.0, foliage.area_vector(t).length());
        let area = triangles().map(|t| weighted(t).1).sum::<f64>().max(f64::MIN_POSITIVE);
        let sum: DVec3 = triangles().map(|t| weighted(t).0 * weighted(t).1).sum();
        let centre = plane.project(sum / area);
        let (x, y) = plane.axes();
        let square = |t: usize| {
            let (middle, area) = weighted(t);
            let away = DVec2::new(x.dot(middle - centre), y.dot(middle - centre));
            away * away * area
        };
        let squares = triangles().map(square).sum::<DVec2>() / area;
        let spread = [squares.x, squares.y].map(|square| square.sqrt().max(LEAST_SPREAD));
        let axes = [x / spread[0], y / spread[1]];
        Self { plane, centre, axes, at: DVec3::ZERO, slope: DVec3::ZERO, squared: DVec3::ZERO }
    }

    /// Returns the plane with other parameters.
    fn with(&self, at: DVec3) -> Plane {
        let normal = (self.plane.normal + self.axes[0] * at.y + self.axes[1] * at.z).normalize();
        Plane::through(self.centre + self.plane.normal * at.x, normal)
    }

    /// Steps against the slope, as far as all corners stay within their bounds.
    fn step(&mut self, slope: DVec3, rate: f64, grown: (f64, f64), corners: &[(DVec3, f64)]) {
        self.slope = self.slope * MEMORY.0 + slope * (1.0 - MEMORY.0);
        self.squared = self.squared * MEMORY.1 + slope * slope * (1.0 - MEMORY.1);
        let (mean, usual) = (self.slope / grown.0, (self.squared / grown.1).map(f64::sqrt));
        let change =
            DVec3::select(usual.cmpgt(DVec3::ZERO), mean / usual.max(DVec3::splat(f64::MIN_POSITIVE)), DVec3::ZERO);
        let wanted = self.inside(self.at - change * rate, corners);
        let holds = |at: &DVec3| {
            let plane = self.with(*at);
            corners.iter().all(|(corner, bound)| plane.height(*corner).abs() <= *bound)
        };
        self.at = WAYS.iter().map(|way| self.at.lerp(wanted, *way)).find(holds).unwrap_or(self.at);
    }

    /// Moves parameters back, each time as far as the corner needs that exceeds its bound the most.
    fn inside(&self, mut at: DVec3, corners: &[(DVec3, f64)]) -> DVec3 {
        for _ in 0..TRIES {
            let plane = self.with(at);
            let excess = |(corner, bound): &(DVec3, f64)| plane.height(*corner).abs() - bound * INSIDE;
            let worst = corners.iter().map(|each| (excess(each), each.0)).max_by(|a, b| a.0.total_cmp(&b.0));
            let Some((excess, corner)) = worst.filter(|(excess, _)| *excess > 0.0) else { break };
            let away = corner - self.centre;
            // The change of the height with the parameters, to first order.
            let slope = DVec3::new(-1.0, self.axes[0].dot(away), self.axes[1].dot(away));
            at -= slope * (plane.height(corner).signum() * excess / slope.length_squared());
        }
        at
    }
}

/// All planes while they move.
pub struct Slabs {
    all: Vec<Slab>,
    /// The corners on each plane, with their bounds.
    corners: Vec<Vec<(DVec3, f64)>>,
    /// Greatest bound.
    bound: f64,
    seed: u64,
    /// 1 − memory to the power of the steps so far.
    grown: (f64, f64),
}

impl Slabs {
    pub fn new(parts: &Parts, places: &Places, seed: u64) -> Self {
        let members = Groups::by_key(&places.parents, places.planes.len());
        let planes = || places.planes.iter().zip(members.iter());
        let all = planes().map(|(plane, members)| Slab::new(*plane, parts, members)).collect();
        let of = |members: &[u32]| members.iter().flat_map(|&part| parts.bounded(part as usize)).collect();
        let corners: Vec<Vec<(DVec3, f64)>> = planes().map(|(_, members)| of(members)).collect();
        let bound = corners.iter().flatten().map(|(_, bound)| *bound).fold(0.0, f64::max);
        Self { all, corners, bound, seed, grown: (0.0, 0.0) }
    }

    /// Returns the signs of all changes in a pair.
    pub fn signs(&self, pair: usize) -> Vec<DVec3> {
        let of_plane = |plane: usize| {
            let mut random = Stream::new(self.seed, pair, plane);
            DVec3::from_array(std::array::from_fn(|_| if random.unit() < 0.5 { 1.0 } else { -1.0 }))
        };
        (0..self.all.len()).map(of_plane).collect()
    }

    /// Returns the planes, changed by `share` of the changes with these signs.
    pub fn changed(&self, signs: &[DVec3], share: f64) -> Vec<Plane> {
        let change = CHANGE * self.bound * share;
        self.all.iter().zip(signs).map(|(slab, signs)| slab.with(slab.at + *signs * change)).collect()
    }

    /// Steps against mean slopes; `done` is the share of the steps done.
    pub fn step(&mut self, slopes: &[DVec3], done: f64) {
        self.grown = (1.0 - (1.0 - self.grown.0) * MEMORY.0, 1.0 - (1.0 - self.grown.1) * MEMORY.1);
        let rate = RATE * self.bound * (1.0 - SLOWER * done);
        for ((slab, slope), corners) in self.all.iter_mut().zip(slopes).zip(&self.corners) {
            slab.step(*slope, rate, self.grown, corners);
        }
    }

    /// Returns the planes.
    pub fn planes(&self) -> Vec<Plane> {
        self.all.iter().map(|slab| slab.with(slab.at)).collect()
    }
}
