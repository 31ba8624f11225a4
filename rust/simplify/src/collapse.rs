//! Collapses of a leaf's edges, the least deviation first.
//!
//! A leaf has few triangles and is thin, so its deviation is measured instead of estimated. The quadric errors of `meshopt` do not see a
//! blade of grass that gets shorter (its tip moves within the planes of its sides), and without a limit they remove the whole leaf.
//!
//! An edge (u, v) collapses to v. Every corner of the input has a nearest face. If that face is at u, the distance from the corner to the faces
//! that replace it is the deviation: an upper bound of the true one. New faces stay near the input, too: the middles of their edges are
//! within the bound of it, so that notches are not filled. A face never turns over. O(t log t) for leaves of even triangles.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;
use leafcloud::Foliage;
use leafcloud::groups::number_by_appearance;

use crate::nearest::{Triangles, in_triangle};
use crate::part::Part;

/// Least cosine between the normals of a face before and after a collapse.
const TURN: f64 = 0.2;

/// A leaf while its edges collapse. Faces and vertices keep their numbers.
pub struct Collapse<'a> {
    foliage: &'a Foliage,
    bound: f64,
    /// The leaf as it came.
    source: Triangles,
    /// Position of each vertex.
    places: Vec<DVec3>,
    /// Vertex of each corner of the foliage that the leaf uses, by the place of the corner in the leaf.
    vertex_of: Vec<u32>,
    /// The leaf's triangles in the foliage.
    triangles: &'a [u32],
    /// Corners of each face, as places in the leaf; `None` once it is gone.
    faces: Vec<Option<[u32; 3]>>,
    /// Faces at each vertex, ascending. They are few, so lists are faster than sets.
    fans: Vec<Vec<u32>>,
    /// Vertices of the source that are nearest to each face.
    nearby: Vec<Vec<u32>>,
    /// Number of changes around each vertex.
    versions: Vec<u32>,
    left: usize,
}

/// A possible collapse, ordered by its deviation.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Candidate {
    /// Bits of the deviation: numbers above 0 are ordered like their bits.
    deviation: u64,
    from: u32,
    to: u32,
    versions: [u32; 2],
}

impl<'a> Collapse<'a> {
    /// Takes a leaf of these triangles. `bound`: greatest deviation, local units.
    pub fn new(foliage: &'a Foliage, triangles: &'a [u32], bound: f64) -> Self {
        let corners: Vec<DVec3> = triangles.iter().flat_map(|&t| foliage.corners(t as usize)).collect();
        let (vertex_of, count) =
            number_by_appearance(corners.iter().map(|p| p.to_array().map(|x| (x + 0.0).to_bits())));
        let mut places = vec![DVec3::ZERO; count];
        let mut fans: Vec<Vec<u32>> = vec![Vec::new(); count];
        let mut nearby = vec![Vec::new(); triangles.len()];
        let mut is_new = vec![true; count];
        for (corner, (&vertex, &place)) in (0u32..).zip(vertex_of.iter().zip(&corners)) {
            places[vertex as usize] = place;
            let fan = &mut fans[vertex as usize];
            if fan.last() != Some(&(corner / 3)) {
                fan.push(corner / 3);
            }
            if std::mem::take(&mut is_new[vertex as usize]) {
                nearby[corner as usize / 3].push(vertex);
            }
        }
        Self {
            foliage,
            bound,
            source: Triangles::new(corners.as_chunks::<3>().0.to_vec()),
            places,
            vertex_of,
            triangles,
            faces: (0..triangles.len() as u32).map(|t| Some([3 * t, 3 * t + 1, 3 * t + 2])).collect(),
            fans,
            nearby,
            versions: vec![0; count],
            left: triangles.len(),
        }
    }

    /// Collapses edges as long as the deviation stays within the bound. Returns the faces that are left as corners of the foliage.
    pub fn run(mut self) -> Part {
        let mut queue = BinaryHeap::new();
        for vertex in 0..self.places.len() as u32 {
            self.offer(vertex, &mut queue);
        }
        while let Some(Reverse(next)) = queue.pop() {
            let is_stale = next.versions != self.versions_of(next.from, next.to);
            let is_last = self.left <= self.shared(next.from, next.to).len();
            if is_stale || is_last || self.departs(next.from, next.to) {
                continue;
            }
            // Also a vertex that loses its only face at the edge changes, and is in no ring afterward.
            let changed = ascending([next.from, next.to].into_iter().flat_map(|vertex| self.ring(vertex)));
            self.apply(next.from, next.to);
            for &vertex in &changed {
                self.versions[vertex as usize] += 1;
            }
            for &vertex in &changed {
                self.offer(vertex, &mut queue);
            }
        }
        let corner = |place: u32| 3 * self.triangles[place as usize / 3] + place % 3;
        self.faces.iter().flatten().map(|face| face.map(corner)).collect()
    }

    /// Adds all collapses of a vertex that stay within the bound.
    fn offer(&self, from: u32, queue: &mut BinaryHeap<Reverse<Candidate>>) {
        for to in self.ring(from) {
            if let Some(deviation) = self.deviation(from, to).filter(|deviation| *deviation <= self.bound) {
                let versions = self.versions_of(from, to);
                queue.push(Reverse(Candidate { deviation: deviation.to_bits(), from, to, versions }));
            }
        }
    }

    fn versions_of(&self, from: u32, to: u32) -> [u32; 2] {
        [from, to].map(|vertex| self.versions[vertex as usize])
    }

    /// Returns the vertices that share a face with this one, ascending.
    fn ring(&self, vertex: u32) -> Vec<u32> {
        let around = self.fans[vertex as usize].iter().flat_map(|&face| self.vertices(face));
        ascending(around.filter(|other| *other != vertex))
    }

    fn vertices(&self, face: u32) -> [u32; 3] {
        let corners = self.faces[face as usize].expect("a face of a fan");
        corners.map(|corner| self.vertex_of[corner as usize])
    }

    /// Returns the faces with both vertices.
    fn shared(&self, from: u32, to: u32) -> Vec<u32> {
        let (fan, other) = (&self.fans[from as usize], &self.fans[to as usize]);
        fan.iter().filter(|face| other.contains(face)).copied().collect()
    }

    /// Returns the faces of `vertex` that are none of `other`, ascending.
    fn beside(&self, vertex: u32, other: u32) -> impl Iterator<Item = u32> + '_ {
        let beyond = &self.fans[other as usize];
        self.fans[vertex as usize].iter().copied().filter(move |face| !beyond.contains(face))
    }

    /// Returns the faces of `from` that stay, with `to` in its place.
    fn replaced(&self, from: u32, to: u32) -> impl Iterator<Item = (u32, [DVec3; 3])> + '_ {
        self.beside(from, to).map(move |face| {
            let place = |vertex: u32| self.places[if vertex == from { to } else { vertex } as usize];
            (face, self.vertices(face).map(place))
        })
    }

    /// Returns the deviation after a collapse; `None` if a face would turn over or nothing of the neighborhood would be left.
    fn deviation(&self, from: u32, to: u32) -> Option<f64> {
        let replaced: Vec<(u32, [DVec3; 3])> = self.replaced(from, to).collect();
        for (face, corners) in &replaced {
            let [before, after] = [self.vertices(*face).map(|v| self.places[v as usize]), *corners].map(normal);
            if after.dot(before) <= TURN * after.length() * before.length() {
                return None;
            }
        }
        // The faces at `to` take the points of the faces that go.
        let beside: Vec<[DVec3; 3]> =
            self.beside(to, from).map(|face| self.vertices(face).map(|vertex| self.places[vertex as usize])).collect();
        let new = || replaced.iter().map(|(_, corners)| corners).chain(&beside);
        new().next()?;
        let points = self.fans[from as usize].iter().flat_map(|&face| &self.nearby[face as usize]);
        let to_new = |&vertex: &u32| {
            let p = self.places[vertex as usize];
            new().map(|corners| in_triangle(p, *corners).distance(p)).fold(f64::INFINITY, f64::min)
        };
        Some(points.map(to_new).fold(0.0, f64::max))
    }

    /// Returns whether a new edge would depart from the source by more than the bound. It takes longer than the deviation, so only the next collapse
    /// is asked.
    fn departs(&self, from: u32, to: u32) -> bool {
        let middles = self.replaced(from, to).flat_map(|(_, [a, b, c])| [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0]);
        middles.into_iter().any(|p| !self.source.reach(p, self.bound))
    }

    fn apply(&mut self, from: u32, to: u32) {
        let gone = self.shared(from, to);
        let stays: Vec<u32> = self.beside(from, to).collect();
        let corner_of = |faces: &[Option<[u32; 3]>], face: u32, vertex: u32| {
            let corners = faces[face as usize].expect("a face of a fan");
            corners.into_iter().find(|&corner| self.vertex_of[corner as usize] == vertex)
        };
        // Both corners of the edge in each face that goes. A face that stays gets the second, if its own corner has the texture
        // coordinates of the first.
        let pairs: Vec<(u32, u32)> = gone
            .iter()
            .filter_map(|&face| Some((corner_of(&self.faces, face, from)?, corner_of(&self.faces, face, to)?)))
            .collect();
        let mut points: Vec<u32> = Vec::new();
        for &face in gone.iter().chain(&stays) {
            points.append(&mut self.nearby[face as usize]);
        }
        for &face in &stays {
            let own = corner_of(&self.faces, face, from).expect("a corner at the vertex");
            let alike = pairs.iter().find(|(at_from, _)| self.uv(*at_from) == self.uv(own)).or(pairs.first());
            let new = alike.expect("an edge has a face").1;
            let corners = self.faces[face as usize].as_mut().expect("a face of a fan");
            *corners = corners.map(|corner| if corner == own { new } else { corner });
        }
        self.fans[to as usize] = ascending(self.fans[to as usize].iter().chain(&stays).copied());
        for &face in &gone {
            for vertex in self.vertices(face) {
                self.fans[vertex as usize].retain(|other| *other != face);
            }
            self.faces[face as usize] = None;
        }
        self.fans[from as usize].clear();
        self.left -= gone.len();
        let around: Vec<(u32, [DVec3; 3])> = self.fans[to as usize]
            .iter()
            .map(|&face| (face, self.vertices(face).map(|vertex| self.places[vertex as usize])))
            .collect();
        for vertex in points {
            let p = self.places[vertex as usize];
            let distance = |corners: &[DVec3; 3]| in_triangle(p, *corners).distance_squared(p);
            let nearest = around.iter().min_by(|a, b| distance(&a.1).total_cmp(&distance(&b.1)));
            self.nearby[nearest.expect("a face is left").0 as usize].push(vertex);
        }
    }

    /// Returns the texture coordinates of a corner as bits.
    fn uv(&self, place: u32) -> Option<[u32; 2]> {
        let triangle = self.triangles[place as usize / 3] as usize;
        self.foliage.attributes().uvs.get(triangle).map(|uvs| uvs[place as usize % 3].to_array().map(f32::to_bits))
    }
}

/// Returns the numbers in ascending order, each once.
fn ascending(numbers: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut numbers: Vec<u32> = numbers.collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

fn normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}
