//! Billboard outlines: a rectangle around the visible triangles of each plane.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::foliage::{Opacity, place};
use crate::geometry::{Outline, Plane, minimum_rectangle};
use crate::groups::Groups;

/// Returns the outline of each plane around the opaque parts of its triangles; `targets` returns a triangle's corners. A plane without
/// opaque parts gets the outline of all its triangles.
#[must_use]
pub fn outlines(
    planes: &[Plane],
    parents: &[u32],
    targets: impl Fn(usize) -> [DVec3; 3] + Sync,
    opacity: &Opacity,
) -> Vec<Outline> {
    let triangles = Groups::by_key(parents, planes.len());
    let outline = |(number, plane): (usize, &Plane)| {
        let triangles = triangles.get(number);
        let seen = triangles.iter().flat_map(|&t| {
            let corners = targets(t as usize);
            opacity.get(t as usize).hull.iter().map(move |&weights| place(&corners, weights))
        });
        let mut points = in_plane(plane, seen);
        if points.is_empty() {
            points = in_plane(plane, triangles.iter().flat_map(|&t| targets(t as usize)));
        }
        minimum_rectangle(&points)
    };
    planes.par_iter().enumerate().map(outline).collect()
}

/// Returns points as 2D coordinates along the plane's axes.
pub fn in_plane(plane: &Plane, points: impl Iterator<Item = DVec3>) -> Vec<DVec2> {
    let (x, y) = plane.axes();
    points.map(|p| DVec2::new(x.dot(p), y.dot(p))).collect()
}
