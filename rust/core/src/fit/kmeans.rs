//! Clusters about planes (k-means): the number of billboards is the input, ε the result.
//!
//! Lloyd's rounds: each piece joins its cheapest plane (by the mean squared distance, and by how edge-on the plane sees it), then each
//! plane moves to the least-squares plane of its pieces. The first planes are drawn as in k-means++ (Arthur, Vassilvitskii 2007): pieces'
//! own planes, each with a probability proportional to the piece's weight times its least cost so far. Means ignore any bound. So
//! each round also tries its planes moved to the middle between their farthest pieces, and the planes with the smallest maximum distance
//! are kept. That distance is reported as the bound. O(rounds · n · K).

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::pieces::{Pieces, Slab};
use super::sweep::Search;
use crate::error::Result;
use crate::geometry::{Plane, least_direction};
use crate::progress::Progress;
use crate::random::Stream;

/// Number of Lloyd's rounds.
const ROUNDS: usize = 24;

/// Scale of distances relative to cosines, as a share of R.
const SCALE: f64 = 0.1;

/// Returns `count` slabs, or fewer if there are fewer pieces, and the greatest distance of any piece from its nearest slab.
pub fn cluster(pieces: &Pieces, count: usize, search: &Search, progress: Progress) -> Result<(Vec<Slab>, f64)> {
    let mut planes = first_planes(pieces, count, search, progress)?;
    let mut best = (f64::INFINITY, planes.clone());
    for round in 0..ROUNDS {
        progress.tell("fit", round as f64 / ROUNDS as f64)?;
        let members = members(pieces, &planes);
        planes = members.par_iter().zip(&planes).map(|(members, plane)| fitted(pieces, members, plane)).collect();
        let centred: Vec<Plane> =
            members.par_iter().zip(&planes).map(|(members, plane)| centred(pieces, members, plane)).collect();
        for candidate in [&planes, &centred] {
            let farthest = farthest(pieces, candidate);
            if farthest < best.0 {
                best = (farthest, candidate.clone());
            }
        }
    }
    let slabs = best.1.into_iter().map(|plane| Slab {
        plane,
        centre: (plane.normal * plane.distance).as_vec3(),
        reach: f32::INFINITY,
    });
    Ok((slabs.collect(), best.0))
}

fn cost(pieces: &Pieces, piece: usize, plane: &Plane) -> f64 {
    let points = pieces.points(piece);
    let squares: f64 = points.iter().map(|p| plane.height(p.as_dvec3()).powi(2)).sum();
    squares / (points.len() as f64 * SCALE * SCALE) + 1.0 - f64::from(pieces.facing(piece, plane.normal.as_vec3()))
}

fn first_planes(pieces: &Pieces, count: usize, search: &Search, progress: Progress) -> Result<Vec<Plane>> {
    let mut stream = Stream::new(search.seed, 0, 0);
    let mut planes = vec![pieces.own_plane(stream.below(pieces.len()))];
    let mut least: Vec<f64> = vec![f64::INFINITY; pieces.len()];
    while planes.len() < count.min(pieces.len()) {
        progress.tell("fit", 0.0)?;
        let newest = planes[planes.len() - 1];
        least.par_iter_mut().enumerate().for_each(|(i, least)| {
            *least = least.min(f64::from(pieces.weight(i)) * cost(pieces, i, &newest));
        });
        let total: f64 = least.iter().sum();
        let mut left = total * stream.unit();
        let drawn = least.iter().position(|&share| {
            left -= share;
            left < 0.0
        });
        planes.push(pieces.own_plane(drawn.unwrap_or_else(|| stream.below(pieces.len()))));
    }
    Ok(planes)
}

/// Returns the pieces of each plane.
fn members(pieces: &Pieces, planes: &[Plane]) -> Vec<Vec<u32>> {
    let cheapest = |i: usize| {
        let costs = planes.iter().enumerate().map(|(k, plane)| (cost(pieces, i, plane), k));
        costs.reduce(|a, b| if b.0 < a.0 { b } else { a }).expect("there is a plane").1
    };
    let chosen: Vec<usize> = (0..pieces.len()).into_par_iter().map(cheapest).collect();
    let mut members = vec![Vec::new(); planes.len()];
    for (i, k) in chosen.into_iter().enumerate() {
        members[k].push(i as u32);
    }
    members
}

/// Returns the least-squares plane of the points, weighted by area; `plane` itself if they have no area.
fn fitted(pieces: &Pieces, members: &[u32], plane: &Plane) -> Plane {
    let points = || {
        members.iter().flat_map(|&i| {
            let points = pieces.points(i as usize);
            let weight = f64::from(pieces.area(i as usize)) / points.len() as f64;
            points.iter().map(move |p| (p.as_dvec3(), weight))
        })
    };
    let (sum, weight) = points().fold((DVec3::ZERO, 0.0), |(sum, total), (p, w)| (sum + p * w, total + w));
    if weight <= 0.0 {
        return *plane;
    }
    let mean = sum / weight;
    let spread = points().fold(DMat3::ZERO, |m, (p, w)| {
        let d = p - mean;
        m + DMat3::from_cols(d * d.x, d * d.y, d * d.z) * w
    });
    Plane::through(mean, least_direction(spread, plane.normal))
}

/// Returns the plane moved to the middle between its farthest points.
fn centred(pieces: &Pieces, members: &[u32], plane: &Plane) -> Plane {
    let heights = members.iter().flat_map(|&i| pieces.points(i as usize)).map(|p| plane.height(p.as_dvec3()));
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
    if low > high {
        return *plane;
    }
    Plane { distance: plane.distance + 0.5 * (low + high), ..*plane }
}

/// Returns the greatest distance of any piece from its nearest plane.
fn farthest(pieces: &Pieces, planes: &[Plane]) -> f64 {
    let nearest = |i: usize| {
        let height =
            |plane: &Plane| pieces.points(i).iter().map(|p| plane.height(p.as_dvec3()).abs()).fold(0.0, f64::max);
        planes.iter().map(height).fold(f64::INFINITY, f64::min)
    };
    (0..pieces.len()).into_par_iter().map(nearest).reduce(|| 0.0, f64::max)
}
