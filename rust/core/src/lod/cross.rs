//! The last level, the cross impostor: upright billboards through the center of the bounding sphere, evenly turned about up, and a horizontal
//! one at the mean height of the leaves, for views from above. Each shows the whole tree, trunk included. It keeps no ε, and no level morphs to it.
//! Billboards that show almost nothing are left out.

use std::sync::Arc;
use std::time::Instant;

use glam::{DVec2, DVec3};

use super::billboards::{billboard_ranks, billboards};
use super::cut::CutOut;
use super::level::{Level, Seconds, tightened};
use super::references::References;
use super::settings::ChainSettings;
use super::tight::Shown;
use super::tune;
use crate::atlas::{Atlas, PageChoice, PageSize};
use crate::error::Result;
use crate::foliage::{Foliage, area_vector};
use crate::geometry::{Frame, Outline, Plane};
use crate::outlines::in_plane;
use crate::progress::Progress;
use crate::textures::{Channels, Drawn, Samples, Sky, bake_timed};

/// Builds the cross impostor. `parts[0]` is the leaves; the atlas page is no larger than `most`. `references`: the renderings of all parts.
pub(super) fn build(
    parts: &[&Foliage],
    most: PageSize,
    channels: (&Channels, Option<&Sky>),
    references: &References,
    settings: &ChainSettings,
    progress: Progress,
) -> Result<Level> {
    let started = Instant::now();
    progress.tell("pack", 0.0)?;
    let leaves = parts[0];
    let frame = *leaves.frame();
    // Front and back differ, but not visibly at the distance of a cross impostor: one texture serves both, unless leaves are single-sided.
    let two_sided = settings.back_sides.unwrap_or_else(|| leaves.is_single_sided());
    let shown: Vec<Foliage> =
        parts.iter().map(|part| if two_sided { (*part).clone() } else { part.double_sided() }).collect();
    let triangles: Vec<(&Foliage, usize, [DVec3; 3])> = shown.iter().flat_map(|part| in_frame(part, frame)).collect();
    let up = settings.up.normalize();
    let planes = planes(up, settings.upright_planes, leaves, &triangles);
    let outlines: Vec<Outline> = planes.iter().map(|plane| upright(plane, up, &triangles)).collect();
    let heights = |p: &DVec3| planes.iter().map(|plane| plane.height(*p).abs()).fold(f64::INFINITY, f64::min);
    let farthest = triangles.iter().flat_map(|t| &t.2).map(heights).fold(0.0, f64::max);
    let radius_pixels = settings.radius_pixels(settings.levels, farthest);
    let texel = 1.0 / radius_pixels / TEXELS_PER_PIXEL;
    let choice = PageChoice { most, texel, back_sides: two_sided, tight: true };
    let atlas = Atlas::pack_smallest(&planes, &outlines, choice)?;
    let packed = Instant::now();

    let baking = progress.part(0.2, 0.8);
    baking.tell("bake", 0.0)?;
    let drawn = |plane: u32| {
        let plane = planes[plane as usize];
        let project = |&(foliage, triangle, corners): &(_, usize, [DVec3; 3])| Drawn {
            reach: f64::INFINITY,
            foliage,
            triangle,
            targets: corners.map(|p| plane.project(p)),
            corners,
        };
        triangles.iter().map(project).collect()
    };
    let samples = finer_samples(settings.samples, atlas.size, most);
    let (page, channel_seconds) = bake_timed(&atlas, samples, channels, drawn, baking)?;
    let baked = Instant::now();
    progress.tell("tune", 0.8)?;
    let leaves = &references.tuning;
    let (page, alpha_cutoff, atlas) = if settings.blended {
        let page = tune::blended(&atlas, &page, &frame, !two_sided, leaves)?;
        let atlas = tightened(atlas, &Shown::new(&page.base_color, 0.0), radius_pixels, usize::MAX, settings);
        (page, 0.0, atlas)
    } else {
        let atlas = tightened(atlas, &Shown::of_shares(&page.base_color), radius_pixels, usize::MAX, settings);
        let plain = billboards(&atlas, &frame, page.material(0.0, !two_sided))?;
        let (page, cutoff, _) = CutOut::of(&plain, leaves, SEEN_MIP)?.settled(page)?;
        (page, cutoff, atlas)
    };
    progress.tell("tune", 0.9)?;
    let page = tune::page(&atlas, page, &frame, alpha_cutoff, !two_sided, &references.tuning)?;
    let shown = billboards(&atlas, &frame, page.material(alpha_cutoff, !two_sided))?;
    let pictures = references.report.compare(&[&shown])?;
    let coverage = pictures.coverage();
    tune::check_shown(coverage, &page, alpha_cutoff)?;
    let (sum, count) = triangles.iter().flat_map(|t| &t.2).map(heights).fold((0.0, 0usize), |(s, n), h| (s + h, n + 1));
    Ok(Level {
        method: "cross",
        epsilon: None,
        cloud: None,
        projection: None,
        frame,
        alpha_cutoff,
        two_sided,
        ranks: billboard_ranks(&atlas, &frame, settings.fit.seed)?,
        mean_deviation: sum / count as f64 * frame.radius,
        refined: None,
        refined_planes: None,
        in_plane_motion: 0.0,
        max_deviation_leaves: farthest * frame.radius,
        radius_pixels,
        coverage,
        pictures,
        sharers: Arc::default(),
        atlas,
        page,
        seconds: Seconds {
            fit: 0.0,
            pack: (packed - started).as_secs_f64(),
            bake: (baked - packed).as_secs_f64(),
            metrics: baked.elapsed().as_secs_f64(),
            refine: 0.0,
        },
        channel_seconds,
    })
}

/// Least number of texels along a pixel where the cross impostor takes over.
const TEXELS_PER_PIXEL: f64 = 2.0;

/// The mip level with texels of a pixel there.
const SEEN_MIP: usize = 1;

/// Returns the samples with which the page has as many in all as a page of the size `most`, within the limit for a texel. The leaves are
/// the same on a smaller page, so each texel needs more samples.
fn finer_samples(samples: Samples, page: PageSize, most: PageSize) -> Samples {
    let finer = (most.width.max(most.height) / page.width.max(page.height)).max(1);
    Samples::new((samples.side() * finer).min(MOST_SAMPLES)).expect("within the limit")
}

/// Greatest number of samples along the side of a texel.
const MOST_SAMPLES: usize = 16;

/// Returns the triangles of a part in the leaves' frame.
fn in_frame(part: &Foliage, frame: Frame) -> impl Iterator<Item = (&Foliage, usize, [DVec3; 3])> {
    (0..part.triangle_count()).map(move |t| {
        let corners = part.corners(t).map(|p| frame.to_local(part.frame().to_caller(p)));
        (part, t, corners)
    })
}

/// A plane is left out if it shows less than this share of the area that the best plane shows.
const LEAST: f64 = 1.0 / 64.0;

/// Returns the planes of the cross impostor: `count` upright ones and a horizontal one, each only if it shows enough area.
fn planes(up: DVec3, count: usize, leaves: &Foliage, triangles: &[(&Foliage, usize, [DVec3; 3])]) -> Vec<Plane> {
    let flat = Plane { normal: up, distance: middle_height(up, leaves) };
    let shows = |plane: &Plane| triangles.iter().map(|t| area_vector(t.2).dot(plane.normal).abs()).sum::<f64>();
    let planes: Vec<Plane> = upright_planes(up, count).chain([flat]).collect();
    let enough = LEAST * planes.iter().map(shows).fold(0.0, f64::max);
    planes.into_iter().filter(|plane| shows(plane) >= enough).collect()
}

/// Returns the area-weighted mean height of the leaves.
fn middle_height(up: DVec3, leaves: &Foliage) -> f64 {
    let weighted = |t: usize| {
        let corners = leaves.corners(t);
        let area = area_vector(corners).length();
        (area, area * up.dot(corners.into_iter().sum::<DVec3>() / 3.0))
    };
    let (area, moment) = (0..leaves.triangle_count()).map(weighted).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    moment / area
}

/// Returns `count` planes through the origin that contain `up`, evenly turned about it. For up = z the first faces −y, as a front view does;
/// of two, the second faces x, as a side view does.
fn upright_planes(up: DVec3, count: usize) -> impl Iterator<Item = Plane> {
    let first = [DVec3::NEG_Y, DVec3::NEG_Z]
        .map(|axis| axis - up * axis.dot(up))
        .into_iter()
        .find(|n| n.length() > 0.5)
        .unwrap_or(DVec3::X)
        .normalize();
    let across = up.cross(first);
    (0..count).map(move |i| {
        let angle = std::f64::consts::PI * i as f64 / count as f64;
        // Exact at 0° and 90°: the cosine of π/2 is not 0 in f64.
        let normal = match 2 * i {
            0 => first,
            half if half == count => across,
            _ => first * libm::cos(angle) + across * libm::sin(angle),
        };
        Plane { normal, distance: 0.0 }
    })
}

/// Returns the rectangle around all triangles with one side along `up`.
fn upright(plane: &Plane, up: DVec3, triangles: &[(&Foliage, usize, [DVec3; 3])]) -> Outline {
    let (x, y) = plane.axes();
    // A horizontal plane has no side along "up": any direction will do.
    let across = up.cross(plane.normal).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let points = in_plane(plane, triangles.iter().flat_map(|t| t.2));
    Outline::along(&points, DVec2::new(x.dot(across), y.dot(across)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn upright_planes_are_even_turns_about_up() {
        for up in [DVec3::Z, DVec3::Y, DVec3::new(0.6, 0.0, 0.8)] {
            for count in 2..=5 {
                let normals: Vec<DVec3> = upright_planes(up, count).map(|plane| plane.normal).collect();
                assert_eq!(normals.len(), count);
                let next = |i: usize| if i + 1 == count { -normals[0] } else { normals[i + 1] };
                for (i, normal) in normals.iter().enumerate() {
                    assert!(normal.dot(up).abs() < 1e-12 && (normal.length() - 1.0).abs() < 1e-12);
                    let turn = normal.dot(next(i)).acos();
                    assert!((turn - std::f64::consts::PI / count as f64).abs() < 1e-9, "{turn}");
                }
            }
        }
        let [front, side] = [0, 1].map(|i| upright_planes(DVec3::Z, 2).nth(i).unwrap().normal);
        assert_eq!((front, side), (DVec3::NEG_Y, DVec3::X), "a front view and a side view, exactly");
    }
}
