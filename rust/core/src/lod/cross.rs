//! The last level: two perpendicular billboards that stand along "up" through the centre of the bounding sphere, each showing the whole
//! tree, wood and all. It promises no ε and is not morphed to. What lies flat, as leaves on water do, would show neither of them anything:
//! it gets one billboard that lies flat, too.

use std::time::Instant;

use glam::{DVec2, DVec3};

use super::level::{Level, Seconds, billboard_ranks, billboards};
use super::{ChainSettings, Judges, tune};
use crate::error::Result;
use crate::foliage::Foliage;
use crate::geometry::{Frame, Outline, Plane};
use crate::outlines::in_plane;
use crate::progress::Progress;
use crate::sheet::{Sheet, SheetSettings};
use crate::textures::{Drawn, bake};

pub(super) fn build(
    leaves: &Foliage,
    wood: Option<&Foliage>,
    page: usize,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Level> {
    let started = Instant::now();
    progress.tell("pack", 0.0)?;
    let frame = *leaves.frame();
    let parts: Vec<&Foliage> = std::iter::once(leaves).chain(wood).collect();
    let triangles: Vec<(&Foliage, usize, [DVec3; 3])> = parts.iter().flat_map(|part| in_frame(part, frame)).collect();
    let up = settings.up.normalize();
    let planes = planes(up, &triangles);
    let outlines: Vec<Outline> = planes.iter().map(|plane| upright(plane, up, &triangles)).collect();
    // Each side hides what the other shows, but from where a cross is seen nobody can tell: one texture unless asked for.
    let two_sided = settings.back_sides == Some(true);
    let sheet = Sheet::pack(&planes, &outlines, SheetSettings::of_size(page, two_sided))?;
    let packed = Instant::now();

    progress.tell("bake", 0.2)?;
    let page = bake(&sheet, settings.samples, &settings.channels, |plane| {
        let plane = planes[plane as usize];
        let project = |&(foliage, triangle, corners): &(_, usize, [DVec3; 3])| Drawn {
            foliage,
            triangle,
            targets: corners.map(|p| plane.project(p)),
            corners,
        };
        triangles.iter().map(project).collect()
    });
    progress.tell("bake", 0.8)?;
    let judges = Judges::new(&parts, &frame)?;
    let alpha_cutoff = tune::cutoff(&sheet, &page, &frame, !two_sided, &judges.tuning)?;
    let judgement = judges.report.judge(&billboards(&sheet, &frame, page.material(alpha_cutoff, !two_sided))?)?;
    let heights = |p: &DVec3| planes.iter().map(|plane| plane.height(*p).abs()).fold(f64::INFINITY, f64::min);
    let farthest = triangles.iter().flat_map(|t| &t.2).map(heights).fold(0.0, f64::max);
    let (sum, count) = triangles.iter().flat_map(|t| &t.2).map(heights).fold((0.0, 0usize), |(s, n), h| (s + h, n + 1));
    Ok(Level {
        method: "cross",
        epsilon: None,
        cloud: None,
        projection: None,
        frame,
        alpha_cutoff,
        two_sided,
        ranks: billboard_ranks(&sheet, &frame, settings.fit.seed)?,
        mean_deviation: sum / count as f64 * frame.radius,
        in_plane_motion: 0.0,
        max_deviation_leaves: farthest * frame.radius,
        judgement,
        sheet,
        page,
        seconds: Seconds { fit: 0.0, pack: (packed - started).as_secs_f64(), bake: packed.elapsed().as_secs_f64() },
    })
}

/// The triangles of a part in the leaves' frame.
fn in_frame(part: &Foliage, frame: Frame) -> impl Iterator<Item = (&Foliage, usize, [DVec3; 3])> {
    (0..part.triangle_count()).map(move |t| {
        let corners = part.corners(t).map(|p| frame.to_local(part.frame().to_caller(p)));
        (part, t, corners)
    })
}

/// What is less high than this share of R lies flat.
const FLAT: f64 = 1.0 / 64.0;

/// The two planes that stand, or the one that lies.
fn planes(up: DVec3, triangles: &[(&Foliage, usize, [DVec3; 3])]) -> Vec<Plane> {
    let heights = triangles.iter().flat_map(|t| t.2).map(|p| up.dot(p));
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)));
    if high - low < FLAT {
        vec![Plane { normal: up, distance: f64::midpoint(low, high) }]
    } else {
        perpendicular_planes(up).to_vec()
    }
}

/// Two planes through the origin that contain `up`; facing −y and x when up is z, as front and side views do.
fn perpendicular_planes(up: DVec3) -> [Plane; 2] {
    let first = [DVec3::NEG_Y, DVec3::NEG_Z]
        .map(|axis| axis - up * axis.dot(up))
        .into_iter()
        .find(|n| n.length() > 0.5)
        .unwrap_or(DVec3::X)
        .normalize();
    [first, up.cross(first)].map(|normal| Plane { normal, distance: 0.0 })
}

/// The rectangle around all triangles with one side along `up`.
fn upright(plane: &Plane, up: DVec3, triangles: &[(&Foliage, usize, [DVec3; 3])]) -> Outline {
    let (x, y) = plane.axes();
    // A plane that lies has no side along "up": any will do.
    let across = up.cross(plane.normal).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let points = in_plane(plane, triangles.iter().flat_map(|t| t.2));
    Outline::along(&points, DVec2::new(x.dot(across), y.dot(across)))
}
