//! The leaves on their planes, while leaves and planes move.

use glam::DVec3;
use rayon::prelude::*;

use crate::cloud::Cloud;
use crate::fit::{ImageBound, motion_bound};
use crate::foliage::Foliage;
use crate::geometry::Plane;
use crate::groups::{Groups, number_by_appearance};
use crate::transition::{HAND_OVER, Lay, leaf_pivots};

/// Planes, and the plane of each part.
#[derive(Clone)]
pub struct Places {
    pub planes: Vec<Plane>,
    pub parents: Vec<u32>,
}

/// Parts: the triangles of a leaf that lie on one plane. They move together, so that no leaf is torn that was not.
pub struct Parts<'a> {
    pub foliage: &'a Foliage,
    /// Limit of the stretch.
    stretch: f64,
    /// How far the corners of each triangle may be from a plane, in local units.
    bounds: Vec<f64>,
    triangles: Groups,
    part_of: Vec<u32>,
    /// The pivot of each part's leaf.
    pivots: Vec<DVec3>,
}

/// Number of parts or triangles of a task: less is slower than on one thread.
const TASK: usize = 256;

impl<'a> Parts<'a> {
    /// Returns the parts of a cloud, and their places. Their new planes keep the bound of the cloud, and move no leaf farther than the
    /// leaf that moved the farthest before: the level takes over at the same distance.
    pub fn new(foliage: &'a Foliage, cloud: &Cloud, stretch: f64, image: Option<ImageBound>) -> (Self, Places) {
        let (part_of, count) = number_by_appearance(foliage.leaf_ids().iter().zip(&cloud.parents));
        let triangles = Groups::by_key(&part_of, count);
        let leaf_pivots = leaf_pivots(foliage);
        let first = |part: usize| triangles.get(part)[0] as usize;
        let pivots = (0..count).map(|part| leaf_pivots[foliage.leaf_ids()[first(part)] as usize]).collect();
        let parents = (0..count).map(|part| cloud.parents[first(part)]).collect();
        let bound = cloud.bound.min(cloud.max_deviation());
        let bounds = (0..foliage.triangle_count()).map(|t| motion_bound(foliage, t, bound, image)).collect();
        let places = Places { planes: cloud.planes.clone(), parents };
        (Self { foliage, stretch, bounds, triangles, part_of, pivots }, places)
    }

    pub fn len(&self) -> usize {
        self.pivots.len()
    }

    /// Returns the part of a triangle.
    pub fn of(&self, triangle: u32) -> usize {
        self.part_of[triangle as usize] as usize
    }

    /// Returns the triangles of a part.
    pub fn triangles(&self, part: usize) -> &[u32] {
        self.triangles.get(part)
    }

    /// Returns the corners of a part on a plane at a = 1.
    pub fn on(&self, plane: Plane, part: usize) -> Vec<DVec3> {
        let lay = self.lay(part, plane);
        self.bounded(part).map(|(corner, _)| lay.target(corner)).collect()
    }

    /// Returns the corners of all triangles at the hand-over.
    pub fn collapsed(&self, planes: &[Plane], parents: &[u32]) -> Vec<[DVec3; 3]> {
        let lay = |part: usize| self.lay(part, planes[parents[part] as usize]);
        let lays: Vec<Lay> = (0..self.len()).into_par_iter().with_min_len(TASK).map(lay).collect();
        let corners = |t: usize| {
            let lay = &lays[self.part_of[t] as usize];
            self.foliage.corners(t).map(|corner| corner.lerp(lay.target(corner), HAND_OVER))
        };
        (0..self.foliage.triangle_count()).into_par_iter().with_min_len(TASK).map(corners).collect()
    }

    fn lay(&self, part: usize, plane: Plane) -> Lay {
        Lay::new(self.foliage, self.triangles(part), plane, self.pivots[part], self.stretch)
    }

    /// Returns the corners of a part, each with the bound of its triangle.
    pub fn bounded(&self, part: usize) -> impl Iterator<Item = (DVec3, f64)> + '_ {
        let of = |&t: &u32| self.foliage.corners(t as usize).map(|corner| (corner, self.bounds[t as usize]));
        self.triangles(part).iter().flat_map(of)
    }

    /// Returns whether a plane holds a part within its bounds.
    pub fn hold(&self, plane: &Plane, part: usize) -> bool {
        self.bounded(part).all(|(corner, bound)| plane.height(corner).abs() <= bound)
    }

    /// Returns the parent of each triangle.
    pub fn spread(&self, parents: &[u32]) -> Vec<u32> {
        self.part_of.iter().map(|&part| parents[part as usize]).collect()
    }

    /// Returns the cloud of these places, without planes that lost all their leaves.
    pub fn cloud(&self, places: &Places, bound: f64) -> Cloud {
        let mut number = vec![u32::MAX; places.planes.len()];
        places.parents.iter().for_each(|&parent| number[parent as usize] = 0);
        let mut planes = Vec::new();
        for (number, plane) in number.iter_mut().zip(&places.planes).filter(|(number, _)| **number == 0) {
            *number = planes.len() as u32;
            planes.push(*plane);
        }
        let parents: Vec<u32> = places.parents.iter().map(|&parent| number[parent as usize]).collect();
        Cloud::new(self.foliage, planes, self.spread(&parents), bound)
    }
}
