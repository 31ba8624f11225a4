//! Tuning of a level from renderings: the stretch limit, the mean color, and alpha if nothing is cut out. [`super::cut`] has the alpha cutoff.
//!
//! Projection loses coverage, and overlap hides the loss, differently from plant to plant, so theory gives no right value. Stretch and growth keep
//! the coverage of the leaves after they collapse onto their planes. Each setting keeps one quantity, measured in a few small views, which differ from the
//! reported ones. All figures are exact on any machine.

use glam::{DVec3, Vec3};

use super::billboards::billboards;
use crate::atlas::Atlas;
use crate::cloud::Cloud;
use crate::error::{Error, Result};
use crate::foliage::{Foliage, Image, Material};
use crate::geometry::Frame;
use crate::metrics::{Reference, Views};
use crate::textures::{Page, Samples};
use crate::transition::{HAND_OVER, Projection};

/// Candidate stretch limits.
const STRETCHES: [f64; 4] = [1.0, 1.25, 1.5, 2.0];

/// Loss of coverage below which collapsed leaves do not grow: nobody sees it.
pub const LEAST_LOSS: f64 = 0.02;

/// Candidate factors on the lengths of collapsed leaves, beside 1.
const GROWTHS: [f64; 5] = [1.025, 1.05, 1.1, 1.15, 1.2];

/// Range of cutoffs of the octahedral impostor. Below it, the blurred surroundings of a leaf count as leaf; above it, only the leaf's middle
/// does.
pub const CUTOFF_RANGE: (f64, f64) = (0.03, 0.9);

/// Range of factors that make blended billboards thinner or thicker when keeping coverage.
pub const CLEARNESS_RANGE: (f64, f64) = (0.5, 2.0);

/// Turn of the tuning views. Tuning uses other cameras than the report (turn ½) and `make bench-fidelity` (turn 0), so settings are never scored
/// on the views they were tuned for.
const TURN: f64 = 0.25;

/// Returns the views for measuring coverage and color: small pictures from many sides. From single sides, a level of a fir covers 10 % more
/// or less than on average.
pub fn views_of_amounts(count: usize, up: DVec3) -> Result<Views> {
    Ok(Views { count, size: 64, samples: Samples::new(3)?.unfiltered(), up, turn: TURN })
}

/// Leaves on their planes.
pub struct Laid {
    /// The limit of the stretch, or the growth.
    factor: f64,
    pub projection: Projection,
    /// Coverage over that of the leaves.
    coverage: f64,
}

impl Laid {
    fn new(factor: f64, projection: Projection, finer: &Foliage, leaves: &Reference) -> Result<Self> {
        let coverage = leaves.agreement(&projection.at(finer, HAND_OVER)?)?.coverage;
        Ok(Self { factor, projection, coverage })
    }

    /// Returns the limit of the stretch.
    pub fn stretch(&self) -> f64 {
        self.factor
    }

    fn off(&self) -> f64 {
        (self.coverage - 1.0).abs()
    }
}

/// Returns the leaves with the limit of the stretch with which their coverage is closest to that of the leaves. `finer`
/// collapses; `leaves` renders the reference.
pub fn projection(finer: &Foliage, cloud: &Cloud, leaves: &Reference) -> Result<Laid> {
    let laid = |limit: f64| Laid::new(limit, Projection::new(finer, cloud, limit), finer, leaves);
    closest(laid(STRETCHES[0])?, &STRETCHES[1..], laid)
}

/// Returns the projection with leaves that grow as they collapse, if they lose coverage even with the best stretch: by more than
/// [`LEAST_LOSS`].
///
/// Leaves in the textures grow only where alpha cannot keep the coverage: on coarse pages grown leaves would close the gaps between leaves.
pub fn grown(finer: &Foliage, cloud: &Cloud, laid: &Laid, leaves: &Reference) -> Result<Projection> {
    let plain = Laid { projection: laid.projection.clone(), ..*laid };
    if laid.coverage >= 1.0 - LEAST_LOSS {
        return Ok(plain.projection);
    }
    let grown = |factor: f64| Laid::new(factor, laid.projection.grown(finer, cloud, factor), finer, leaves);
    Ok(closest(plain, &GROWTHS, grown)?.projection)
}

/// Returns the candidate that comes closest to the coverage of the leaves. Coverage must grow along the candidates.
fn closest(first: Laid, others: &[f64], laid: impl Fn(f64) -> Result<Laid>) -> Result<Laid> {
    let mut best = first;
    for &factor in others {
        let next = laid(factor)?;
        // Once the error grows, the candidates that follow are worse.
        if next.off() >= best.off() {
            break;
        }
        best = next;
    }
    Ok(best)
}

/// Greatest error of ln coverage against the leaves.
pub const COVERAGE_ERROR: f64 = 0.0025;

/// First guess for the change of ln coverage with the cutoff, which secants correct; most steps of the search.
const SLOPE: f64 = -0.4;
const MOVES: usize = 12;

/// Returns the page of blended billboards with alpha changed so that they cover as much as the leaves. Light passes the page as if it were
/// thinner or thicker.
///
/// # Errors
/// No billboard has an area.
pub fn blended(atlas: &Atlas, page: &Page, frame: &Frame, double_sided: bool, leaves: &Reference) -> Result<Page> {
    let of = |clearness: f64| page.clone().thickened(1.0 / clearness);
    let excess = |clearness: f64| excess(leaves, atlas, frame, of(clearness).material(0.0, double_sided));
    Ok(of(least_excess(1.0, CLEARNESS_RANGE, COVERAGE_ERROR, excess)?))
}

/// Returns ln of the billboards' coverage over that of the leaves. Uniformly faint leaves are drawn entirely or not at all; the logarithm
/// then favors too much over nothing.
fn excess(leaves: &Reference, atlas: &Atlas, frame: &Frame, material: Material) -> Result<f64> {
    leaves.agreement(&billboards(atlas, frame, material)?).map(|agreement| libm::log(agreement.coverage.max(1e-9)))
}

/// Returns a value at which |excess| is at most `error`, or the one of the least |excess| found; `excess` falls as the value rises. Uses secants
/// until the sign changes, then regula falsi, then bisection after two steps from the same side: uniformly faint leaves drop from too much to
/// nothing within one code of alpha.
pub fn least_excess(start: f64, range: (f64, f64), error: f64, excess: impl Fn(f64) -> Result<f64>) -> Result<f64> {
    let mut here = (start, excess(start)?);
    let mut best = here;
    let (mut dense, mut sparse) = ((range.0.min(start), None), (range.1.max(start), None));
    let mut slope = SLOPE;
    let mut same = 0;
    for _ in 0..MOVES {
        if best.1.abs() <= error {
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

/// Range of the color factors.
pub const TONES: (f32, f32) = (0.8, 1.25);

/// Returns the page with the mean color of the leaves. Projection changes the occlusion among leaves: a pine loses the lit tips of its
/// outer twigs, 2 % of its light. A uniform difference of 2 % over a crown is visible at distances where single leaves are not. It also
/// changes the shadows, so the colors are those that are right halfway between no light and a sun. The colors of texels below the cutoff
/// are settled first.
///
/// # Errors
/// No billboard has an area.
pub fn page(
    atlas: &Atlas,
    page: Page,
    frame: &Frame,
    cutoff: f32,
    double_sided: bool,
    leaves: &Reference,
) -> Result<Page> {
    let page = page.settled(cutoff);
    let tone = leaves.tone(&billboards(atlas, frame, page.material(cutoff, double_sided))?)?;
    Ok(page.toned(tone.clamp(Vec3::splat(TONES.0), Vec3::splat(TONES.1))))
}

/// Least coverage of a level, as a share of the leaves' coverage.
const LEAST_COVERAGE: f64 = 0.01;

/// Checks that a level shows anything.
///
/// # Errors
/// Coverage below [`LEAST_COVERAGE`], or no texel that reaches the cutoff.
pub fn check_shown(coverage: f64, page: &Page, alpha_cutoff: f32) -> Result<()> {
    let passes = page.base_color.pixels().iter().any(|p| p[3] > 0 && f32::from(p[3]) / 255.0 >= alpha_cutoff);
    if coverage >= LEAST_COVERAGE && passes { Ok(()) } else { Err(nothing_shows(&page.base_color)) }
}

fn nothing_shows(page: &Image) -> Error {
    Error::invalid(format!(
        "no leaf shows on an atlas page of {} × {} texels: the leaves are thinner than the samples of a texel; raise `texture_size` or \
         `samples`, ask for fewer levels or leave out the cross impostor",
        page.width(),
        page.height()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foliage::Attributes;
    use crate::geometry::Plane;

    /// Leaves that are far from one another, each with a copy at a height over it, and a cloud of one horizontal plane.
    fn pairs(height: f64) -> (Foliage, Cloud) {
        let leaf = |number: usize| {
            let place = DVec3::new((number % 4) as f64, (number / 4 % 4) as f64, height * (number / 16) as f64) * 3.0;
            [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(x, y)| place + DVec3::new(x, y, 0.0))
        };
        let corners: Vec<DVec3> = (0..32).flat_map(leaf).collect();
        let triangles =
            (0..32).flat_map(|leaf| [[0, 1, 2], [0, 2, 3]].map(|corners| corners.map(|i| 4 * leaf + i))).collect();
        let foliage = Foliage::new(&corners, triangles, Attributes::default(), vec![]).unwrap();
        let plane = Plane::through(DVec3::ZERO, DVec3::Z);
        let count = foliage.triangle_count();
        let cloud = Cloud::new(&foliage, vec![plane], vec![0; count], 10.0);
        (foliage, cloud)
    }

    #[test]
    fn leaves_grow_only_if_they_hide_one_another_in_their_planes() {
        for (height, expected) in [(1e-3, 1.0), (1.0, 1.2)] {
            let (foliage, cloud) = pairs(height);
            let views = views_of_amounts(16, DVec3::Z).unwrap();
            let leaves = Reference::new(&[&foliage], foliage.frame(), views).unwrap();
            let laid = projection(&foliage, &cloud, &leaves).unwrap();
            let grown = grown(&foliage, &cloud, &laid, &leaves).unwrap();
            let width = |each: &Projection| each.targets[0][0].distance(each.targets[0][1]);
            assert!((width(&grown) / width(&laid.projection) - expected).abs() < 1e-9, "pairs {height} apart");
        }
    }

    #[test]
    fn the_cutoff_that_keeps_coverage_is_found_on_any_falling_curve() {
        // A line, a step as of uniformly faint leaves, and a steep fall with a long tail.
        let line = |cutoff: f64| Ok(0.3 - cutoff);
        let step = |cutoff: f64| Ok(0.2 - 0.8 / (1.0 + libm::exp((0.207 - cutoff) / 0.002)));
        let tail = |cutoff: f64| Ok(libm::exp(-40.0 * (cutoff - 0.03)) - 0.01);
        let curves: [&dyn Fn(f64) -> Result<f64>; 3] = [&line, &step, &tail];
        for (number, excess) in curves.into_iter().enumerate() {
            for start in [0.05, 0.1, 0.25, 0.5, 0.6] {
                let left = excess(least_excess(start, CUTOFF_RANGE, COVERAGE_ERROR, excess).unwrap()).unwrap();
                assert!(left.abs() <= COVERAGE_ERROR, "curve {number} from {start}: {left} is left");
            }
        }
    }

    #[test]
    fn the_nearest_cutoff_is_found_if_none_keeps_coverage() {
        let thin = |cutoff: f64| Ok(-0.2 - cutoff);
        let found = least_excess(0.5, CUTOFF_RANGE, COVERAGE_ERROR, thin).unwrap();
        assert!((found - CUTOFF_RANGE.0).abs() < 0.01, "{found}");
    }
}
