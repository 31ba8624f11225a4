//! Texture coordinates that run on where a texture repeats.
//!
//! Many tools start the texture coordinates of bark anew at each ring of a stem, or run them to and fro. A simplification without these
//! rings would draw a single repeat out over the whole stem. So each triangle is moved by whole repeats, and mirrored where coordinates turn
//! back on a border between repeats, until they run on over its edges. Triangles join to charts by a spanning tree (Kruskal 1956).

use glam::{BVec2, DVec3, Vec2};
use leafcloud::Foliage;
use leafcloud::groups::number_by_appearance;

/// Differences of texture coordinates below this are rounding errors.
const TOLERANCE: f32 = 1e-4;

/// Returns (t) the texture coordinates of all triangles, moved by whole numbers to run on over edges between triangles that `repeats` (t)
/// names. Where coordinates turn back at a whole number, they run on likewise, and that part of the texture is no longer mirrored.
///
/// The first triangle of each chart keeps its coordinates.
///
/// # Panics
/// If `trunk` has no texture coordinates, or the numbers of triangles differ.
#[must_use]
pub fn unrolled(trunk: &Foliage, repeats: &[bool]) -> Vec<[Vec2; 3]> {
    let uvs = &trunk.attributes().uvs;
    assert_eq!(uvs.len(), repeats.len(), "a flag for each triangle");
    let mut joints = joints(trunk, repeats);
    // Stable. Edges over which coordinates run on already come first, so that seams along a stem stay where they are.
    joints.sort_by_key(|joint| joint.map != Map::SAME);
    let mut charts = Charts::new(uvs.len());
    for joint in joints {
        charts.join(joint);
    }
    (0u32..).zip(uvs).map(|(triangle, uvs)| uvs.map(|uv| charts.root(triangle).1.of(uv))).collect()
}

/// A map of texture coordinates, axis by axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Map {
    /// 1, or −1 where it mirrors.
    sign: Vec2,
    /// Whole numbers.
    shift: Vec2,
}

impl Map {
    const SAME: Self = Self { sign: Vec2::ONE, shift: Vec2::ZERO };

    fn of(self, uv: Vec2) -> Vec2 {
        self.sign * uv + self.shift
    }

    fn after(self, first: Self) -> Self {
        Self { sign: self.sign * first.sign, shift: self.of(first.shift) }
    }

    fn inverse(self) -> Self {
        Self { sign: self.sign, shift: -self.sign * self.shift }
    }
}

/// Two triangles with a common edge. `map`: from the coordinates of the second to those of the first.
struct Joint {
    triangles: [u32; 2],
    map: Map,
}

/// An edge of a triangle: the numbers of its ends in ascending order, and the corners there and opposite.
struct Side {
    ends: [u32; 2],
    triangle: u32,
    corners: [usize; 3],
}

fn joints(trunk: &Foliage, repeats: &[bool]) -> Vec<Joint> {
    let uvs = &trunk.attributes().uvs;
    let sides = sides(trunk, repeats);
    let pairs = sides.chunk_by(|a, b| a.ends == b.ends).flat_map(|of_edge| of_edge.windows(2));
    let joint = |pair: &[Side]| {
        let [first, second] = [0, 1].map(|i| pair[i].corners.map(|k| uvs[pair[i].triangle as usize][k]));
        Some(Joint { triangles: [pair[0].triangle, pair[1].triangle], map: map_between(first, second)? })
    };
    pairs.filter_map(joint).collect()
}

/// Returns the edges of the triangles that repeat, sorted by their ends. Ends are the same where positions are.
fn sides(trunk: &Foliage, repeats: &[bool]) -> Vec<Side> {
    let places = (0..trunk.triangle_count()).flat_map(|t| trunk.corners(t));
    let (ends, _) = number_by_appearance(places.map(|place| (place + DVec3::ZERO).to_array().map(f64::to_bits)));
    let of_triangle = |(triangle, ends): (u32, &[u32; 3])| {
        [[0, 1, 2], [1, 2, 0], [2, 0, 1]].map(|corners| {
            let [a, b, c] = corners;
            let corners = if ends[a] < ends[b] { corners } else { [b, a, c] };
            Side { ends: [ends[corners[0]], ends[corners[1]]], triangle, corners }
        })
    };
    let triangles = (0u32..).zip(ends.as_chunks::<3>().0).filter(|&(t, _)| repeats[t as usize]);
    let mut sides: Vec<Side> = triangles.flat_map(of_triangle).filter(|side| side.ends[0] != side.ends[1]).collect();
    sides.sort_by_key(|side| side.ends); // Stable.
    sides
}

/// Returns the map from the coordinates of the second triangle to those of the first, both given at the two ends of their edge and opposite.
/// `None` if the texture does not run on.
fn map_between([start, end, opposite]: [Vec2; 3], second: [Vec2; 3]) -> Option<Map> {
    let shift = (start - second[0]).round();
    let moved = second.map(|uv| uv + shift);
    if !is_near(moved[0], start).all() || !is_near(moved[1], end).all() {
        return None;
    }
    let line = start.round();
    let on_border = is_near(start, line) & is_near(end, line);
    let same_side = ((opposite - line) * (moved[2] - line)).cmpgt(Vec2::ZERO);
    let turns = if on_border.all() { BVec2::FALSE } else { on_border & same_side };
    Some(Map {
        sign: Vec2::select(turns, Vec2::NEG_ONE, Vec2::ONE),
        shift: Vec2::select(turns, 2.0 * line - shift, shift),
    })
}

fn is_near(a: Vec2, b: Vec2) -> BVec2 {
    (a - b).abs().cmplt(Vec2::splat(TOLERANCE))
}

/// A forest of triangles (Tarjan 1975). The root of a chart is its first triangle.
struct Charts {
    parents: Vec<u32>,
    /// Maps to the coordinates of the parents.
    maps: Vec<Map>,
}

impl Charts {
    fn new(triangles: usize) -> Self {
        Self { parents: (0..triangles as u32).collect(), maps: vec![Map::SAME; triangles] }
    }

    /// Returns the root of a triangle's chart, and the map to its coordinates. Shortens the path on the way.
    fn root(&mut self, triangle: u32) -> (u32, Map) {
        let mut path = vec![triangle];
        while self.parents[path[path.len() - 1] as usize] != path[path.len() - 1] {
            path.push(self.parents[path[path.len() - 1] as usize]);
        }
        let root = path[path.len() - 1];
        let mut map = Map::SAME;
        for &each in path.iter().rev() {
            map = map.after(self.maps[each as usize]);
            (self.parents[each as usize], self.maps[each as usize]) = (root, map);
        }
        (root, map)
    }

    fn join(&mut self, Joint { triangles, map }: Joint) {
        let [(first, to_first), (second, to_second)] = triangles.map(|triangle| self.root(triangle));
        let map = to_first.after(map).after(to_second.inverse());
        let (parent, child, map) = if first < second { (first, second, map) } else { (second, first, map.inverse()) };
        if parent != child {
            (self.parents[child as usize], self.maps[child as usize]) = (parent, map);
        }
    }
}
