//! The triangles that a plane's billboard shows.
//!
//! A billboard shows the triangles that morph onto it. A leaf on several billboards is torn: it shows a crack between them. Where many
//! leaves are torn, as broad curved ones are, each billboard shows a strip more of its leaves: their other triangles, as far as these lie
//! within ε of its plane.
//!
//! To close gaps between billboards, as Décoret et al. do (2003, §4.4), it can also
//! show the parts of all other triangles within ε of its plane, clipped to that slab and to the billboard. These extra triangles are not
//! stretched and do not morph: each triangle still has one parent. They make crowns denser; the alpha cutoff compensates for part of that.

use glam::DVec3;

use crate::cloud::Cloud;
use crate::foliage::Foliage;
use crate::geometry::Plane;
use crate::groups::Groups;
use crate::textures::Drawn;
use crate::transition::Projection;

/// Share of torn leaves from which billboards show strips of them. With fewer, a strip more changes nothing that one sees
/// (`docs/decisions/torn_leaves.md`).
const MANY_TORN: f64 = 0.25;

/// Returns whether many leaves have triangles on several planes.
pub fn tears_many(foliage: &Foliage, cloud: &Cloud) -> bool {
    let leaves = foliage.leaves();
    let is_torn = |leaf: &[u32]| leaf.iter().any(|&t| cloud.parents[t as usize] != cloud.parents[leaf[0] as usize]);
    let torn = (0..leaves.len()).filter(|&leaf| is_torn(leaves.get(leaf))).count();
    torn as f64 > MANY_TORN * leaves.len() as f64
}

/// Returns a function that lists a plane's own triangles, those that morph onto it.
pub fn own_triangles<'a>(
    foliage: &'a Foliage,
    cloud: &'a Cloud,
    projection: &'a Projection,
) -> impl Fn(u32) -> Vec<Drawn<'a>> + Sync {
    let triangles = Groups::by_key(&cloud.parents, cloud.planes.len());
    move |plane| {
        let own = |&triangle: &u32| {
            let triangle = triangle as usize;
            let (targets, corners) = (projection.targets[triangle], foliage.corners(triangle));
            Drawn { foliage, triangle, targets, corners, reach: f64::INFINITY }
        };
        triangles.get(plane as usize).iter().map(own).collect()
    }
}

/// Returns a function that lists a plane's own triangles, and the other triangles of their leaves that reach into its slab.
pub fn with_torn_leaves<'a>(
    foliage: &'a Foliage,
    cloud: &'a Cloud,
    projection: &'a Projection,
) -> impl Fn(u32) -> Vec<Drawn<'a>> + Sync {
    let own = own_triangles(foliage, cloud, projection);
    let (leaves, leaf_ids) = (foliage.leaves(), foliage.leaf_ids());
    move |number| {
        let drawn = own(number);
        let mut shown: Vec<u32> = drawn.iter().map(|each| leaf_ids[each.triangle]).collect();
        shown.sort_unstable();
        shown.dedup();
        let others = shown.into_iter().flat_map(|leaf| leaves.get(leaf as usize)).map(|&triangle| triangle as usize);
        let others: Vec<Drawn> = others.filter_map(|t| crossing(foliage, cloud, number, t)).collect();
        drawn.into_iter().chain(others).collect()
    }
}

/// Returns a function that lists a plane's own triangles and the others that reach into its slab. O(planes · triangles).
pub fn all_triangles<'a>(
    foliage: &'a Foliage,
    cloud: &'a Cloud,
    projection: &'a Projection,
) -> impl Fn(u32) -> Vec<Drawn<'a>> + Sync {
    let own = own_triangles(foliage, cloud, projection);
    move |number| {
        let others = (0..foliage.triangle_count()).filter_map(|t| crossing(foliage, cloud, number, t));
        own(number).into_iter().chain(others).collect()
    }
}

/// Returns a triangle with another parent as far as it lies within ε of the plane; `None` for a plane's own triangles, and if it lies beyond.
fn crossing<'a>(foliage: &'a Foliage, cloud: &Cloud, number: u32, triangle: usize) -> Option<Drawn<'a>> {
    let (plane, corners) = (cloud.planes[number as usize], foliage.corners(triangle));
    // The bound is in the caller's units.
    let reach = cloud.bound / foliage.frame().radius;
    let is_shown = cloud.parents[triangle] != number && crosses(&plane, &corners, reach);
    is_shown.then(|| Drawn { foliage, triangle, targets: corners.map(|p| plane.project(p)), corners, reach })
}

/// Returns whether any part of a triangle lies within `reach` of the plane.
fn crosses(plane: &Plane, corners: &[DVec3; 3], reach: f64) -> bool {
    let heights = corners.map(|corner| plane.height(corner));
    let (low, high) = heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &x| (l.min(x), h.max(x)));
    low <= reach && high >= -reach
}

#[cfg(test)]
mod tests {
    use glam::Vec4;

    use super::*;
    use crate::atlas::{Atlas, AtlasSettings};
    use crate::foliage::{Attributes, Material, Opacity};
    use crate::outlines::outlines;
    use crate::textures::{Channels, Samples, bake};

    const EPSILON: f64 = 0.25;

    /// A strip of six squares of side 1, one leaf, that bends up by 30° in its middle.
    fn bent() -> Foliage {
        let point = |i: u32, y: f64| {
            let beyond = f64::from(i) - 3.0;
            let (x, z) = if i <= 3 { (beyond, 0.0) } else { (beyond * 0.75f64.sqrt(), beyond * 0.5) };
            DVec3::new(x, y, z)
        };
        let positions: Vec<DVec3> = (0..=6).flat_map(|i| [point(i, 0.0), point(i, 1.0)]).collect();
        let triangles = (0..6).flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]]).collect();
        Foliage::new(&positions, triangles, Attributes::default(), vec![Material::default()]).unwrap()
    }

    #[test]
    fn a_torn_leaf_overlaps_within_the_slab_of_each_plane() {
        let foliage = bent();
        let rising = DVec3::new(-0.5, 0.0, 0.75f64.sqrt());
        let middle = foliage.frame().to_local(DVec3::ZERO);
        let planes = [DVec3::Z, rising].map(|normal| Plane { normal, distance: normal.dot(middle) });
        let parents: Vec<u32> = (0..12).map(|t| u32::from(t >= 6)).collect();
        let bound = 0.6;
        let cloud = Cloud::new(&foliage, planes.to_vec(), parents, bound);
        assert!(tears_many(&foliage, &cloud));
        let projection = Projection::new(&foliage, &cloud, 1.0);
        let shown = with_torn_leaves(&foliage, &cloud, &projection);
        for plane in [0, 1] {
            let mut triangles: Vec<usize> = shown(plane).iter().map(|each| each.triangle).collect();
            triangles.sort_unstable();
            // The first two squares beyond the bend begin at heights of 0 and 0.5 over the other half's plane, the third at 1.
            let expected = if plane == 0 { 0..10 } else { 2..12 };
            assert_eq!(triangles, expected.collect::<Vec<_>>());
        }
        let own = own_triangles(&foliage, &cloud, &projection);
        assert_eq!(own(0).len(), 6);
        assert!(!tears_many(&foliage, &Cloud { parents: vec![0; 12], ..cloud.clone() }));
    }

    /// Two red squares at z = 0 with a gap between them, and a blue one through the gap that rises at 45°.
    fn crossing() -> Foliage {
        let square = |[x0, z0]: [f64; 2], [x1, z1]: [f64; 2]| {
            [DVec3::new(x0, -1.0, z0), DVec3::new(x1, -1.0, z1), DVec3::new(x1, 1.0, z1), DVec3::new(x0, 1.0, z0)]
        };
        let squares =
            [square([-2.0, 0.0], [-1.0, 0.0]), square([1.0, 0.0], [2.0, 0.0]), square([-1.0, -1.0], [1.0, 1.0])];
        let triangles = (0..3).flat_map(|s| [[4 * s, 4 * s + 1, 4 * s + 2], [4 * s, 4 * s + 2, 4 * s + 3]]).collect();
        let plain = |r: f32, b: f32| Material { base_color: Vec4::new(r, 0.0, b, 1.0), ..Material::default() };
        let attributes = Attributes { material_ids: vec![0, 0, 0, 0, 1, 1], ..Attributes::default() };
        Foliage::new(&squares.concat(), triangles, attributes, vec![plain(1.0, 0.0), plain(0.0, 1.0)]).unwrap()
    }

    /// Returns the shares of the first plane's region that are red and blue.
    fn shares(close_gaps: bool) -> [f64; 2] {
        let foliage = crossing();
        let rising = DVec3::new(-1.0, 0.0, 1.0).normalize();
        let planes = vec![Plane { normal: DVec3::Z, distance: 0.0 }, Plane { normal: rising, distance: 0.0 }];
        let cloud = Cloud::new(&foliage, planes, vec![0, 0, 0, 0, 1, 1], EPSILON);
        let projection = Projection::new(&foliage, &cloud, 1.0);
        let opacity = Opacity::of(&foliage);
        let outlines = outlines(&cloud.planes, &cloud.parents, |t| projection.targets[t], &opacity);
        let atlas = Atlas::pack(&cloud.planes, &outlines, AtlasSettings::of_size(256, false)).unwrap();
        let channels = (&Channels::default(), None);
        let page = if close_gaps {
            bake(&atlas, Samples::default(), channels, all_triangles(&foliage, &cloud, &projection))
        } else {
            bake(&atlas, Samples::default(), channels, own_triangles(&foliage, &cloud, &projection))
        };
        let region = atlas.billboards.iter().find(|b| b.plane == 0).unwrap().region;
        let texels = (region.y..region.y + region.height)
            .flat_map(|y| (region.x..region.x + region.width).map(move |x| y * 256 + x))
            .map(|i| page.base_color.pixels()[i])
            .filter(|p| p[3] > 127);
        let (red, blue) =
            texels.fold((0, 0), |(red, blue), p| (red + u32::from(p[0] > 127), blue + u32::from(p[2] > 127)));
        [red, blue].map(|count| f64::from(count) / (region.width * region.height) as f64)
    }

    #[test]
    fn crossing_triangles_are_clipped_to_the_slab() {
        let [red, blue] = shares(false);
        assert!((red - 0.5).abs() < 0.02 && blue == 0.0, "{red} {blue}");
        let [red, blue] = shares(true);
        // z = x on the blue square: of the region's width of 4, a strip of 2 ε lies within ε.
        assert!((red - 0.5).abs() < 0.02 && (blue - 2.0 * EPSILON / 4.0).abs() < 0.02, "{red} {blue}");
    }
}
