//! What a level's looks decide: how far leaves may be stretched, and the alpha cutoff, or alpha itself where nothing is cut out.
//!
//! Projection loses coverage, overlap hides the loss, and filtering spreads lacy leaves over their texels; all differ from plant to
//! plant, so there is no right value in theory. Each setting has one thing to keep, judged by a few small views (other ones than those
//! reported): the stretch keeps the coverage of the leaves once they have collapsed onto their planes, the cutoff keeps what is covered
//! where, at the moment when the billboards take over from the collapsed leaves, and then is moved until as much is covered as by the
//! leaves. All figures are exact on any machine.

use glam::{DVec3, Vec3};

use super::level::billboards;
use crate::cloud::Cloud;
use crate::error::{Error, Result};
use crate::foliage::{Foliage, Image, Material};
use crate::geometry::Frame;
use crate::judge::{Glance, Judge, Judgement, Views};
use crate::sheet::Sheet;
use crate::textures::{Page, Samples};
use crate::transition::{HAND_OVER, Projection};

/// The limits of the stretch that may be chosen.
const STRETCHES: [f64; 4] = [1.0, 1.25, 1.5, 2.0];

/// The cutoffs that may be chosen, and where the search begins when there are texels that reach it.
const CUTOFFS: [f32; 13] = [0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6];
const FIRST: f32 = 0.5;

/// Within these a cutoff is moved to keep coverage: below, what filters leave of a leaf counts as leaf; above, only its middle does.
const CUTOFF_RANGE: (f64, f64) = (0.03, 0.9);

/// Within these what is blended is made clearer than it was drawn, or less clear, likewise.
const CLEARNESS_RANGE: (f64, f64) = (0.5, 2.0);

/// From less coverage than this on, what is left of the leaves is looked for below.
const MOSTLY_LOST: f64 = 0.5;

/// What a difference in coverage weighs beside the loss of overlap, when a cutoff is chosen: getting denser by 5 % is as bad as 1 % less overlap.
const COVERAGE_WEIGHT: f64 = 0.2;

/// Neither what is reported nor what `make fidelity` measures is seen from where settings are chosen: those have turns of ½ and 0.
const TURN: f64 = 0.25;

/// By what it is judged where leaves are: few views, and large ones.
pub fn views_of_places(count: usize, up: DVec3) -> Result<Views> {
    Ok(Views { count, size: 96, samples: Samples::new(2)?, up, turn: TURN })
}

/// By what it is judged how much there is of them, and of which colour: small pictures from many sides, for from single sides a level of a
/// fir covers 10 % more or less than in the mean.
pub fn views_of_amounts(count: usize, up: DVec3) -> Result<Views> {
    Ok(Views { count, size: 64, samples: Samples::new(3)?.unfiltered(), up, turn: TURN })
}

/// The projection whose collapsed leaves cover what the leaves cover; `leaves` are judged, `finer` is what collapses.
pub fn projection(finer: &Foliage, cloud: &Cloud, leaves: &Judge) -> Result<Projection> {
    let mut best: Option<(f64, Projection)> = None;
    for limit in STRETCHES {
        let projection = Projection::new(finer, cloud, limit);
        let coverage = leaves.glance(&projection.at(finer, HAND_OVER)?)?.coverage;
        let off = (coverage - 1.0).abs();
        // Coverage grows with the stretch: once it strays, more strays farther.
        match best {
            Some((least, _)) if off >= least => break,
            _ => best = Some((off, projection)),
        }
    }
    Ok(best.expect("the first stretch is always a choice").1)
}

/// The alpha cutoff with which the billboards look most like what they take over from.
///
/// It begins at ½, or below where most of the leaves would be lost, and moves along [`CUTOFFS`] while that improves; coverage falls as the cutoff
/// rises, so the cost has one valley. A page so faint that no texel reaches the least of them is cut at half of its greatest alpha.
///
/// # Errors
/// No texel of the page shows anything.
pub fn cutoff(sheet: &Sheet, page: &Page, frame: &Frame, double_sided: bool, before: &Judge) -> Result<f32> {
    let look = |index: usize| before.glance(&billboards(sheet, frame, page.material(CUTOFFS[index], double_sided))?);
    let cost =
        |glance: &Glance| 1.0 - glance.overlap + COVERAGE_WEIGHT * (1.0 - glance.coverage.min(1.0 / glance.coverage));
    let cost_of = |index: usize| look(index).map(|glance| cost(&glance));
    let most = greatest_alpha(&page.base_color)?;
    let Some(mut first) = CUTOFFS.iter().rposition(|&c| c <= most.min(FIRST)) else { return Ok(most / 2.0) };
    let mut glance = look(first)?;
    while first > 0 && glance.coverage < MOSTLY_LOST {
        first -= 1;
        glance = look(first)?;
    }
    let (mut best, mut least) = (first, cost(&glance));
    for direction in [-1isize, 1] {
        while let Some(next) = best.checked_add_signed(direction).filter(|&i| i < CUTOFFS.len()) {
            let cost = cost_of(next)?;
            if cost >= least {
                break;
            }
            (best, least) = (next, cost);
        }
        if best != first {
            break;
        }
    }
    Ok(CUTOFFS[best])
}

/// How far from the leaves' coverage a level may be.
const COVERAGE_ERROR: f64 = 0.0025;

/// How the logarithm of coverage changes with the cutoff at first, about; secants correct it. How often the cutoff is moved.
const SLOPE: f64 = -0.4;
const MOVES: usize = 12;

/// The cutoff near `cutoff` with which the billboards cover what the leaves cover; as near to that as a cutoff comes.
///
/// # Errors
/// All billboards are without area.
pub fn matched(
    cutoff: f32,
    sheet: &Sheet,
    page: &Page,
    frame: &Frame,
    double_sided: bool,
    leaves: &Judge,
) -> Result<f32> {
    let excess = |cutoff: f64| excess(leaves, sheet, frame, page.material(cutoff as f32, double_sided));
    Ok(least_excess(f64::from(cutoff), CUTOFF_RANGE, excess)? as f32)
}

/// The page of billboards that are blended, with which they cover what the leaves cover: light passes it as if it were so much thinner or thicker.
///
/// # Errors
/// All billboards are without area.
pub fn blended(sheet: &Sheet, page: &Page, frame: &Frame, double_sided: bool, leaves: &Judge) -> Result<Page> {
    let of = |clearness: f64| page.clone().thickened(1.0 / clearness);
    let excess = |clearness: f64| excess(leaves, sheet, frame, of(clearness).material(0.0, double_sided));
    Ok(of(least_excess(1.0, CLEARNESS_RANGE, excess)?))
}

/// By how much billboards cover more than the leaves; as a logarithm: of what is faint all over, all is drawn or nothing, and too much is better.
fn excess(leaves: &Judge, sheet: &Sheet, frame: &Frame, material: Material) -> Result<f64> {
    leaves.glance(&billboards(sheet, frame, material)?).map(|glance| libm::log(glance.coverage.max(1e-9)))
}

/// Where coverage, which falls from `start` on upward, exceeds nothing. Secants until that is crossed; then false positions, and halves where
/// these come from the same side twice: what is faint all over falls from too much to nothing within a code of alpha.
fn least_excess(start: f64, range: (f64, f64), excess: impl Fn(f64) -> Result<f64>) -> Result<f64> {
    let mut here = (start, excess(start)?);
    let mut best = here;
    let (mut dense, mut sparse) = ((range.0.min(start), None), (range.1.max(start), None));
    let mut slope = SLOPE;
    let mut same = 0;
    for _ in 0..MOVES {
        if best.1.abs() <= COVERAGE_ERROR {
            break;
        }
        let end = if here.1 > 0.0 { &mut dense } else { &mut sparse };
        *end = (here.0, Some(here.1));
        let aim = match (dense.1, sparse.1) {
            (Some(_), Some(_)) if same > 1 => 0.5 * (dense.0 + sparse.0),
            (Some(above), Some(below)) => dense.0 + (sparse.0 - dense.0) * above / (above - below),
            _ => here.0 - here.1 / slope,
        };
        let next = if dense.0 < aim && aim < sparse.0 { aim } else { 0.5 * (dense.0 + sparse.0) };
        let there = (next, excess(next)?);
        slope = ((there.1 - here.1) / (there.0 - here.0)).clamp(10.0 * SLOPE, 0.1 * SLOPE);
        same = if there.1.signum() == here.1.signum() { same + 1 } else { 1 };
        here = there;
        if here.1.abs() < best.1.abs() {
            best = here;
        }
    }
    Ok(best.0)
}

/// The range of factors by which colours may be moved.
const TONES: (f32, f32) = (0.8, 1.25);

/// The page with the mean colour of the leaves: projection changes which parts of leaves hide which (a pine loses the lit tips of its outer
/// twigs, 2 % of its light), and a difference of 2 % all over a crown is seen where no leaf is. What fails the cutoff is settled first.
///
/// # Errors
/// All billboards are without area.
pub fn page(sheet: &Sheet, page: Page, frame: &Frame, cutoff: f32, double_sided: bool, leaves: &Judge) -> Result<Page> {
    let page = page.settled(cutoff);
    let tone = leaves.tone(&billboards(sheet, frame, page.material(cutoff, double_sided))?)?;
    Ok(page.toned(tone.clamp(Vec3::splat(TONES.0), Vec3::splat(TONES.1))))
}

fn greatest_alpha(page: &Image) -> Result<f32> {
    let most = page.pixels().iter().map(|p| p[3]).max().unwrap_or(0);
    if most > 0 { Ok(f32::from(most) / 255.0) } else { Err(nothing_shows(page)) }
}

/// What covers less than this of what the leaves cover is not there.
const LEAST_COVERAGE: f64 = 0.01;

/// A level that covers nothing of what the leaves cover, or of whose page nothing passes the cutoff, is none.
///
/// # Errors
/// It is none.
pub fn check_shown(judgement: &Judgement, page: &Page, alpha_cutoff: f32) -> Result<()> {
    let passes = page.base_color.pixels().iter().any(|p| p[3] > 0 && f32::from(p[3]) / 255.0 >= alpha_cutoff);
    if judgement.coverage >= LEAST_COVERAGE && passes { Ok(()) } else { Err(nothing_shows(&page.base_color)) }
}

fn nothing_shows(page: &Image) -> Error {
    Error::invalid(format!(
        "nothing shows on a page of {} × {} texels: the leaves are thinner there than the samples of a texel; raise `texture_size` or `samples`, \
         ask for fewer levels, or leave out the cross",
        page.width(),
        page.height()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cutoff_that_keeps_coverage_is_found_wherever_coverage_falls() {
        // Lines, a step as of leaves that are faint all over, and what falls at once and then hardly.
        let line = |cutoff: f64| Ok(0.3 - cutoff);
        let step = |cutoff: f64| Ok(0.2 - 0.8 / (1.0 + libm::exp((0.207 - cutoff) / 0.002)));
        let tail = |cutoff: f64| Ok(libm::exp(-40.0 * (cutoff - 0.03)) - 0.01);
        let curves: [&dyn Fn(f64) -> Result<f64>; 3] = [&line, &step, &tail];
        for (number, excess) in curves.into_iter().enumerate() {
            for start in [0.05, 0.1, 0.25, 0.5, 0.6] {
                let left = excess(least_excess(start, CUTOFF_RANGE, excess).unwrap()).unwrap();
                assert!(left.abs() <= COVERAGE_ERROR, "curve {number} from {start}: {left} is left");
            }
        }
    }

    #[test]
    fn where_no_cutoff_keeps_coverage_the_nearest_is_found() {
        let thin = |cutoff: f64| Ok(-0.2 - cutoff);
        let found = least_excess(0.5, CUTOFF_RANGE, thin).unwrap();
        assert!((found - CUTOFF_RANGE.0).abs() < 0.01, "{found}");
    }
}
