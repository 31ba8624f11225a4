//! Settings of a fit.

use glam::DVec3;

use crate::error::{Error, Result, number};
use crate::foliage::{Foliage, Opacity};
use crate::limits::{self, Limits};

/// Method that finds the planes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Searches for the planes that hold the most leaf area (after Lacewell, Edwards, Shirley, Thompson 2006).
    #[default]
    Stochastic,
    /// Density in plane space (Décoret, Durand, Sillion, Dorsey 2003).
    Density,
    /// Clusters about planes: the number of billboards is the input, ε the result.
    KMeans,
}

/// Search effort of the stochastic method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Effort {
    /// The published algorithm, for comparison.
    Literal,
    /// A greedy search over all directions and offsets.
    #[default]
    Default,
    /// The greedy search, then a descent to fewer planes.
    Final,
    /// `Final` with ten times as many steps.
    Best,
}

/// A setting with named choices.
pub trait Named: Copy + 'static {
    /// The setting's name, for messages.
    const WHAT: &'static str;
    /// All choices.
    const ALL: &'static [Self];

    /// Returns the name in settings and reports.
    #[must_use]
    fn name(self) -> &'static str;

    /// Returns the choice with this name.
    ///
    /// # Errors
    /// An unknown name; the message lists those that exist.
    fn from_name(name: &str) -> Result<Self> {
        Self::ALL.iter().copied().find(|choice| choice.name() == name).ok_or_else(|| {
            let known: Vec<&str> = Self::ALL.iter().map(|choice| choice.name()).collect();
            Error::invalid(format!("{} {name:?} is unknown; choose one of: {}", Self::WHAT, known.join(", ")))
        })
    }
}

impl Named for Method {
    const WHAT: &'static str = "method";
    const ALL: &'static [Self] = &[Self::Stochastic, Self::Density, Self::KMeans];

    fn name(self) -> &'static str {
        match self {
            Self::Stochastic => "stochastic",
            Self::Density => "density",
            Self::KMeans => "kmeans",
        }
    }
}

impl Named for Effort {
    const WHAT: &'static str = "effort";
    const ALL: &'static [Self] = &[Self::Literal, Self::Default, Self::Final, Self::Best];

    fn name(self) -> &'static str {
        match self {
            Self::Literal => "literal",
            Self::Default => "default",
            Self::Final => "final",
            Self::Best => "best",
        }
    }
}

/// Preferences for planes, as factors of a plane's score.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Preference {
    /// Likely viewing directions in the caller's axes; any lengths above 0.
    pub views: Vec<DVec3>,
    /// Score penalty for planes that face none of `views`, in [0, 1].
    pub facing_views: f64,
    /// Score penalty for horizontal planes, in [0, 1].
    pub vertical: f64,
    /// Up direction; `None` is +Z.
    pub up: Option<DVec3>,
}

/// A view-dependent bound: viewers keep a distance, and the error is an angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageBound {
    /// Greatest angular error in the image, in radians (a pixel is about the field of view over the resolution).
    pub angle: f64,
    /// Least distance of the viewer from the center, as a share of R; above 1.
    pub distance: f64,
}

/// Settings of a fit. [`limits`] has the range of each number.
#[derive(Clone, Debug, PartialEq)]
pub struct FitSettings {
    /// Method that finds the planes.
    pub method: Method,
    /// Search effort of the stochastic method.
    pub effort: Effort,
    /// Greatest distance that a vertex may move along its plane's normal, as a share of R.
    pub epsilon: f64,
    /// Planes tried per billboard (N of the paper). A search that tries all offsets of a direction at once uses two
    /// fifths as many directions, at most 4096.
    pub candidates: usize,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Keep the triangles of a leaf on one plane whenever any plane could hold them all, at the cost of more billboards. Otherwise they
    /// stay together only if one of the cloud's planes holds them all.
    pub whole_leaves: bool,
    /// Weight of 1 − |cos| against the squared relative deviation when a piece chooses its plane, ≥ 0. Higher values prefer planes that see
    /// a leaf face-on over nearer ones; 0 takes the nearest plane.
    pub facing: f64,
    /// Weight of a piece's squared distance (in R) from the middle of a plane's pieces when it chooses its plane, ≥ 0. Higher values give
    /// smaller billboards with less empty area.
    pub gather: f64,
    /// Greatest number of billboards. ε is then the smallest found within it, and `epsilon` is not used.
    pub max_billboards: Option<usize>,
    /// Extra error allowed beyond the ε found for `max_billboards`, as a share of it. Refits spend it to reduce the mean deviation, and
    /// clouds of several seeds are compared. Only for a budget of billboards alone: without effect with `max_texels` or `image`.
    pub extra_error: f64,
    /// Greatest number of texels with a side of ε / [`TEXELS_PER_EPSILON`]. ε is then the smallest found within it, but
    /// not below `epsilon` unless `max_billboards` is given, too.
    pub max_texels: Option<usize>,
    /// Greatest distance of a billboard's leaves from the place where the billboard was found, as a share of R, in [ε, 2]. A larger
    /// leaf gets a billboard of its own size. `None`: no limit.
    pub max_size: Option<f64>,
    /// Least gap, as a share of R, that splits a billboard into several. `None`: no splits.
    pub compact: Option<f64>,
    /// Fit outlines to the opaque parts of leaves, and weigh leaves by their opaque area.
    pub trim: bool,
    /// For the density method: score that a leaf subtracts from planes that just miss it, relative to the score that it adds to planes that
    /// hold it. The paper's 10 suits surfaces.
    pub penalty: f64,
    /// Preferred planes.
    pub preference: Preference,
    /// View-dependent bound; it applies where it is below ε.
    pub image: Option<ImageBound>,
}

/// Texels per ε in a texture that suits its cloud: a level takes over when its deviation appears smaller than this many pixels.
pub const TEXELS_PER_EPSILON: f64 = 8.0;

impl Default for FitSettings {
    fn default() -> Self {
        Self {
            method: Method::default(),
            effort: Effort::default(),
            epsilon: 0.04,
            candidates: 600,
            seed: 0,
            whole_leaves: false,
            facing: 1.0,
            gather: 0.0,
            max_billboards: None,
            extra_error: 0.25,
            max_texels: None,
            max_size: None,
            compact: None,
            trim: true,
            penalty: 0.5,
            preference: Preference::default(),
            image: None,
        }
    }
}

impl FitSettings {
    /// Returns the opaque part of each triangle; all of it without `trim`.
    #[must_use]
    pub fn opacity(&self, foliage: &Foliage) -> Opacity {
        if self.trim { Opacity::of(foliage) } else { Opacity::ignored() }
    }

    /// Checks all settings.
    ///
    /// # Errors
    /// The first setting that is outside its range.
    pub fn check(&self) -> Result<()> {
        limits::EPSILON.check("epsilon", self.epsilon)?;
        limits::CANDIDATES.check("candidates", self.candidates as f64)?;
        limits::FACING.check("facing", self.facing)?;
        limits::GATHER.check("gather", self.gather)?;
        limits::EXTRA_ERROR.check("extra_error", self.extra_error)?;
        limits::PENALTY.check("penalty", self.penalty)?;
        if let Some(count) = self.max_billboards {
            limits::MAX_BILLBOARDS.check("max_billboards", count as f64)?;
        }
        if let Some(count) = self.max_texels {
            limits::MAX_TEXELS.check("max_texels", count as f64)?;
        }
        if let Some(size) = self.max_size {
            Limits { low: self.epsilon, ..limits::MAX_SIZE }.check("max_size", size)?;
        }
        if let Some(gap) = self.compact {
            limits::COMPACT.check("compact", gap)?;
        }
        self.image.map_or(Ok(()), ImageBound::check)?;
        self.preference.check_count()?;
        limits::FACING_VIEWS.check("facing_views", self.preference.facing_views)?;
        limits::VERTICAL.check("vertical", self.preference.vertical)?;
        if let Some(view) =
            self.preference.views.iter().chain(&self.preference.up).find(|v| v.try_normalize().is_none())
        {
            return Err(Error::invalid(format!(
                "a direction of `views` or `up`, {:?}, has no finite length above 0; give another direction",
                view.to_array()
            )));
        }
        if self.method == Method::KMeans { self.check_clusters() } else { Ok(()) }
    }

    /// Checks the settings of k-means, which needs a number of billboards and cannot keep a bound.
    fn check_clusters(&self) -> Result<()> {
        if self.max_billboards.is_none() {
            return Err(Error::invalid(
                "`method=kmeans` needs `max_billboards`: the number of billboards is its input",
            ));
        }
        let given = [
            ("max_size", self.max_size.is_some()),
            ("compact", self.compact.is_some()),
            ("image_epsilon", self.image.is_some()),
            ("max_texels", self.max_texels.is_some()),
        ];
        match given.into_iter().find(|(_, given)| *given) {
            Some((name, _)) => Err(Error::invalid(format!(
                "`method=kmeans` does not support `{name}`; leave it out or choose another method"
            ))),
            None => Ok(()),
        }
    }
}

impl ImageBound {
    fn check(self) -> Result<()> {
        limits::IMAGE_EPSILON.check("image_epsilon", self.angle)?;
        limits::VIEWING_DISTANCE.check("viewing_distance", self.distance)?;
        // Leaves on the bounding sphere are nearest to the viewer, so their ε is the least.
        if self.angle * (self.distance - 1.0) >= limits::EPSILON.low {
            return Ok(());
        }
        Err(Error::invalid(format!(
            "`image_epsilon` {} at the `viewing_distance` {} is an error of less than {} R; raise one of them",
            number(self.angle),
            number(self.distance),
            number(limits::EPSILON.low)
        )))
    }
}

impl Preference {
    fn check_count(&self) -> Result<()> {
        let count = self.views.len();
        if limits::VIEWS.hold(count as f64) {
            return Ok(());
        }
        Err(Error::invalid(format!("`views` has {count} directions; their number must be {}", limits::VIEWS)))
    }

    /// Returns the factor of a plane's score, in (0, 1], by its unit normal in the caller's axes.
    #[must_use]
    pub fn factor(&self, normal: DVec3) -> f64 {
        let seen = self.views.iter().filter_map(|v| v.try_normalize()).map(|v| v.dot(normal).abs()).fold(0.0, f64::max);
        let unseen = if self.views.is_empty() { 0.0 } else { self.facing_views * (1.0 - seen) };
        let up = self.up.and_then(DVec3::try_normalize).unwrap_or(DVec3::Z);
        let flat = self.vertical * up.dot(normal).abs();
        ((1.0 - unseen) * (1.0 - flat)).max(1e-3)
    }
}
