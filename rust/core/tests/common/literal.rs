//! Algorithm 1 of Lacewell et al. as printed, with one error corrected: the best of N candidates is kept. Written for clarity, as the
//! baseline for the fitter. It uses one thread and f64, splits leaves and refines no planes.

use glam::DVec3;
use leafcloud::Foliage;
use leafcloud::foliage::area_vector;
use leafcloud::geometry::Plane;

use super::random::Random;

/// Returns the planes found, local frame. `epsilon` is a share of R; triangles without area are left out.
pub fn search(foliage: &Foliage, epsilon: f64, candidates: usize, seed: u64) -> Vec<Plane> {
    let mut random = Random(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let all = (0..foliage.triangle_count()).map(|t| foliage.corners(t));
    let mut remaining: Vec<[DVec3; 3]> = all.filter(|&t| area_vector(t) != DVec3::ZERO).collect();
    let holds = |plane: &Plane, t: &[DVec3; 3]| t.iter().all(|&v| plane.height(v).abs() < epsilon);
    let mut planes = Vec::new();
    while !remaining.is_empty() {
        let mut best: Option<(f64, Plane)> = None;
        for _ in 0..candidates {
            let seed = remaining[random.below(remaining.len())];
            let normal = area_vector(seed).normalize();
            let Some(plane) = Plane::through_points(seed.map(|v| v + normal * (random.signed() * epsilon))) else {
                continue;
            };
            let held = remaining.iter().filter(|t| holds(&plane, t));
            let area = held.map(|&t| area_vector(t).dot(plane.normal).abs()).sum();
            if best.is_none_or(|(most, _)| area > most) {
                best = Some((area, plane));
            }
        }
        let Some((_, plane)) = best else { continue };
        remaining.retain(|t| !holds(&plane, t));
        planes.push(plane);
    }
    planes
}
