use super::*;
use crate::fit::FitSettings;
use crate::foliage::{Attributes, Material};
use crate::lod::refine::picture::BLOCK_WEIGHT;
use crate::lod::refine::tests::{bush, settings};
use crate::lod::{ChainSettings, Level, RefinedParts, build_chain};
use crate::textures::Samples;
use glam::{Vec3, Vec4};
use std::sync::Arc;

/// Red squares of side 0.3 that face up, each a leaf, on a grid of 5 × 5 with the height of each.
fn squares(height: impl Fn(u32) -> f64) -> Foliage {
    let corners = |i: u32| {
        let middle = DVec3::new(f64::from(i % 5) * 0.5 - 1.0, f64::from(i / 5) * 0.5 - 1.0, height(i));
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| middle + DVec3::new(x, y, 0.0) * 0.15)
    };
    let positions: Vec<DVec3> = (0..25).flat_map(corners).collect();
    let triangles = (0..25).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| 4 * i + k))).collect();
    let red = Material { base_color: Vec4::new(0.8, 0.1, 0.1, 1.0), double_sided: true, ..Material::default() };
    Foliage::new(&positions, triangles, Attributes::default(), vec![red]).unwrap()
}

/// Refines a cloud of planes at these heights, with a parent for each square.
fn refined(leaves: &Foliage, heights: &[f64], parent: impl Fn(u32) -> u32, effort: Refinement) -> (Cloud, Cloud) {
    let frame = leaves.frame();
    let plane = |z: f64| Plane::through(frame.to_local(DVec3::Z * z), DVec3::Z);
    let planes = heights.iter().map(|z| plane(*z)).collect();
    let cloud = Cloud::new(leaves, planes, leaves.leaf_ids().iter().map(|leaf| parent(*leaf)).collect(), 0.2);
    let amounts = Reference::new(&[leaves], frame, tune::views_of_amounts(2, DVec3::Z).unwrap()).unwrap();
    let arrangement = Arrangement {
        finer: leaves,
        opacity: &Opacity::ignored(),
        leaves,
        amounts: &amounts,
        image: None,
        up: DVec3::Z,
        radius_pixels: 60.0,
        seed: 0,
    };
    let (found, errors) = arrangement.refined(cloud.clone(), effort, Progress::silent()).unwrap();
    assert!(errors.unwrap().errors.iter().all(|(_, ratio)| *ratio <= 1.0));
    (cloud, found)
}

/// Squares on two planes in turn, as on a chessboard.
fn on_two_planes(i: u32) -> u32 {
    i % 2
}

#[test]
fn a_leaf_goes_to_the_plane_that_it_lies_on() {
    let leaves = squares(|i| if on_two_planes(i) == 0 { 0.0 } else { 0.15 });
    // Square 12, in the middle, is at the height 0.
    let wrong = |i: u32| if i == 12 { 1 } else { on_two_planes(i) };
    let (before, after) = refined(&leaves, &[0.0, 0.15], wrong, Refinement::Short);
    assert!((before.max_deviation() - 0.15).abs() < 1e-12);
    let right: Vec<u32> = leaves.leaf_ids().iter().map(|leaf| on_two_planes(*leaf)).collect();
    assert_eq!(after.parents, right);
    assert!(after.max_deviation() < 1e-12);
    assert_eq!(before.planes, after.planes, "planes do not move in a short refinement");
}

#[test]
fn leaves_on_their_planes_stay() {
    let leaves = squares(|i| if on_two_planes(i) == 0 { 0.0 } else { 0.15 });
    for effort in [Refinement::Short, Refinement::Long] {
        let (before, after) = refined(&leaves, &[0.0, 0.15], on_two_planes, effort);
        assert_eq!((before.planes, before.parents), (after.planes, after.parents));
    }
}

#[test]
fn a_plane_comes_back_to_its_leaves() {
    let leaves = squares(|_| 0.0);
    let (before, after) = refined(&leaves, &[0.1], |_| 0, Refinement::Long);
    assert!((before.max_deviation() - 0.1).abs() < 1e-12);
    assert!(after.max_deviation() < 0.03, "{}", after.max_deviation());
    assert_eq!(after.parents, before.parents);
}

#[test]
fn a_plane_without_leaves_goes() {
    let leaves = squares(|_| 0.0);
    let wrong = |i: u32| u32::from(i == 12);
    let (before, after) = refined(&leaves, &[0.0, 0.15], wrong, Refinement::Short);
    assert_eq!(before.planes.len(), 2);
    assert_eq!(after.planes, before.planes[..1]);
    assert!(after.parents.iter().all(|parent| *parent == 0));
}

/// Returns level 1 of all leaves.
fn level(foliage: &Foliage, settings: &ChainSettings) -> Level {
    let settings = ChainSettings { min_visibility: 0.0, ..settings.clone() };
    build_chain(foliage, None, &settings, Progress::silent()).unwrap().levels.remove(0)
}

#[test]
#[ignore = "long: make test-night runs it"]
fn every_corner_keeps_the_bound_and_no_leaf_is_torn() {
    let foliage = bush(300);
    let [off, long] = [Refinement::Off, Refinement::Long].map(|effort| level(&foliage, &settings(effort)));
    let [before, after] = [&off, &long].map(|level| level.cloud.as_ref().unwrap());
    assert_ne!(before.parents, after.parents, "the pictures ask for switches");
    assert_eq!(before.bound, after.bound);
    let mut farthest = 0.0f64;
    for (triangle, &parent) in after.parents.iter().enumerate() {
        let Plane { normal, distance } = after.planes[parent as usize];
        assert!((normal.length() - 1.0).abs() < 1e-12);
        for corner in foliage.corners(triangle) {
            farthest = farthest.max((normal.dot(corner) - distance).abs() * foliage.frame().radius);
        }
    }
    assert!(farthest <= before.max_deviation() && farthest <= after.bound, "{farthest}");
    assert_eq!(long.max_deviation_leaves, after.max_deviation());
    let parts = |cloud: &Cloud| {
        let parts: std::collections::HashSet<_> = foliage.leaf_ids().iter().zip(&cloud.parents).collect();
        parts.len()
    };
    assert!(parts(after) <= parts(before));
    let projection = long.projection.as_ref().unwrap();
    for (triangle, &parent) in after.parents.iter().enumerate() {
        let height = |corner: &DVec3| after.planes[parent as usize].height(*corner).abs();
        assert!(
            projection.targets[triangle].iter().all(|corner| height(corner) < 1e-4),
            "targets lie on the new planes"
        );
    }
    assert!(long.refined_planes.unwrap().errors.iter().all(|(_, ratio)| *ratio <= 1.0));
}

#[test]
#[ignore = "long: make test-night runs it"]
fn a_viewer_sees_no_motion_by_more_than_the_angle() {
    let foliage = bush(200);
    let image = ImageBound { angle: 0.08, distance: 2.2 };
    let fit = FitSettings { image: Some(image), ..settings(Refinement::Long).fit };
    let level = level(&foliage, &ChainSettings { fit, ..settings(Refinement::Long) });
    let cloud = Arc::unwrap_or_clone(level.cloud.unwrap());
    for (triangle, &parent) in cloud.parents.iter().enumerate() {
        for corner in foliage.corners(triangle) {
            let height = cloud.planes[parent as usize].height(corner).abs();
            assert!(height <= image.angle * (image.distance - corner.length()), "{height}");
        }
    }
}

#[test]
#[ignore = "long: make test-night runs it"]
fn without_planes_the_cloud_is_that_of_the_fit() {
    let foliage = bush(150);
    let planes = |settings: &ChainSettings| {
        let level = level(&foliage, settings);
        let cloud = Arc::unwrap_or_clone(level.cloud.unwrap());
        (cloud.planes, cloud.parents, level.refined_planes.is_some(), level.refined.is_some())
    };
    let parts = |planes, texels| ChainSettings {
        refined_parts: RefinedParts { planes, texels },
        ..settings(Refinement::Short)
    };
    let off = planes(&settings(Refinement::Off));
    assert!(!off.2 && !off.3);
    let texels = planes(&parts(false, true));
    assert_eq!((&off.0, &off.1), (&texels.0, &texels.1));
    assert!(!texels.2 && texels.3);
    let both = planes(&parts(true, false));
    assert!(both.2 && !both.3);
}

#[test]
#[ignore = "long: make test-night runs it"]
fn any_number_of_threads_gives_the_same_planes() {
    let foliage = bush(150);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let parts = RefinedParts { planes: true, texels: false };
        let settings = ChainSettings { refined_parts: parts, ..settings(Refinement::Long) };
        let level = pool.install(|| level(&foliage, &settings));
        let cloud = Arc::unwrap_or_clone(level.cloud.unwrap());
        (cloud.planes, cloud.parents, level.page, level.refined_planes)
    };
    assert!(on(1) == on(4));
}

/// Squared error from its definition: differences times their sum with the mean over blocks, which are two box filters one after another.
fn squared_error(picture: &Picture, target: &Picture) -> f64 {
    let size = picture.size() as isize;
    let off = |x: isize, y: isize, channel: usize| {
        let inside = (0..size).contains(&x) && (0..size).contains(&y);
        let at = |picture: &Picture| f64::from(picture.code((y * size + x) as usize)[channel]);
        if inside { at(picture) - at(target) } else { 0.0 }
    };
    // Two boxes of 5 pixels, one after another, weigh 1 2 3 4 5 4 3 2 1 where no edge is near.
    let weight = |d: isize| (5 - d.abs()) as f64 / 25.0;
    let mut sum = 0.0;
    for (x, y) in (0..size).flat_map(|y| (0..size).map(move |x| (x, y))) {
        for channel in 0..4 {
            let own = off(x, y, channel);
            if own == 0.0 {
                continue;
            }
            let near = (-4..=4).flat_map(|i| (-4..=4).map(move |j| (i, j)));
            let block: f64 = near.map(|(i, j)| weight(i) * weight(j) * off(x + i, y + j, channel)).sum();
            let k = f64::from(BLOCK_WEIGHT);
            sum += own * (own + k * block) / (1.0 + k);
        }
    }
    sum
}

#[test]
fn credits_add_up_to_the_difference_of_the_errors() {
    let leaves = squares(|i| 0.02 * f64::from(i));
    let view = |size| View {
        direction: DVec3::new(0.6, -0.5, 0.4),
        up: DVec3::Z,
        centre: leaves.frame().centre,
        radius: leaves.frame().radius * 1.3,
        size,
        samples: Samples::new(1).unwrap(),
    };
    let lifted = |by: f64| move |t: usize, corners: [DVec3; 3]| corners.map(|p| p + DVec3::Z * (by * (t % 3) as f64));
    let draw = |by: f64| Picture::new(&leaves, |t| lifted(by)(t, leaves.corners(t)), Vec3::ONE, &view(48)).unwrap();
    let (first, second, target) = (draw(0.1), draw(-0.07), draw(0.0));
    let wanted = squared_error(&first, &target) - squared_error(&second, &target);
    let whole = first.credits(&second, &target, 1, |_| 0)[0];
    assert!(wanted.abs() > 0.1 && (whole - wanted).abs() < 1e-3 * wanted.abs(), "{whole} for {wanted}");
    // A pixel counts for each of two leaves that it shows, so the parts do not add up, but a leaf that is the same in both has no credit.
    let parts = first.credits(&second, &target, 2, |triangle| usize::from(triangle % 3 == 0));
    assert!(parts[0].abs() > 0.0 && parts[1].abs() < parts[0].abs(), "{parts:?}");
}
