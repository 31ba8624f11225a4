//! The order of blended triangles against ray casts: from any eye, nearer triangles are drawn later.

use glam::DVec3;
use leafcloud::Progress;
use leafcloud::blend_order::{BlendOrder, MOST_CUTS};

use crate::common::random::Random;

const EYES: usize = 12;
const RAYS: usize = 120;

/// Large triangles that cross one another, some of them in one plane.
fn crossing(seed: u64, count: usize) -> Vec<[DVec3; 3]> {
    let mut random = Random(seed);
    let mut triangles: Vec<[DVec3; 3]> = (0..count).map(|_| std::array::from_fn(|_| random.in_ball())).collect();
    for number in 0..count / 4 {
        let [a, b, c] = triangles[number];
        triangles.push([a, c, a + 0.7 * (b - a) - 0.5 * (c - a)]);
    }
    triangles
}

fn corners(order: &BlendOrder, triangles: &[[DVec3; 3]], triangle: [u32; 3]) -> [DVec3; 3] {
    triangle.map(|corner| {
        let corner = order.corners[corner as usize];
        let [a, b, c] = triangles[corner.source as usize];
        corner.weights[0] * a + corner.weights[1] * b + corner.weights[2] * c
    })
}

fn area_vector([a, b, c]: [DVec3; 3]) -> DVec3 {
    0.5 * (b - a).cross(c - a)
}

/// Returns the distance along the ray to the triangle, by Cramer's rule; `None` for a miss or a hit near an edge.
fn met([a, b, c]: [DVec3; 3], eye: DVec3, along: DVec3) -> Option<f64> {
    let (u, v) = (b - a, c - a);
    let area = along.dot(u.cross(v));
    let from = eye - a;
    let (s, t) = (along.dot(from.cross(v)) / area, along.dot(u.cross(from)) / area);
    let away = -from.dot(u.cross(v)) / area;
    (s > 0.0 && t > 0.0 && s + t < 1.0 && away > 0.0).then_some(away)
}

/// Returns the nodes in drawing order for an eye.
fn seen_from(order: &BlendOrder, eye: DVec3) -> Vec<u32> {
    order.walk(|node| node.normal.dot(eye) > node.offset)
}

#[test]
fn nearer_is_drawn_later() {
    for (seed, count) in [(1, 12), (2, 40), (3, 90)] {
        let triangles = crossing(seed, count);
        let order = BlendOrder::new(&triangles, DVec3::Z, None, Progress::silent()).unwrap();
        let mut random = Random(seed + 10);
        let mut compared = 0;
        for _ in 0..EYES {
            // Eyes outside and inside.
            let eye = 1.7 * random.in_ball();
            let drawn: Vec<[DVec3; 3]> = seen_from(&order, eye)
                .into_iter()
                .flat_map(|node| order.nodes[node as usize].triangles.clone())
                .map(|triangle| corners(&order, &triangles, order.triangles[triangle as usize]))
                .collect();
            assert_eq!(drawn.len(), order.triangles.len());
            for _ in 0..RAYS {
                let along = (random.in_ball() - eye).normalize();
                let away: Vec<f64> = drawn.iter().filter_map(|&piece| met(piece, eye, along)).collect();
                assert!(away.windows(2).all(|pair| pair[0] > pair[1] - 1e-5), "{away:?}");
                compared += away.len().saturating_sub(1);
            }
        }
        assert!(compared > 5 * EYES * count, "{compared} pairs of {count} triangles");
    }
}

#[test]
fn pieces_cover_the_cut_triangles() {
    let triangles = crossing(4, 60);
    let order = BlendOrder::new(&triangles, DVec3::Z, None, Progress::silent()).unwrap();
    let mut sums = vec![DVec3::ZERO; triangles.len()];
    for &triangle in &order.triangles {
        let sources = triangle.map(|corner| order.corners[corner as usize].source);
        assert!(sources[1] == sources[0] && sources[2] == sources[0]);
        sums[sources[0] as usize] += area_vector(corners(&order, &triangles, triangle));
    }
    for (sum, &triangle) in sums.iter().zip(&triangles) {
        assert!(sum.distance(area_vector(triangle)) < 1e-9, "all of it, and wound as it was");
    }
    for corner in &order.corners {
        assert!((corner.weights.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!(corner.weights.iter().all(|&weight| weight > -1e-9));
    }
    let ranges: usize = order.nodes.iter().map(|node| node.triangles.len()).sum();
    assert_eq!(ranges, order.triangles.len(), "each lies in one node");
}

#[test]
fn the_list_is_in_order_for_an_eye_far_away() {
    let triangles = crossing(5, 30);
    let toward = DVec3::new(1.0, -2.0, 0.5).normalize();
    let order = BlendOrder::new(&triangles, toward, None, Progress::silent()).unwrap();
    let starts: Vec<u32> =
        seen_from(&order, 1e6 * toward).into_iter().map(|node| order.nodes[node as usize].triangles.start).collect();
    assert!(starts.is_sorted());
}

#[test]
fn triangles_that_do_not_cross_stay_whole() {
    let square = |height: f64| {
        let [a, b, c, d] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, height));
        [[a, b, c], [a, c, d]]
    };
    let stack: Vec<[DVec3; 3]> = (0..40).flat_map(|i| square(f64::from(i))).collect();
    let order = BlendOrder::new(&stack, DVec3::Z, None, Progress::silent()).unwrap();
    assert_eq!((order.triangles.len(), order.nodes.len()), (80, 40), "the two of a square lie in one plane");
    assert_eq!(order.corners[order.triangles[0][0] as usize].source / 2, 0, "seen from above the lowest is first");
}

#[test]
fn the_limit_on_pieces_is_kept() {
    let triangles = crossing(6, 100);
    let all = BlendOrder::new(&triangles, DVec3::Z, None, Progress::silent()).unwrap();
    for most in [0, triangles.len(), 2 * triangles.len()] {
        let order = BlendOrder::new(&triangles, DVec3::Z, Some(most), Progress::silent()).unwrap();
        let pieces = pieces(&order);
        assert!(order.triangles.len() < all.triangles.len());
        assert!(pieces <= most.max(triangles.len()), "{pieces} of {most}");
        let area: f64 = order.triangles.iter().map(|&t| area_vector(corners(&order, &triangles, t)).length()).sum();
        let whole: f64 = triangles.iter().map(|&t| area_vector(t).length()).sum();
        assert!((area / whole - 1.0).abs() < 1e-9);
    }
}

/// A grid of upright triangles, `across` of them in planes x = i and `along` of them in planes y = j. Each of the one crosses each of the
/// other once, so an exact order cuts one of the two there, and nothing else.
fn grid(across: u32, along: u32) -> Vec<[DVec3; 3]> {
    let upright = |flip: bool, count: u32, length: u32| {
        let (start, end) = (-1.0, f64::from(length));
        (0..count).map(f64::from).map(move |at| {
            let corner = |along: f64, z: f64| if flip { DVec3::new(along, at, z) } else { DVec3::new(at, along, z) };
            [corner(start, 0.0), corner(end, 0.0), corner(0.5 * (start + end), f64::from(length))]
        })
    };
    upright(false, across, along).chain(upright(true, along, across)).collect()
}

/// Returns the number of pieces. A piece of n corners is n − 2 triangles.
fn pieces(order: &BlendOrder) -> usize {
    (order.corners.len() - order.triangles.len()) / 2
}

#[test]
fn an_exact_order_cuts_each_crossing_once() {
    for (across, along) in [(1, 1), (10, 12), (40, 25)] {
        let order = BlendOrder::new(&grid(across, along), DVec3::Z, None, Progress::silent()).unwrap();
        assert_eq!(pieces(&order), (across + along + across * along) as usize);
    }
}

#[test]
fn an_exact_order_with_too_many_cuts_is_refused() {
    assert_eq!(MOST_CUTS, 1_000_000);
    let most = BlendOrder::new(&grid(1000, 1000), DVec3::Z, None, Progress::silent()).unwrap();
    assert_eq!(pieces(&most), 1_002_000);
    let triangles = grid(1000, 1001);
    let message = BlendOrder::new(&triangles, DVec3::Z, None, Progress::silent()).unwrap_err().to_string();
    for word in ["2001 triangles", "1000000", "`most`"] {
        assert!(message.contains(word), "{message}");
    }
    let approximate = BlendOrder::new(&triangles, DVec3::Z, Some(5000), Progress::silent()).unwrap();
    assert_eq!(pieces(&approximate), 5000);
}

#[test]
fn hostile_input() {
    let nothing = BlendOrder::new(&[], DVec3::Z, None, Progress::silent()).unwrap();
    assert_eq!(nothing, BlendOrder::default());
    let line = [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X];
    let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let order = BlendOrder::new(&[line, triangle, [DVec3::ONE; 3]], DVec3::Z, None, Progress::silent()).unwrap();
    assert_eq!(order.triangles.len(), 1);
    assert!(order.corners.iter().all(|corner| corner.source == 1));
    let broken = [DVec3::ZERO, DVec3::X, DVec3::new(0.0, f64::NAN, 0.0)];
    let message = BlendOrder::new(&[triangle, broken], DVec3::Z, Some(9), Progress::silent()).unwrap_err().to_string();
    assert!(message.contains("triangle 1"), "{message}");
    assert!(BlendOrder::new(&[triangle], DVec3::new(f64::INFINITY, 0.0, 0.0), Some(9), Progress::silent()).is_err());
    for scale in [1e-12, 1e12] {
        let triangles: Vec<[DVec3; 3]> = crossing(7, 30).into_iter().map(|t| t.map(|p| scale * p)).collect();
        let scaled = BlendOrder::new(&triangles, DVec3::Z, None, Progress::silent()).unwrap();
        let plain = BlendOrder::new(&crossing(7, 30), DVec3::Z, None, Progress::silent()).unwrap();
        assert_eq!(scaled.triangles.len(), plain.triangles.len(), "{scale}");
    }
    // So far away that no corner lies in its own triangle's plane.
    let far: Vec<[DVec3; 3]> = crossing(8, 20).into_iter().map(|t| t.map(|p| p + 1e11)).collect();
    assert!(BlendOrder::new(&far, DVec3::Z, None, Progress::silent()).unwrap().nodes.len() <= 1000);
    // All at one position, repeatedly.
    let same = BlendOrder::new(&vec![triangle; 5000], DVec3::Z, None, Progress::silent()).unwrap();
    assert_eq!((same.triangles.len(), same.nodes.len()), (5000, 1));
}
