//! Pictures of a trunk behind leaves, and how much they change.

use glam::DVec3;
use leafcloud::metrics::{View, Views, in_each_view, seen_behind};
use leafcloud::textures::{Samples, SeenInPixel, SeenTriangles};
use leafcloud::{Attributes, Foliage, Material, Progress, Result};

use crate::Sight;

/// Number of views.
const VIEWS: usize = 16;
/// Cells of a picture are this many pixels wide: a part that moves by less than a pixel hardly changes a cell.
const CELL: f64 = 2.0;
/// Greatest width of a picture in cells.
const WIDEST: f64 = 1024.0;

/// Number of samples that show a part in a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Shown {
    cell: u32,
    part: u32,
    count: u32,
}

/// How pictures of a trunk change with simpler parts, in samples over all views.
pub struct Changes {
    /// Samples that show leaves or trunk.
    pub area: u64,
    /// Samples that show each part of the whole trunk.
    pub seen: Vec<u64>,
    /// For each given trunk, the change of each part.
    pub of_parts: Vec<Vec<u64>>,
}

/// A trunk, with the part of each triangle.
struct Owned {
    foliage: Foliage,
    /// The part of each triangle.
    owners: Vec<u32>,
}

/// Compares the whole trunk with others. `trunks`: for each of them the triangles of each part.
pub fn changes(trunk: &Foliage, trunks: &[Vec<&[[u32; 3]]>], sight: Sight, progress: Progress) -> Result<Changes> {
    let parts = trunk.leaf_count();
    let others = trunks.iter().map(|parts| owned(trunk, parts)).collect::<Result<Vec<Owned>>>()?;
    let drawn: Vec<&Foliage> = [trunk].into_iter().chain(others.iter().map(|other| &other.foliage)).collect();
    let none = || Changes { area: 0, seen: vec![0; parts], of_parts: vec![vec![0; parts]; others.len()] };
    let of_view = |view: &View| {
        progress.tell("simplify", 0.0)?;
        let pictures = seen_behind(sight.leaves, &drawn, view)?;
        let before = shown(&pictures[0], trunk.leaf_ids());
        let mut changes = Changes { area: pictures[0].covered, ..none() };
        for each in &before {
            changes.seen[each.part as usize] += u64::from(each.count);
        }
        for ((picture, other), changes) in pictures[1..].iter().zip(&others).zip(&mut changes.of_parts) {
            add_differences(&before, &shown(picture, &other.owners), changes);
        }
        Ok(changes)
    };
    let views: Vec<View> = views(trunk, sight).collect();
    let all: Vec<&Foliage> = sight.leaves.into_iter().chain(drawn.iter().copied()).collect();
    let of_views = in_each_view(&all, &views, of_view)?;
    Ok(of_views.iter().fold(none(), Changes::plus))
}

impl Changes {
    fn plus(mut self, other: &Self) -> Self {
        let add = |to: &mut Vec<u64>, from: &Vec<u64>| to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
        self.area += other.area;
        add(&mut self.seen, &other.seen);
        self.of_parts.iter_mut().zip(&other.of_parts).for_each(|(to, from)| add(to, from));
        self
    }
}

fn views(trunk: &Foliage, sight: Sight) -> impl Iterator<Item = View> {
    let frame = trunk.frame();
    let size = (2.05 * frame.radius / (CELL * sight.pixel)).ceil().clamp(16.0, WIDEST) as usize;
    Views { count: VIEWS, size, samples: Samples::default(), up: sight.up, turn: 0.5 }.around(frame)
}

/// Returns a trunk made of triangles of each part. Triangles without area show nothing.
fn owned(trunk: &Foliage, parts: &[&[[u32; 3]]]) -> Result<Owned> {
    let place = |corner: u32| trunk.frame().to_caller(trunk.corners(corner as usize / 3)[corner as usize % 3]);
    let of_parts =
        (0u32..).zip(parts).flat_map(|(part, triangles)| triangles.iter().map(move |t| (part, t.map(place))));
    let has_area = |(_, [a, b, c]): &(u32, [DVec3; 3])| (*b - *a).cross(*c - *a) != DVec3::ZERO;
    let (owners, corners): (Vec<u32>, Vec<[DVec3; 3]>) = of_parts.filter(has_area).unzip();
    let triangles = (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let attributes = Attributes { leaf_ids: vec![0; corners.len()], ..Attributes::default() };
    Ok(Owned {
        foliage: Foliage::new(corners.as_flattened(), triangles, attributes, vec![Material::default()])?,
        owners,
    })
}

/// Returns the parts shown in each cell, by cell and part. `owners`: the part of each triangle.
fn shown(picture: &SeenTriangles, owners: &[u32]) -> Vec<Shown> {
    let shown =
        |seen: &SeenInPixel| Shown { cell: seen.pixel, part: owners[seen.triangle as usize], count: seen.count };
    merged(picture.pieces.iter().map(shown).collect())
}

/// Sorts by cell and part, and adds counts of equal ones.
fn merged(mut shown: Vec<Shown>) -> Vec<Shown> {
    shown.sort_unstable();
    let mut result: Vec<Shown> = Vec::with_capacity(shown.len());
    for each in shown {
        match result.last_mut() {
            Some(last) if (last.cell, last.part) == (each.cell, each.part) => last.count += each.count,
            _ => result.push(each),
        }
    }
    result
}

/// Adds the differences of counts to `changes`, for each part.
fn add_differences(before: &[Shown], after: &[Shown], changes: &mut [u64]) {
    let (mut i, mut j) = (0, 0);
    loop {
        let keys = (before.get(i).map(|s| (s.cell, s.part)), after.get(j).map(|s| (s.cell, s.part)));
        let (part, change) = match keys {
            (None, None) => return,
            (Some(a), Some(b)) if a == b => {
                (i, j) = (i + 1, j + 1);
                (a.1, before[i - 1].count.abs_diff(after[j - 1].count))
            }
            (Some(a), b) if b.is_none_or(|b| a < b) => {
                i += 1;
                (a.1, before[i - 1].count)
            }
            _ => {
                j += 1;
                (after[j - 1].part, after[j - 1].count)
            }
        };
        changes[part as usize] += u64::from(change);
    }
}
