//! Fit: planes for a foliage, with every vertex within ε of its triangle's plane.
//!
//! A fitter covers *pieces* with slabs. Then every piece, and every leaf that one slab holds, chooses its
//! parent among the slabs that hold it. All fitters implement [`Fitter`] and share pieces, sweeps and the choice of parents.

mod assign;
mod axes;
mod bounds;
mod budget;
mod compact;
mod density;
mod descent;
mod drafts;
mod greedy;
mod kmeans;
mod lanes;
mod literal;
mod pieces;
mod refine;
mod seeds;
mod settings;
mod stochastic;
mod sweep;
mod thinnest;

use glam::Vec3;

use crate::cloud::Cloud;
use crate::error::{Error, Result};
use crate::foliage::{Foliage, Opacity};
use crate::geometry::Plane;
use crate::limits;
use crate::outlines::outlines;
use crate::progress::Progress;

use assign::ParentCost;
use bounds::Bounds;
use density::Density;
use pieces::{Pieces, Slab, WholeLeaves};
pub use settings::{Effort, FitSettings, ImageBound, Method, Named, Preference, TEXELS_PER_EPSILON};
use stochastic::Stochastic;
use sweep::{Guard, Search};

/// A method to cover pieces with slabs.
trait Fitter: Sync {
    /// Returns slabs that hold each piece at least once within its bound, in f64. `answer` receives complete answers on the way, each
    /// better than the one before.
    fn cover(
        &self,
        pieces: &Pieces,
        search: &Search,
        progress: Progress,
        answer: &dyn Fn(&[Slab]),
    ) -> Result<Vec<Slab>>;
}

/// Share of ε reserved for rounding positions and planes to f32 in files.
const ROUNDING_MARGIN: f64 = 1e-4;

/// Bins per least bound in a sweep over offsets.
const BINS_PER_BOUND: f32 = 8.0;

/// Share of a piece's weight that is scaled by how face-on the plane sees it. At 1, a plane gains nothing from leaves that it sees
/// edge-on, which would vanish on it.
const SLOPE: f32 = 1.0;

/// Rounds of gathering pieces about the middles of planes.
const GATHERING_ROUNDS: usize = 2;

/// Greatest number of pieces with refits.
const MOST_REFITTED: usize = 40_000;

/// Number of seeds to compare when the mean deviation counts: their clouds differ by some per cent.
const FINALISTS: u64 = 6;

/// Approximate share of the time for finding the smallest bound; the rest is for refits.
const SEARCHED: f64 = 0.7;

/// Bound of the other seeds relative to the smallest bound of the first, which was lucky.
const EASIER: f64 = 1.02;

/// Approximate exponents: the need of billboards and of texels falls as ε to minus these powers.
const BILLBOARDS_POWER: f64 = 1.6;
const TEXELS_POWER: f64 = 3.0;

/// Fits a cloud to the foliage; ε is a share of the foliage's own R.
///
/// # Errors
/// A setting outside its range, or [`Error::Cancelled`](crate::Error::Cancelled).
pub fn fit(foliage: &Foliage, settings: &FitSettings, progress: Progress) -> Result<Cloud> {
    settings.check()?;
    fit_within(foliage, &settings.opacity(foliage), settings, settings.epsilon * foliage.frame().radius, progress, None)
}

/// Fits like [`fit`]. `better` receives complete clouds on the way: each has fewer planes than the one before or, with a budget, a smaller
/// ε, then a smaller mean deviation by refits.
///
/// # Errors
/// Those of [`fit`].
pub fn fit_watched(
    foliage: &Foliage,
    settings: &FitSettings,
    progress: Progress,
    better: &(dyn Fn(Cloud) + Sync),
) -> Result<Cloud> {
    settings.check()?;
    let bound = settings.epsilon * foliage.frame().radius;
    fit_within(foliage, &settings.opacity(foliage), settings, bound, progress, Some(better))
}

/// Fits a cloud with vertices that move at most `bound` (caller's units) along the normal; with a budget, at the least bound found.
pub(crate) fn fit_within(
    foliage: &Foliage,
    opacity: &Opacity,
    settings: &FitSettings,
    bound: f64,
    progress: Progress,
    better: Option<&(dyn Fn(Cloud) + Sync)>,
) -> Result<Cloud> {
    check_precision(foliage, bound)?;
    let task = Task { foliage, settings, opacity };
    // Run in the pool: otherwise its threads have to be woken for every small part of the work.
    let cloud = rayon::scope(|_| match (settings.method, settings.max_billboards, settings.max_texels) {
        (Method::KMeans, Some(count), _) => task.clustered(bound, count, progress),
        (_, None, None) => task.covered(bound, progress, better),
        _ => task.within_budget(bound, progress, better),
    })?;
    progress.tell("fit", 1.0)?;
    Ok(cloud)
}

/// Returns how far the corners of a triangle may be from any plane, in local units, in a cloud with this bound (caller's units).
pub(crate) fn motion_bound(foliage: &Foliage, triangle: usize, bound: f64, image: Option<ImageBound>) -> f64 {
    let greatest = bound / foliage.frame().radius * (1.0 - ROUNDING_MARGIN);
    f64::from(Bounds { greatest, image }.of(foliage.corners(triangle)))
}

/// Number of roundings between the local frame and the caller's coordinates: a vertex, a plane's distance, and their products.
const ROUNDINGS: f64 = 8.0;

/// Refuses foliage so far from the origin that f64 rounds vertices by more than a tenth of the bound: the bound would be meaningless.
fn check_precision(foliage: &Foliage, bound: f64) -> Result<()> {
    let far = foliage.frame().centre.abs().max_element();
    let rounded = ROUNDINGS * far * f64::EPSILON / 2.0;
    if rounded <= bound / 10.0 {
        return Ok(());
    }
    Err(Error::invalid(format!(
        "the foliage lies {far:.3e} from the origin, where coordinates are rounded by {rounded:.1e}; leaves may move by {bound:.1e}: move \
         the foliage nearer to the origin or raise `epsilon`"
    )))
}

/// Runs the search's unit of work, for benchmarks: one sweep of all pieces over eight times `octets` directions. Returns the number of
/// points and area vectors times directions, the number of changed bins, and a number that depends on all results.
#[doc(hidden)]
#[must_use]
pub fn sweep_once(foliage: &Foliage, epsilon: f64, octets: usize) -> (u64, u64, f32) {
    let settings = FitSettings { epsilon, ..FitSettings::default() };
    let task = Task { foliage, settings: &settings, opacity: &Opacity::ignored() };
    let pieces = task.pieces(epsilon * foliage.frame().radius);
    let search = task.search(&pieces, &|_| 1.0);
    let members: Vec<(u32, i32)> = (0..pieces.len() as u32).map(|i| (i, 1)).collect();
    let whole =
        Slab { plane: Plane { normal: glam::DVec3::Z, distance: 0.0 }, centre: Vec3::ZERO, reach: f32::INFINITY };
    let best = sweep::best_near(&pieces, &members, &whole, &sweep::hemisphere(octets), 1.1, &search);
    let vectors: usize = (0..pieces.len()).map(|i| pieces.points(i).len() + pieces.areas(i).len()).sum();
    let lanes = (octets * sweep::LANES) as u64;
    (vectors as u64 * lanes, 2 * pieces.len() as u64 * lanes, best.0)
}

/// Input of a fit.
struct Task<'a> {
    foliage: &'a Foliage,
    settings: &'a FitSettings,
    opacity: &'a Opacity,
}

impl Task<'_> {
    fn pieces(&self, bound: f64) -> Pieces<'_> {
        let greatest = bound / self.foliage.frame().radius * (1.0 - ROUNDING_MARGIN);
        let bounds = Bounds { greatest, image: self.settings.image };
        let whole = if self.settings.whole_leaves { WholeLeaves::Always } else { WholeLeaves::WhereCheap };
        Pieces::of(self.foliage, whole, &bounds, self.opacity)
    }

    fn search<'s>(&self, pieces: &Pieces, favour: &'s (dyn Fn(Vec3) -> f32 + Sync)) -> Search<'s> {
        Search {
            guard: Guard { facing: 0.0, slope: SLOPE },
            bin: pieces.least_bound() / BINS_PER_BOUND,
            reach: self.settings.max_size.map_or(f32::INFINITY, |size| size as f32),
            favour,
            seed: self.settings.seed,
        }
    }

    /// Returns a cloud within `bound`.
    fn covered(&self, bound: f64, progress: Progress, better: Option<&(dyn Fn(Cloud) + Sync)>) -> Result<Cloud> {
        let pieces = self.pieces(bound);
        let slabs = self.cover(&pieces, bound, progress.part(0.0, 0.9), better)?;
        let slabs = self.refined(&pieces, slabs, progress.part(0.9, 1.0))?;
        Ok(self.cloud(&pieces, &slabs, bound))
    }

    /// Returns slabs that hold all pieces within `bound`.
    fn cover(
        &self,
        pieces: &Pieces,
        bound: f64,
        progress: Progress,
        better: Option<&(dyn Fn(Cloud) + Sync)>,
    ) -> Result<Vec<Slab>> {
        let favour = self.favour(pieces);
        let search = self.search(pieces, &favour);
        let FitSettings { method, candidates, effort, penalty, .. } = *self.settings;
        let fitter: &dyn Fitter = match method {
            Method::Density => &Density { directions: candidates, penalty },
            Method::Stochastic | Method::KMeans => &Stochastic { candidates, effort },
        };
        let answer = |slabs: &[Slab]| {
            if let Some(better) = better {
                better(self.cloud(pieces, slabs, bound));
            }
        };
        fitter.cover(pieces, &search, progress, &answer)
    }

    /// Refits the slabs to their pieces; slabs of the published methods stay unchanged.
    fn refined(&self, pieces: &Pieces, slabs: Vec<Slab>, progress: Progress) -> Result<Vec<Slab>> {
        let (parent_cost, favour) = (ParentCost::new(self.settings.facing as f32, 0.0), self.favour(pieces));
        refine::refined(pieces, slabs, self.refits(pieces), &parent_cost, &self.search(pieces, &favour), progress)
    }

    /// Returns the number of refit rounds: more for higher effort or with `extra_error`, 0 for published methods and for more than
    /// [`MOST_REFITTED`] pieces, because the lists of the slabs that hold each piece would be long.
    fn refits(&self, pieces: &Pieces) -> usize {
        match (self.settings.method, self.settings.effort) {
            _ if pieces.len() > MOST_REFITTED => 0,
            (Method::Density | Method::KMeans, _) | (_, Effort::Literal) => 0,
            (_, Effort::Default) if self.extra_error() == 0.0 => 3,
            _ => 10,
        }
    }

    /// Returns the factor of a plane's score by its normal.
    fn favour<'s>(&'s self, pieces: &'s Pieces) -> impl Fn(Vec3) -> f32 + Sync + 's {
        |normal: Vec3| self.settings.preference.factor(pieces.axes.to_local(normal.as_dvec3())) as f32
    }

    /// Returns a cloud of `count` planes at any deviation; leaves that `bound` holds stay whole as in [`Self::covered`].
    fn clustered(&self, bound: f64, count: usize, progress: Progress) -> Result<Cloud> {
        let pieces = self.pieces(bound);
        let search = self.search(&pieces, &|_| 1.0);
        let (slabs, farthest) = kmeans::cluster(&pieces, count, &search, progress)?;
        let pieces = pieces.with_bound(farthest);
        let reached = f64::from(pieces.greatest_bound()) / (1.0 - ROUNDING_MARGIN) * self.foliage.frame().radius;
        Ok(self.cloud(&pieces, &slabs, reached))
    }

    /// Returns the cloud with the smallest bound found within the budget; with a budget of texels alone, not below `bound`.
    fn within_budget(&self, bound: f64, progress: Progress, better: Option<&(dyn Fn(Cloud) + Sync)>) -> Result<Cloud> {
        let radius = self.foliage.frame().radius;
        let FitSettings { max_billboards, max_texels, .. } = *self.settings;
        // Need relative to the tighter budget.
        let need = |cloud: &Cloud| {
            let billboards = max_billboards.map_or(0.0, |most| cloud.planes.len() as f64 / most as f64);
            billboards.max(max_texels.map_or(0.0, |most| self.texels(cloud) / most as f64))
        };
        let tell = |cloud: &Cloud| {
            if let Some(better) = better {
                better(cloud.clone());
            }
        };
        let mut finest = f64::INFINITY;
        let (power, least) = match max_billboards {
            Some(_) => (BILLBOARDS_POWER, limits::EPSILON.low),
            None => (TEXELS_POWER, bound / radius),
        };
        let found = budget::smallest(1.0, power, bound / radius, least, |epsilon, attempt| {
            let part = |i: usize| SEARCHED * i as f64 / budget::TRIES as f64;
            let bound = epsilon * radius;
            let pieces = self.pieces(bound);
            let slabs = self.cover(&pieces, bound, progress.part(part(attempt), part(attempt + 1)), None)?;
            let cloud = self.cloud(&pieces, &slabs, bound);
            let need = need(&cloud);
            if need <= 1.0 && epsilon < finest {
                finest = epsilon;
                tell(&cloud);
            }
            Ok(((bound, slabs, cloud), need))
        })?;
        let (bound, slabs, cloud) = found.ok_or_else(|| match (max_billboards, max_texels) {
            (Some(most), _) => budget::out_of_reach("max_billboards", most),
            (None, most) => budget::out_of_reach("max_texels", most.unwrap_or_default()),
        })?;
        let extra_error = if self.refits(&self.pieces(bound)) > 0 { self.extra_error() } else { 0.0 };
        let room = (bound * (1.0 + extra_error)).min(radius.max(bound));
        let share = |finalist: u64| finalist as f64 / FINALISTS as f64;
        let finals = |finalist| progress.part(SEARCHED, 1.0).part(share(finalist), share(finalist + 1));
        let refined = self.settled(slabs, bound, room, finals(0))?;
        // Moved slabs may need a few texels more.
        let mut nearest = cloud;
        if need(&refined) <= 1.0 {
            tell(&refined);
            nearest = refined;
        }
        let others = if extra_error > 0.0 { 1..FINALISTS } else { 1..1 };
        for finalist in others {
            let other = self.finalist(finalist, (bound * EASIER).min(room), room, finals(finalist))?;
            if need(&other) <= 1.0 && other.mean_deviation(self.foliage) < nearest.mean_deviation(self.foliage) {
                tell(&other);
                nearest = other;
            }
        }
        Ok(nearest)
    }

    /// Refits slabs that were found for `bound` within `room`, and returns their cloud.
    fn settled(&self, slabs: Vec<Slab>, bound: f64, room: f64, progress: Progress) -> Result<Cloud> {
        let pieces = self.pieces(bound).held_to((room / bound) as f32);
        Ok(self.cloud(&pieces, &self.refined(&pieces, slabs, progress)?, room))
    }

    /// Returns the cloud of another seed, found within `bound` and refitted within `room`.
    fn finalist(&self, number: u64, bound: f64, room: f64, progress: Progress) -> Result<Cloud> {
        let settings = FitSettings { seed: self.settings.seed.wrapping_add(number), ..self.settings.clone() };
        let task = Task { settings: &settings, ..*self };
        let slabs = task.cover(&task.pieces(bound), bound, progress.part(0.0, 0.7), None)?;
        task.settled(slabs, bound, room, progress.part(0.7, 1.0))
    }

    /// Returns the extra error allowance: `extra_error` for a budget of billboards without any other bound, else 0.
    fn extra_error(&self) -> f64 {
        let FitSettings { extra_error, max_billboards, max_texels, image, .. } = self.settings;
        if max_billboards.is_some() && max_texels.is_none() && image.is_none() { *extra_error } else { 0.0 }
    }

    /// Returns the texels in the rectangles of the cloud's outlines, with texels of ε / [`TEXELS_PER_EPSILON`].
    fn texels(&self, cloud: &Cloud) -> f64 {
        let texel = cloud.bound / self.foliage.frame().radius / TEXELS_PER_EPSILON;
        let onto = |t: usize| {
            let plane = cloud.planes[cloud.parents[t] as usize];
            self.foliage.corners(t).map(|p| plane.project(p))
        };
        let outlines = outlines(&cloud.planes, &cloud.parents, onto, self.opacity);
        outlines.iter().map(|o| o.size().x * o.size().y).sum::<f64>() / (texel * texel)
    }

    /// Returns the cloud in which every piece, and every leaf that a slab holds, has chosen its parent.
    fn cloud(&self, pieces: &Pieces, slabs: &[Slab], bound: f64) -> Cloud {
        let mut parent_cost = ParentCost::new(self.settings.facing as f32, self.settings.gather as f32);
        let mut parents = assign::parents(pieces, slabs, &parent_cost);
        for _ in 0..if parent_cost.gather > 0.0 { GATHERING_ROUNDS } else { 0 } {
            parent_cost = parent_cost.gathered(pieces, slabs, &parents);
            parents = assign::parents(pieces, slabs, &parent_cost);
        }
        let parents: Vec<u32> = parents.into_iter().map(|p| p.expect("a fitter covers every piece")).collect();
        let mut parents = pieces.spread(&parents);
        assign::reunite_leaves(pieces, slabs, &parent_cost, self.foliage, &mut parents);
        let (slabs, mut parents) = used(slabs, &parents);
        let mut planes: Vec<Plane> = slabs.iter().map(|slab| pieces.axes.plane_to_local(&slab.plane)).collect();
        if let Some(gap) = self.settings.compact {
            (planes, parents) = compact::parted(&planes, &parents, |t| self.foliage.corners(t), gap);
        }
        Cloud::new(self.foliage, planes, parents, bound)
    }
}

/// Returns the slabs that are parents, and the parents renumbered.
fn used(slabs: &[Slab], parents: &[u32]) -> (Vec<Slab>, Vec<u32>) {
    let mut number = vec![None; slabs.len()];
    for &k in parents {
        number[k as usize] = Some(0);
    }
    let mut kept = Vec::new();
    for (number, slab) in number.iter_mut().zip(slabs).filter(|(number, _)| number.is_some()) {
        *number = Some(kept.len() as u32);
        kept.push(*slab);
    }
    (kept, parents.iter().map(|&k| number[k as usize].expect("parents are used")).collect())
}

#[cfg(test)]
mod kernel_tests;
#[cfg(test)]
mod tests;
