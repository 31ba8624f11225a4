//! The triangles that a plane's billboard shows.
//!
//! A billboard shows the triangles that morph onto it. To close gaps between billboards, as Décoret et al. do (2003, §4.4), it can also
//! show the parts of all other triangles within ε of its plane, clipped to that slab and to the billboard. These extra triangles are not
//! stretched and do not morph: each leaf still has one parent. They make crowns denser; the alpha cutoff compensates for part of that.

use glam::DVec3;

use crate::cloud::Cloud;
use crate::foliage::Foliage;
use crate::geometry::Plane;
use crate::groups::Groups;
use crate::textures::Drawn;
use crate::transition::Projection;

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

/// Returns a function that lists a plane's own triangles and the others that reach into its slab. O(planes · triangles).
pub fn all_triangles<'a>(
    foliage: &'a Foliage,
    cloud: &'a Cloud,
    projection: &'a Projection,
) -> impl Fn(u32) -> Vec<Drawn<'a>> + Sync {
    let own = own_triangles(foliage, cloud, projection);
    // The bound is in the caller's units.
    let reach = cloud.bound / foliage.frame().radius;
    move |number| {
        let plane = cloud.planes[number as usize];
        let others = (0..foliage.triangle_count()).filter(|&triangle| cloud.parents[triangle] != number);
        let crossing = others.filter_map(|triangle| {
            let corners = foliage.corners(triangle);
            crosses(&plane, &corners, reach).then(|| Drawn {
                foliage,
                triangle,
                targets: corners.map(|corner| plane.project(corner)),
                corners,
                reach,
            })
        });
        own(number).into_iter().chain(crossing).collect()
    }
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
