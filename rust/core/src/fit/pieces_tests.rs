//! Tests of pieces against their definition.

use glam::{DVec3, Vec3};
use proptest::prelude::*;

use super::super::bounds::Bounds;
use super::*;
use crate::foliage::{Attributes, Foliage, Opacity};

fn soup(places: &[(f64, f64, f64)], size: f64) -> Foliage {
    let points: Vec<DVec3> = places.iter().map(|&(x, y, z)| DVec3::new(x, y, z)).collect();
    let corners = points.windows(3).flat_map(|w| [w[0], w[0] + (w[1] - w[0]) * size, w[0] + (w[2] - w[0]) * size]);
    let positions: Vec<DVec3> = corners.collect();
    let triangles = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Foliage::new(&positions, triangles, Attributes::default(), vec![]).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn held_are_those_whose_vertices_are_near_in_f64(
        places in prop::collection::vec((-1.0..1.0, -1.0..1.0, -1.0..1.0), 3..200),
        normal in (-1.0..1.0, -1.0..1.0, 0.1..1.0),
        distance in -0.5..0.5,
        bound in 1e-7..0.3,
    ) {
        let foliage = soup(&places, 0.1);
        let pieces = Pieces::of(&foliage, WholeLeaves::WhereCheap, &Bounds { greatest: bound, image: None }, &Opacity::ignored());
        let plane = Plane { normal: DVec3::new(normal.0, normal.1, normal.2).normalize(), distance };
        let slab = Slab { plane, centre: Vec3::ZERO, reach: f32::INFINITY };
        let local = pieces.axes.plane_to_local(&plane);
        let by_definition: Vec<u32> = (0..pieces.len() as u32)
            .filter(|&i| {
                let i = i as usize;
                let corners = pieces.triangles(i).iter().flat_map(|&t| foliage.corners(t as usize));
                corners.into_iter().all(|p| local.height(p).abs() <= f64::from(pieces.bound(i)))
            })
            .collect();
        prop_assert_eq!(pieces.held_in(&slab, 0..pieces.len()), by_definition.clone());
        let some: Vec<u32> = (0..pieces.len() as u32).step_by(3).collect();
        let chosen = pieces.select(&some);
        let held: Vec<u32> = chosen.held_in(&slab, 0..chosen.len()).iter().map(|&i| some[i as usize]).collect();
        let expected: Vec<u32> = by_definition.into_iter().filter(|i| i % 3 == 0).collect();
        prop_assert_eq!(held, expected);
    }

    #[test]
    fn every_triangle_is_in_one_piece_and_its_own_plane_holds_it(
        places in prop::collection::vec((-1.0..1.0, -1.0..1.0, -1.0..1.0), 3..60), bound in 1e-6..0.3,
    ) {
        let foliage = soup(&places, 0.5);
        let pieces = Pieces::of(&foliage, WholeLeaves::Always, &Bounds { greatest: bound, image: None }, &Opacity::ignored());
        let mut seen: Vec<u32> = (0..pieces.len()).flat_map(|i| pieces.triangles(i).to_vec()).collect();
        seen.sort_unstable();
        prop_assert_eq!(seen, (0..foliage.triangle_count() as u32).collect::<Vec<_>>());
        for i in 0..pieces.len() {
            let own = pieces.own_slab(i, f32::INFINITY);
            prop_assert!(pieces.held_in(&own, 0..pieces.len()).contains(&(i as u32)));
        }
    }
}
