use glam::DVec2;
use proptest::prelude::*;

use super::*;

/// Eight pixels along a texel: triangles are nearly free.
const SHARP: Scale = Scale { pixels_per_unit: 8.0, copies: 1 };

fn settings(triangles: usize, scale: Scale) -> PolygonSettings {
    PolygonSettings { corners: 5, triangles, scale }
}

fn area(polygons: &[Polygon]) -> f64 {
    let of = |p: &Polygon| (1..p.len() - 1).map(|i| (p[i] - p[0]).perp_dot(p[i + 1] - p[0])).sum::<f64>() / 2.0;
    polygons.iter().map(of).sum()
}

/// Returns the length of all edges of the triangles.
fn edges(polygons: &[Polygon]) -> f64 {
    let of = |p: &Polygon| {
        let fan = (1..p.len() - 1).map(|i| [p[0], p[i], p[i + 1]]);
        fan.map(|[a, b, c]| a.distance(b) + b.distance(c) + c.distance(a)).sum::<f64>()
    };
    polygons.iter().map(of).sum()
}

fn triangles(billboards: &[Vec<Polygon>]) -> usize {
    billboards.iter().flatten().map(|polygon| polygon.len() - 2).sum()
}

fn holds(polygon: &Polygon, p: DVec2) -> bool {
    (0..polygon.len()).all(|i| {
        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        (b - a).perp_dot(p - a) >= -1e-6 * a.distance(b)
    })
}

#[test]
fn a_full_billboard_stays_its_rectangle() {
    let full = Cells::new(20, 10, |_, _| true);
    let found = tight(&[full], settings(1000, SHARP));
    assert_eq!(triangles(&found), 2);
    let corners = [[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [0.0, 10.0]].map(DVec2::from_array);
    assert!(corners.iter().all(|corner| found[0][0].contains(corner)), "{found:?}");
}

#[test]
fn an_empty_billboard_keeps_its_region() {
    let found = tight(&[Cells::new(4, 6, |_, _| false)], settings(1000, SHARP));
    assert!((area(&found[0]) - 24.0).abs() < 1e-12 && found[0].len() == 1);
}

#[test]
fn an_angle_is_cut_in_two() {
    // Two arms of 20 x 4 cells that share a corner: two rectangles hold them without any empty area, greedy cuts nearly so.
    let angle = Cells::new(40, 40, |x, y| (10..30).contains(&x) && (10..30).contains(&y) && (x < 14 || y < 14));
    let found = tight(&[angle], settings(1000, SHARP));
    let exact = f64::from(20 * 4 + 16 * 4);
    assert_eq!(found[0].len(), 2, "{found:?}");
    assert!((area(&found[0]) / exact - 1.0).abs() < 0.05, "{} of {exact}", area(&found[0]));
}

#[test]
fn area_goes_where_a_triangle_saves_most() {
    // Both billboards are angles; the large one has sixteen times the empty area. Six triangles are enough for one of them.
    let angle = |n: usize| Cells::new(n, n, move |x, y| x < n / 5 || y < n / 5);
    let found = tight(&[angle(20), angle(80)], settings(6, SHARP));
    assert!(triangles(&found) <= 6);
    let exact = |n: f64| n * n * (1.0 - 0.64);
    assert!(area(&found[1]) < 1.2 * exact(80.0) && area(&found[0]) > 1.5 * exact(20.0), "{found:?}");
}

#[test]
fn triangles_that_cost_more_than_they_save_are_not_drawn() {
    let ring = || Cells::new(30, 30, |x, y| x.abs_diff(15).max(y.abs_diff(15)) > 10);
    let count = |pixels_per_unit| {
        let scale = Scale { pixels_per_unit, copies: 1 };
        triangles(&tight(&[ring()], settings(10_000, scale)))
    };
    // The hole is 441 texels: at a tenth of a pixel each, they are fewer fragments than one triangle costs.
    assert_eq!(count(0.1), 2);
    assert!(count(8.0) >= 8);
    let pairs = Scale { pixels_per_unit: 1.0, copies: 2 };
    assert!(triangles(&tight(&[ring()], settings(10_000, pairs))) <= count(1.0));
}

/// Returns the mean number of fragments of a triangle over shifts by fractions of a quad: four for every quad of 2 x 2 pixels with a pixel center
/// inside.
fn mean_fragments(triangle: [DVec2; 3]) -> f64 {
    const SHIFTS: usize = 24;
    let polygon = triangle.to_vec();
    let shifted = |i: usize, j: usize| 2.0 * DVec2::new(i as f64 + 0.5, j as f64 + 0.5) / SHIFTS as f64;
    let quads = |shift: DVec2| {
        let pixel = |x: i32, y: i32| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - shift;
        let hit = |x: i32, y: i32| (0..4).any(|k| holds(&polygon, pixel(2 * x + k % 2, 2 * y + k / 2)));
        (-1..12).flat_map(|x| (-1..12).map(move |y| (x, y))).filter(|&(x, y)| hit(x, y)).count()
    };
    let sum: usize = (0..SHIFTS * SHIFTS).map(|n| quads(shifted(n / SHIFTS, n % SHIFTS))).sum();
    4.0 * sum as f64 / (SHIFTS * SHIFTS) as f64
}

#[test]
fn a_triangle_has_at_most_the_fragments_of_its_area_extents_and_one() {
    let corner = DVec2::new;
    let wide = [
        [corner(1.0, 1.0), corner(14.0, 2.0), corner(5.0, 13.0)],
        [corner(2.0, 4.0), corner(11.0, 1.0), corner(9.0, 12.0)],
    ];
    let thin = [
        [corner(3.0, 3.0), corner(9.0, 3.5), corner(3.2, 4.0)],
        [corner(2.0, 2.0), corner(2.5, 2.0), corner(2.0, 2.6)],
    ];
    for (triangle, least) in
        wide.map(|triangle| (triangle, 0.95)).into_iter().chain(thin.map(|triangle| (triangle, 0.0)))
    {
        let [a, b, c] = triangle;
        let extent = a.max(b).max(c) - a.min(b).min(c);
        let expected = (b - a).perp_dot(c - a) / 2.0 + extent.x + extent.y + 1.0;
        let mean = mean_fragments(triangle);
        assert!((least..1.02).contains(&(mean / expected)), "{mean} fragments, {expected} expected");
    }
}

/// Blots: discs of random places and radii.
fn blots() -> impl Strategy<Value = Cells> {
    let disc = (0.0..60.0, 0.0..40.0, 1.0..9.0);
    prop::collection::vec(disc, 1..12).prop_map(|discs: Vec<(f64, f64, f64)>| {
        let holds = |x: usize, y: usize, &(a, b, r): &(f64, f64, f64)| (x as f64 - a).hypot(y as f64 - b) <= r;
        Cells::new(60, 40, |x, y| discs.iter().any(|disc| holds(x, y, disc)))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn polygons_are_convex_and_hold_every_cell(cells in blots(), corners in 4usize..9, most in 2usize..60) {
        let settings = PolygonSettings { corners, triangles: most, scale: SHARP };
        let found = tight(std::slice::from_ref(&cells), settings);
        prop_assert!(triangles(&found) <= most);
        for polygon in &found[0] {
            prop_assert!((3..=corners).contains(&polygon.len()));
            for i in 0..polygon.len() {
                let [a, b, c] = [0, 1, 2].map(|k| polygon[(i + k) % polygon.len()]);
                prop_assert!((b - a).perp_dot(c - b) >= -1e-6);
                prop_assert!(a.cmpge(DVec2::splat(-1e-6)).all() && a.cmple(DVec2::new(60.0, 40.0) + 1e-6).all());
            }
        }
        for cell in cells.centers() {
            for offset in [[0.0, 0.0], [-0.49, -0.49], [0.49, -0.49], [-0.49, 0.49], [0.49, 0.49]] {
                let p = cells::at(*cell) + DVec2::from_array(offset);
                let inside = p.clamp(DVec2::ZERO, DVec2::new(60.0, 40.0));
                prop_assert!(found[0].iter().any(|polygon| holds(polygon, inside)), "{} is not drawn", inside);
            }
        }
    }

    #[test]
    fn more_triangles_leave_less_to_draw(cells in blots()) {
        // A tree's cheapest polygons at a lower price have no more area and edges.
        let drawn = |most| {
            let polygons = &tight(std::slice::from_ref(&cells), settings(most, SHARP))[0];
            area(polygons) + SHARP.edge() * edges(polygons)
        };
        let costs = [2, 8, 32].map(drawn);
        prop_assert!(costs[0] >= costs[1] - 1e-6 && costs[1] >= costs[2] - 1e-6, "{:?}", costs);
    }
}
