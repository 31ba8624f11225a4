//! Which plane each piece collapses onto, once all planes are known.
//!
//! Among the planes that hold the piece within ε, in f64, the one of least
//! `mean(h²)/ε² + w · (1 − |cos|)`, with h the heights of its vertices and cos the cosine between plane and leaf: a plane that sees a leaf
//! face-on keeps its area and is worth some distance. w = 0 takes the nearest plane. O(n · K), all cores.

use rayon::prelude::*;

use super::pieces::{Piece, Pieces};
use crate::geometry::Plane;

/// The planes that are somebody's parent, and the parent of each piece among them.
///
/// # Panics
/// When a piece is held by no plane: fitters cover all pieces.
pub fn choose_parents(pieces: &Pieces, planes: &[Plane], bound: f64, facing: f64) -> (Vec<Plane>, Vec<u32>) {
    let parent = |piece: &Piece| {
        let costs = planes.iter().enumerate().filter_map(|(k, plane)| Some((cost(piece, plane, bound, facing)?, k)));
        let least = costs.reduce(|best, next| if next.0 < best.0 { next } else { best });
        least.expect("a fitter covers every piece").1
    };
    let chosen: Vec<usize> = pieces.as_slice().par_iter().map(parent).collect();
    let mut used = vec![false; planes.len()];
    for &k in &chosen {
        used[k] = true;
    }
    let mut number = vec![0u32; planes.len()];
    let mut kept = Vec::new();
    for (k, plane) in planes.iter().enumerate().filter(|(k, _)| used[*k]) {
        number[k] = kept.len() as u32;
        kept.push(*plane);
    }
    (kept, chosen.into_iter().map(|k| number[k]).collect())
}

/// `None` when the plane does not hold the piece.
fn cost(piece: &Piece, plane: &Plane, bound: f64, facing: f64) -> Option<f64> {
    let mut squares = 0.0;
    for &v in &piece.vertices {
        let height = plane.height(v).abs();
        if height > bound {
            return None;
        }
        squares += height * height;
    }
    let area = piece.area();
    let cosine = if area > 0.0 { piece.projected_area(plane.normal) / area } else { 1.0 };
    Some(squares / (piece.vertices.len() as f64 * bound * bound) + facing * (1.0 - cosine))
}
