//! What a fit may be asked.

use glam::DVec3;

use crate::error::{Error, Result, number};
use crate::foliage::{Foliage, Opacity};

/// How planes are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Search for the planes that hold most (after Lacewell, Edwards, Shirley, Thompson 2006).
    #[default]
    Stochastic,
    /// Density in plane space (Décoret, Durand, Sillion, Dorsey 2003).
    Density,
    /// Clusters about planes; the number of billboards is the input, ε the result.
    KMeans,
}

/// How long the stochastic method searches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Effort {
    /// The published algorithm, for comparison.
    Literal,
    /// Greedy over all directions and offsets.
    #[default]
    Default,
    /// The greedy answer, then a search for fewer planes.
    Final,
    /// The same, ten times as long.
    Best,
}

/// A choice by name.
pub trait Named: Copy + 'static {
    /// What the choice is of, as a setting is called.
    const WHAT: &'static str;
    /// All of them.
    const ALL: &'static [Self];

    /// The name in settings and reports.
    #[must_use]
    fn name(self) -> &'static str;

    /// The choice of this name.
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

/// Which planes are liked better than others: factors of a plane's score.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Preference {
    /// Likely directions of view, any lengths above 0; caller's axes.
    pub views: Vec<DVec3>,
    /// How much a plane loses that none of `views` sees face-on, in [0, 1].
    pub facing_views: f64,
    /// How much a plane loses that lies flat, in [0, 1]; what is up is `up`.
    pub vertical: f64,
    /// What is up.
    pub up: Option<DVec3>,
}

/// A viewer who comes no nearer than some distance: the bound is an angle there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageBound {
    /// The greatest error in the picture, in radians (a pixel is about the field of view over the resolution).
    pub angle: f64,
    /// The least distance of the viewer from the centre, as a share of R; above 1.
    pub distance: f64,
}

/// What a fit may be asked.
#[derive(Clone, Debug, PartialEq)]
pub struct FitSettings {
    /// How planes are found.
    pub method: Method,
    /// How long the stochastic method searches.
    pub effort: Effort,
    /// The greatest distance that a vertex may move along its plane's normal, as a share of R; in (0, 1].
    pub epsilon: f64,
    /// Planes tried per billboard (N of the paper); in [1, 10⁷]. Where all offsets of a direction are tried at once,
    /// two fifths of it, at most 4096, are the directions.
    pub candidates: usize,
    /// Of all randomness.
    pub seed: u64,
    /// Keep the triangles of a leaf on one plane whenever any plane could hold them all, at the cost of more billboards. Otherwise they
    /// stay together wherever one of the cloud's planes holds them all.
    pub whole_leaves: bool,
    /// The weight of 1 − |cos| against the squared relative deviation when a piece chooses its plane, ≥ 0. A plane that sees
    /// a leaf face-on is worth some distance; 0 takes the nearest plane.
    pub facing: f64,
    /// The weight of a piece's squared distance (in R) from the middle of what a plane has, when it chooses its plane, ≥ 0: billboards become
    /// smaller, and less of what is drawn is empty.
    pub gather: f64,
    /// At most so many billboards: ε is then the smallest found that needs no more, and `epsilon` is not used.
    pub max_billboards: Option<usize>,
    /// How much farther than that ε leaves may move where refits bring them nearer in the mean for it, as a share of it, in [0, 1]; where they may,
    /// clouds of several seeds are compared. For a budget of billboards alone: not with `max_texels` or `image`.
    pub slack: f64,
    /// At most so many texels, where a texel has the side of ε / [`TEXELS_PER_EPSILON`]: ε is then the smallest found that needs no more, but
    /// not below `epsilon`.
    pub max_texels: Option<usize>,
    /// The greatest distance of a billboard's leaves from the place where the billboard was found, as a share of R, in [ε, 2]. A leaf
    /// larger than that has a billboard of its own size. `None`: any distance.
    pub max_size: Option<f64>,
    /// Parts of a billboard with a gap between them become billboards of their own when the gap is at least this share of R.
    pub compact: Option<f64>,
    /// Corners of an outline; 4 gives rectangles, in [3, 16] convex outlines otherwise.
    pub max_corners: usize,
    /// Outlines enclose what is opaque of the leaves, and leaves weigh what is opaque of them.
    pub trim: bool,
    /// The density method: what a leaf takes from planes that just miss it, over what it gives to those that hold it; in [0, 100]. The paper's
    /// 10 suits surfaces.
    pub penalty: f64,
    /// Which planes are liked better.
    pub preference: Preference,
    /// A bound that grows with the distance from the viewer, where it is below ε.
    pub image: Option<ImageBound>,
}

/// Texels that ε is long in a texture that fits its cloud: a level takes over where its deviation is seen smaller than as many pixels.
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
            slack: 0.0,
            max_texels: None,
            max_size: None,
            compact: None,
            max_corners: 4,
            trim: true,
            penalty: 0.5,
            preference: Preference::default(),
            image: None,
        }
    }
}

/// Below this, f64 cannot tell whether a triangle lies on its own plane.
pub const MIN_EPSILON: f64 = 1e-9;

/// Costs in f32 must stay finite.
const LARGEST_WEIGHT: f64 = 1e6;

impl FitSettings {
    /// How much of each triangle counts as opaque: all of it unless `trim` asks for a look at the textures.
    #[must_use]
    pub fn opacity(&self, foliage: &Foliage) -> Opacity {
        if self.trim { Opacity::of(foliage) } else { Opacity::ignored() }
    }

    /// # Errors
    /// The first setting that is outside its range.
    pub fn check(&self) -> Result<()> {
        within("epsilon", self.epsilon, MIN_EPSILON, 1.0)?;
        within("candidates", self.candidates as f64, 1.0, 1e7)?;
        within("facing", self.facing, 0.0, LARGEST_WEIGHT)?;
        within("gather", self.gather, 0.0, LARGEST_WEIGHT)?;
        within("max_corners", self.max_corners as f64, 3.0, 16.0)?;
        within("slack", self.slack, 0.0, 1.0)?;
        within("penalty", self.penalty, 0.0, 100.0)?;
        if let Some(count) = self.max_billboards {
            within("max_billboards", count as f64, 1.0, 1e7)?;
        }
        if let Some(count) = self.max_texels {
            within("max_texels", count as f64, 256.0, 1e12)?;
        }
        if let Some(size) = self.max_size {
            within("max_size", size, self.epsilon, 2.0)?;
        }
        if let Some(gap) = self.compact {
            within("compact", gap, 1e-6, 2.0)?;
        }
        if let Some(ImageBound { angle, distance }) = self.image {
            within("image_epsilon", angle, MIN_EPSILON, 1.0)?;
            within("viewing_distance", distance, 1.0 + MIN_EPSILON, 1e6)?;
            within("image_epsilon × (viewing_distance − 1)", angle * (distance - 1.0), MIN_EPSILON, 1e6)?;
        }
        within("the number of views", self.preference.views.len() as f64, 0.0, 64.0)?;
        within("facing_views", self.preference.facing_views, 0.0, 1.0)?;
        within("vertical", self.preference.vertical, 0.0, 1.0)?;
        if let Some(view) =
            self.preference.views.iter().chain(&self.preference.up).find(|v| v.try_normalize().is_none())
        {
            return Err(Error::invalid(format!(
                "the direction {:?} has no finite length above 0; it shows nowhere",
                view.to_array()
            )));
        }
        if self.method == Method::KMeans { self.check_clusters() } else { Ok(()) }
    }

    /// Clusters have a number, and no bound.
    fn check_clusters(&self) -> Result<()> {
        if self.max_billboards.is_none() {
            return Err(Error::invalid(
                "the method kmeans needs max_billboards: the number of billboards is its input",
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
                "the method kmeans cannot keep {name}; leave it out or choose another method"
            ))),
            None => Ok(()),
        }
    }
}

fn within(name: &str, value: f64, least: f64, most: f64) -> Result<()> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(Error::invalid(format!("{name} is {}; it must lie between {least} and {most}", number(value))))
}

impl Preference {
    /// What a plane's score counts, in (0, 1], by its unit normal in the caller's axes.
    #[must_use]
    pub fn factor(&self, normal: DVec3) -> f64 {
        let seen = self.views.iter().filter_map(|v| v.try_normalize()).map(|v| v.dot(normal).abs()).fold(0.0, f64::max);
        let unseen = if self.views.is_empty() { 0.0 } else { self.facing_views * (1.0 - seen) };
        let up = self.up.and_then(DVec3::try_normalize).unwrap_or(DVec3::Z);
        let flat = self.vertical * up.dot(normal).abs();
        ((1.0 - unseen) * (1.0 - flat)).max(1e-3)
    }
}
