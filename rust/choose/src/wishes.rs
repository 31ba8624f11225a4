//! The settings that quality decides by: allowed difference, scene, memory and sizes.

use leafcloud::error::{Error, Result};
use leafcloud::limits::{self, Limits};

use crate::leaves::Form;
use crate::scene::{NEAREST, Scene};

/// Range of quality.
pub const QUALITY: Limits = Limits::SHARE;

/// Range of the budget of compressed textures, in MB. The smallest has room for some thousand billboards.
pub const MEMORY: Limits = Limits::between(0.25, 10_000.0);

/// Range of a size at which a level takes over, as a share of the picture's height.
pub const SIZE: Limits = Limits { above: true, ..Limits::between(0.01, 1.0) };

/// Most sizes.
pub const MOST_SIZES: usize = 4;

/// Factor on the allowed difference from the middle of quality to its ends.
const RANGE: f64 = 2.0;

/// Largest diameter of a crown in pixels at which a level takes over by its looks: half of the picture's height.
pub const LARGEST_CROWN: f64 = 0.5 * NEAREST;

/// Largest diameter of a crown in pixels at which a cloud after the first takes over: a sixth of the picture's height. It is built for fewer.
pub const LATER_CROWN: f64 = NEAREST / 6.0;

/// Quality from which choices are rough and made in a part of the time, in small pictures. They say nothing about larger crowns.
const QUICK: f64 = 0.25;
const LARGEST_OF_QUICK: f64 = 250.0;

/// The settings from which the levels of a chain are chosen by quality.
#[derive(Clone, Debug)]
pub struct Wishes {
    /// From 0 (fast) to 1 (exact).
    pub quality: f64,
    /// Distance to the horizon in R.
    pub scene: f64,
    /// Budget of the levels' compressed textures in MB.
    pub memory_budget: f64,
    /// Sizes at which the levels take over, as shares of the picture's height, descending; empty: where they pass.
    pub sizes: Vec<f64>,
    /// Whether the renderer shows alpha as a share, not cut out.
    pub shares: bool,
    /// Whether ε may be chosen.
    pub free: bool,
    /// The form of level 1.
    pub form: Form,
    /// Whether clouds show thin branches. Their trunks then lack these.
    pub twigs: bool,
}

impl Default for Wishes {
    fn default() -> Self {
        Self {
            quality: 0.5,
            scene: 50.0,
            memory_budget: 4.0,
            sizes: Vec::new(),
            shares: false,
            free: true,
            form: Form::default(),
            twigs: false,
        }
    }
}

impl Wishes {
    /// Checks all wishes.
    ///
    /// # Errors
    /// The first outside its range; sizes that do not descend, or too many.
    pub fn check(&self) -> Result<()> {
        QUALITY.check("quality", self.quality)?;
        MEMORY.check("memory_budget", self.memory_budget)?;
        self.scene()?;
        self.sizes.iter().try_for_each(|size| SIZE.check("sizes", *size))?;
        if self.sizes.len() > MOST_SIZES || !self.sizes.is_sorted_by(|a, b| a > b) {
            return Err(Error::invalid(format!(
                "`sizes` is {:?}; give at most {MOST_SIZES} shares of the picture's height, the largest first",
                self.sizes
            )));
        }
        Ok(())
    }

    /// Returns q: FLIP of a level over the control's, where it takes over.
    #[must_use]
    pub fn q(&self) -> f64 {
        libm::pow(RANGE, 1.0 - 2.0 * self.quality)
    }

    /// Returns whether choices may be rough.
    #[must_use]
    pub fn is_quick(&self) -> bool {
        self.quality <= QUICK
    }

    /// Returns the largest diameter of the crown in pixels at which a level takes over by its looks.
    #[must_use]
    pub fn largest_crown(&self) -> f64 {
        if self.is_quick() { LARGEST_OF_QUICK } else { LARGEST_CROWN }
    }

    /// Returns the scene.
    ///
    /// # Errors
    /// A horizon outside its range.
    pub fn scene(&self) -> Result<Scene> {
        Scene::to(self.scene)
    }

    /// Returns the wished diameter of the crown in pixels where the level with this number takes over, from 0.
    #[must_use]
    pub fn crown(&self, number: usize) -> Option<f64> {
        self.sizes.get(number).map(|share| share * NEAREST)
    }

    /// Returns the greatest side of the first cloud's page within the budget, a power of two. Each further page has half of the side.
    /// `images`: on each page.
    #[must_use]
    pub fn page_side(&self, images: usize) -> usize {
        // The pages have 1, 1/4, 1/16 … of the first one's texels.
        let side = (self.memory_budget / compressed(1) / (images as f64 * 4.0 / 3.0)).sqrt();
        let least = limits::TEXTURE_SIZE.low;
        libm::exp2(libm::log2(side.max(least)).floor()) as usize
    }
}

/// Returns the MB of compressed textures: a byte a texel, and a third of it for mip levels.
#[must_use]
pub fn compressed(texels: usize) -> f64 {
    texels as f64 * 4.0 / 3.0 / (1024.0 * 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quality_halves_and_doubles_the_allowed_difference() {
        let q = |quality| Wishes { quality, ..Wishes::default() }.q();
        assert_eq!([0.0, 0.5, 1.0].map(q), [2.0, 1.0, 0.5]);
    }

    #[test]
    fn pages_fit_the_budget() {
        let side = |memory, images| Wishes { memory_budget: memory, ..Wishes::default() }.page_side(images);
        assert_eq!(
            [(4.0, 2), (4.0, 3), (16.0, 2), (1.0, 2), (0.25, 2)].map(|(m, i)| side(m, i)),
            [1024, 512, 2048, 512, 256]
        );
    }

    #[test]
    fn wishes_out_of_range_are_refused_by_name() {
        let refused = |wishes: Wishes| wishes.check().unwrap_err().to_string();
        assert!(refused(Wishes { quality: 1.5, ..Wishes::default() }).starts_with("`quality` is 1.5"));
        assert!(refused(Wishes { memory_budget: 0.0, ..Wishes::default() }).starts_with("`memory_budget` is 0"));
        assert!(refused(Wishes { scene: 1.0, ..Wishes::default() }).starts_with("`scene` is 1"));
        assert!(refused(Wishes { sizes: vec![2.0], ..Wishes::default() }).starts_with("`sizes` is 2"));
        assert!(refused(Wishes { sizes: vec![0.1, 0.2], ..Wishes::default() }).contains("the largest first"));
        assert!(Wishes { sizes: vec![0.5, 0.25], ..Wishes::default() }.check().is_ok());
    }
}
