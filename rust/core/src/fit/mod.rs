//! The fit: planes for a foliage such that every vertex lies within ε of its triangle's plane.
//!
//! A fitter covers *pieces* (whole leaves wherever one plane can hold them) with planes; then every piece chooses its
//! parent among the planes that hold it. Fitters stand side by side behind [`Fitter`] and share pieces, scoring and choice.

mod assign;
mod blocks;
mod pieces;
mod random;
mod stochastic;

use crate::cloud::Cloud;
use crate::error::{Error, Result};
use crate::foliage::Foliage;
use crate::geometry::Plane;
use crate::progress::Progress;

use pieces::Pieces;
pub(crate) use random::Stream;
use stochastic::Stochastic;

/// How planes are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Random search (Lacewell, Edwards, Shirley, Thompson 2006).
    #[default]
    Stochastic,
}

impl Method {
    /// All methods.
    pub const ALL: [Self; 1] = [Self::Stochastic];

    /// The name in settings and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stochastic => "stochastic",
        }
    }

    /// The method of this name.
    ///
    /// # Errors
    /// An unknown name; the message lists those that exist.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            Error::invalid(format!("method {name:?} is unknown; choose one of: {known}"))
        })
    }
}

/// What a fit may be asked.
#[derive(Clone, Copy, Debug)]
pub struct FitSettings {
    /// How planes are found.
    pub method: Method,
    /// The greatest distance that a vertex may move along its plane's normal, as a share of R; in (0, 1].
    pub epsilon: f64,
    /// Planes tried per billboard (N of the paper); in [1, 10⁷].
    pub candidates: usize,
    /// Of all randomness.
    pub seed: u64,
    /// Keep the triangles of a leaf on one plane whenever one plane holds them all.
    pub whole_leaves: bool,
    /// The weight of 1 − |cos| against the squared relative deviation when a piece chooses its plane, ≥ 0. A plane that sees
    /// a leaf face-on is worth some distance; 0 takes the nearest plane.
    pub facing: f64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { method: Method::Stochastic, epsilon: 0.04, candidates: 600, seed: 0, whole_leaves: true, facing: 1.0 }
    }
}

/// Below this, f64 cannot tell whether a triangle lies on its own plane.
const MIN_EPSILON: f64 = 1e-9;

impl FitSettings {
    /// # Errors
    /// The first setting that is outside its range.
    pub fn check(&self) -> Result<()> {
        let Self { epsilon, candidates, facing, .. } = *self;
        if !(MIN_EPSILON..=1.0).contains(&epsilon) {
            return Err(Error::invalid(format!(
                "epsilon is {epsilon}; it must be above 0 (at least {MIN_EPSILON}) and at most 1 (a share of R)"
            )));
        }
        if !(1..=10_000_000).contains(&candidates) {
            return Err(Error::invalid(format!("candidates is {candidates}; it must lie between 1 and 10000000")));
        }
        if !(facing >= 0.0 && facing.is_finite()) {
            return Err(Error::invalid(format!("facing is {facing}; it must be finite and at least 0")));
        }
        Ok(())
    }
}

/// A way to cover pieces with planes.
trait Fitter: Sync {
    /// Planes such that each piece is held by at least one within `bound` (local units), in f64.
    fn cover(&self, pieces: &Pieces, bound: f64, progress: Progress) -> Result<Vec<Plane>>;
}

/// The share of ε that is left to the rounding of positions and planes to f32 in files.
const ROUNDING_MARGIN: f64 = 1e-4;

/// Fits a cloud to the foliage; ε is a share of the foliage's own R.
///
/// # Errors
/// A setting outside its range, or [`Error::Cancelled`].
pub fn fit(foliage: &Foliage, settings: &FitSettings, progress: Progress) -> Result<Cloud> {
    settings.check()?;
    fit_within(foliage, settings, settings.epsilon * foliage.frame().radius, progress)
}

/// Fits a cloud whose vertices move at most `bound` (caller's units) along the normal.
pub(crate) fn fit_within(foliage: &Foliage, settings: &FitSettings, bound: f64, progress: Progress) -> Result<Cloud> {
    let local_bound = bound / foliage.frame().radius * (1.0 - ROUNDING_MARGIN);
    let pieces = Pieces::of(foliage, settings.whole_leaves, local_bound);
    let fitter: &dyn Fitter = match settings.method {
        Method::Stochastic => &Stochastic { candidates: settings.candidates, seed: settings.seed },
    };
    let planes = fitter.cover(&pieces, local_bound, progress)?;
    let (planes, parents) = assign::choose_parents(&pieces, &planes, local_bound, settings.facing);
    progress.tell("fit", 1.0)?;
    Ok(Cloud::new(foliage, planes, pieces.spread(&parents, foliage.triangle_count()), bound))
}

#[cfg(test)]
mod tests;
