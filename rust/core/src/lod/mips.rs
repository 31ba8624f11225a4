//! The mip levels of a level's page, for files that bring their own.

use std::borrow::Cow;

use super::level::Level;
use crate::textures::{PagePart, mips};

impl Level {
    /// Returns the mip levels of a channel. Those of base color keep the drawn share of each tree on the page at its cutoff, unless alpha is
    /// blended. `None` for a missing channel and for label textures.
    #[must_use]
    pub fn mips(&self, channel: &str) -> Option<mips::Levels> {
        match channel {
            "base_color" if self.alpha_cutoff == 0.0 => Some(mips::means(&self.page.base_color)),
            "base_color" => Some(mips::of_color(&self.page.base_color, &self.parts())),
            _ => self.page.levels(channel),
        }
    }

    /// Returns the pivot of each mip level of base color: the share that alpha at the cutoff stands for ([`mips::pivots`]). Empty if alpha
    /// is blended.
    #[must_use]
    pub fn alpha_pivots(&self) -> Vec<f32> {
        if self.alpha_cutoff == 0.0 {
            return Vec::new();
        }
        mips::pivots(&self.page.base_color, &PagePart::of(&self.atlas, self.alpha_cutoff))
    }

    /// Returns all trees on the page, this one among them. Made on each call, because they take four bytes for each texel of the page.
    fn parts(&self) -> Vec<PagePart> {
        let sharers = if self.sharers.is_empty() {
            Cow::Owned(vec![(self.atlas.clone(), self.alpha_cutoff)])
        } else {
            Cow::Borrowed(&*self.sharers)
        };
        sharers.iter().map(|(atlas, cutoff)| PagePart::of(atlas, *cutoff)).collect()
    }
}
