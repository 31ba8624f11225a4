//! The settings of a chain, and the settings of each level that follow from them.

use glam::DVec3;

use super::refine::{RefinedParts, Refinement};
use super::worth::{LEAST_SAVING, LEAST_SAVING_IN_SCENES};
use crate::atlas::PageSize;
use crate::error::{Error, Result};
use crate::fit::{FitSettings, ImageBound, Method};
use crate::foliage::Foliage;
use crate::limits;
use crate::metrics::check_up;
use crate::textures::{Channels, Samples};

/// Factor by which ε grows from level to level (the paper: at least 2).
pub const EPSILON_STEP: f64 = 2.5;

/// Divisor of the billboard count from level to level, if `max_billboards` is the input of the method.
const BILLBOARDS_STEP: usize = 4;

/// Number of view directions for each measurement of a chain: 0 to 64 for `order`, 1 to 64 for the others. Time is proportional to them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewCounts {
    /// Visible share of each leaf, for the pruning order. With 0, position and chance alone decide the order.
    pub order: usize,
    /// Coverage and mean color, for the stretch limit, alpha and the tone.
    pub amounts: usize,
    /// Reported metrics.
    pub report: usize,
}

impl ViewCounts {
    /// The fewest views that still tell settings apart. The figures are off by a few percent.
    pub const QUICK: Self = Self { order: 0, amounts: 1, report: 2 };

    /// For a first look at a tree.
    pub const FEW: Self = Self { order: 0, amounts: 4, report: 1 };

    fn check(self) -> Result<()> {
        let Self { order, amounts, report } = self;
        let counts = [("order", order.max(1)), ("amounts", amounts), ("report", report)];
        counts.into_iter().try_for_each(|(name, count)| limits::VIEW_COUNT.check(name, count as f64))
    }
}

impl Default for ViewCounts {
    fn default() -> Self {
        Self { order: 16, amounts: 16, report: 8 }
    }
}

/// ε of a cloud, and the size at which it takes over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudStep {
    /// ε as a share of R.
    pub epsilon: f64,
    /// Diameter of the crown in pixels where the cloud takes over.
    pub crown_pixels: f64,
    /// For the first cloud: its budget of triangles, as a share of that of a cloud near the viewer. Later ones have a share of the cloud before.
    pub share: f64,
}

/// Settings of a chain of levels. [`limits`] has the range of each number.
#[derive(Clone, Debug)]
#[allow(clippy::struct_excessive_bools)] // The flags are independent.
pub struct ChainSettings {
    /// The fit of level 1; ε grows by [`EPSILON_STEP`] from level to level.
    pub fit: FitSettings,
    /// Number of billboard clouds. With 0, the cross impostor is the only level.
    pub levels: usize,
    /// ε and size of each cloud. Empty: ε grows by [`EPSILON_STEP`], and `pixels` sets the sizes.
    pub steps: Vec<CloudStep>,
    /// Adds the cross impostor as the last level.
    pub cross: bool,
    /// Number of upright planes of the cross impostor, 2 to 5.
    pub upright_planes: usize,
    /// Makes every level. Otherwise a level is left out if it saves less than a tenth of the cost of drawing the level before it, where it
    /// takes over.
    pub every_level: bool,
    /// Up direction; the planes of the cross impostor contain it.
    pub up: DVec3,
    /// Most triangles of level 1, trunk included. With `None`, a share of the tree's; ε may then lead to more.
    pub triangles: Option<usize>,
    /// Most corners of a polygon of a billboard.
    pub max_corners: usize,
    /// Least visible share of a leaf; leaves with less are left out of all levels. 0 keeps all leaves. Pruning prefers visible leaves anyway,
    /// and leaves out no others.
    pub min_visibility: f64,
    /// Largest atlas page of level 1, halved from level to level.
    pub texture_size: PageSize,
    /// Makes pages as small as their texels allow: a texel is at most half a pixel where its level takes over. The page of the cross impostor
    /// is always made that small.
    pub fitting_pages: bool,
    /// Sub-samples for baking the textures.
    pub samples: Samples,
    /// Channels of the atlas beside base color.
    pub channels: Channels,
    /// Separate textures for front and back. With `None`, only where leaves are single-sided: from behind they are not drawn.
    pub back_sides: Option<bool>,
    /// Pruning of the leaves before level 1 takes over; `None` keeps all leaves.
    pub pruning: Option<PruneSettings>,
    /// Closes gaps between billboards: each billboard also shows the parts of other planes' triangles within ε of its own plane.
    pub close_gaps: bool,
    /// Draws billboards alpha blended: alpha is coverage and nothing is cut out. They must be drawn from back to front
    /// ([`crate::blend_order`]).
    pub blended: bool,
    /// Spends seconds on packing the atlas tightly, for texels a few percent finer than quick packing gives.
    pub tight_pages: bool,
    /// Size in pixels at which a level's deviation from the leaves is seen where the level takes over. The texels of the cross
    /// impostor are at most half a pixel there.
    pub pixels: f64,
    /// Numbers of view directions.
    pub views: ViewCounts,
    /// Refinement of planes and textures of billboard clouds by pictures. Blended billboards are not refined.
    pub refine: Refinement,
    /// Parts of the refinement; others than all are for measurements.
    pub refined_parts: RefinedParts,
}

/// Settings for pruning the leaves before level 1 takes over.
#[derive(Clone, Copy, Debug)]
pub struct PruneSettings {
    /// λ where level 1 takes over. The levels are built from the leaves kept at that λ, at their size there.
    pub keep: f64,
    /// Length of a leaf in pixels where pruning begins.
    pub leaf_pixels: f64,
    /// h of the law of λ; see [`crate::prune::keep`].
    pub half: f64,
    /// Measures the loss of contrast.
    pub contrast: bool,
}

impl Default for PruneSettings {
    fn default() -> Self {
        Self { keep: 1.0, leaf_pixels: 16.0, half: 0.5, contrast: true }
    }
}

impl PruneSettings {
    fn check(&self) -> Result<()> {
        let Self { keep, leaf_pixels, half, contrast: _ } = *self;
        limits::KEEP.check("keep", keep)?;
        limits::LEAF_PIXELS.check("leaf_pixels", leaf_pixels)?;
        limits::PRUNE_HALF.check("prune_half", half)
    }

    /// Returns the crown's width in pixels at the distance where the share `keep` of its leaves is kept, clamped to [12, 192].
    #[must_use]
    pub fn crown_pixels(&self, foliage: &Foliage, keep: f64) -> usize {
        let area: f64 = (0..foliage.triangle_count()).map(|t| foliage.area_vector(t).length()).sum();
        let leaf = (area / foliage.leaf_count() as f64).sqrt();
        let nearer = libm::pow(keep, libm::log(self.half) / libm::log(0.5));
        (2.05 / leaf * self.leaf_pixels * nearer).clamp(12.0, 192.0) as usize
    }
}

impl Default for ChainSettings {
    fn default() -> Self {
        Self {
            fit: FitSettings::default(),
            levels: 3,
            steps: Vec::new(),
            cross: true,
            upright_planes: 2,
            every_level: true,
            up: DVec3::Z,
            triangles: None,
            max_corners: 5,
            min_visibility: 0.02,
            texture_size: 2048.into(),
            fitting_pages: true,
            samples: Samples::default(),
            channels: Channels::default(),
            back_sides: None,
            pruning: None,
            close_gaps: false,
            blended: false,
            tight_pages: true,
            pixels: 8.0,
            views: ViewCounts::default(),
            refine: Refinement::default(),
            refined_parts: RefinedParts::default(),
        }
    }
}

impl ChainSettings {
    /// Returns whether levels are also judged under a sun: their billboards have the normals of their leaves. Bent normals are meant to look
    /// different.
    #[must_use]
    pub fn is_lit(&self) -> bool {
        self.channels.normal == Some(0.0)
    }

    /// Checks all settings.
    ///
    /// # Errors
    /// The first setting outside its range.
    pub fn check(&self) -> Result<()> {
        check_up(self.up)?;
        self.fit.check()?;
        self.channels.check()?;
        self.views.check()?;
        limits::LEVELS.check("levels", self.levels as f64)?;
        limits::UPRIGHT_PLANES.check("upright_planes", self.upright_planes as f64)?;
        if self.levels == 0 && !self.cross {
            return Err(Error::invalid(
                "`levels` is 0 without a cross impostor; ask for at least one level or for the cross impostor",
            ));
        }
        self.pruning.as_ref().map_or(Ok(()), PruneSettings::check)?;
        self.triangles.map_or(Ok(()), |count| limits::TRIANGLES.check("triangles", count as f64))?;
        limits::MIN_VISIBILITY.check("min_visibility", self.min_visibility)?;
        limits::MAX_CORNERS.check("max_corners", self.max_corners as f64)?;
        limits::PIXELS.check("pixels", self.pixels)?;
        for step in &self.steps {
            limits::EPSILON.check("epsilon", step.epsilon)?;
            limits::PIXELS.check("crown_pixels", step.crown_pixels)?;
        }
        limits::TEXTURE_SIZE.check("texture_size", self.texture_size.width as f64)?;
        limits::TEXTURE_SIZE.check("texture_height", self.texture_size.height as f64)
    }

    /// Returns the fit settings of the level with this index, from 0; `finer` is the ε of the level before it. A budget applies to the
    /// first level only. Later levels follow from its ε or, if the billboard count is the input of the method, from that count.
    pub(super) fn fit_of(&self, index: usize, finer: Option<f64>) -> FitSettings {
        let wanted = self.steps.get(index).map(|step| step.epsilon);
        let Some(finer) = finer else {
            return FitSettings { epsilon: wanted.unwrap_or(self.fit.epsilon), ..self.fit.clone() };
        };
        let coarser = libm::pow(EPSILON_STEP, index as f64);
        let fewer = |count: usize| (count / BILLBOARDS_STEP.pow(index as u32)).max(1);
        FitSettings {
            epsilon: wanted.unwrap_or(finer * EPSILON_STEP).min(1.0),
            max_billboards: self.fit.max_billboards.filter(|_| self.fit.method == Method::KMeans).map(fewer),
            max_texels: None,
            image: self.fit.image.map(|image| ImageBound { angle: image.angle * coarser, ..image }),
            // A billboard torn in two shows a seam through its whole texture.
            whole_leaves: true,
            ..self.fit.clone()
        }
    }

    /// Returns the least share of the cost of the level before that a level must save, after `count` levels. Clouds that are built for a scene
    /// save half.
    pub(super) fn least_saving(&self, count: usize) -> f64 {
        if self.steps.is_empty() || count == 0 { LEAST_SAVING } else { LEAST_SAVING_IN_SCENES }
    }

    /// Returns R in pixels where the level with this index, from 0, takes over; `deviation`: its deviation as a share of R.
    pub(super) fn radius_pixels(&self, index: usize, deviation: f64) -> f64 {
        let wanted = self.steps.get(index).map(|step| 0.5 * step.crown_pixels);
        wanted.unwrap_or(self.pixels / deviation.max(f64::MIN_POSITIVE))
    }

    /// Returns the atlas size of the level with this index, from 0.
    pub(super) fn page(&self, index: usize) -> PageSize {
        let PageSize { width, height } = self.texture_size;
        let least = limits::TEXTURE_SIZE.low as usize;
        PageSize { width: (width >> index).max(least), height: (height >> index).max(least) }
    }
}
