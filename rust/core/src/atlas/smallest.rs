//! The smallest atlas page with texels that are fine enough.

use super::{Atlas, AtlasSettings, PageSize};
use crate::error::Result;
use crate::geometry::{Outline, Plane};

/// Least side of a page, a multiple of 2 to the power of the mip levels that keep coverage.
const LEAST_SIDE: usize = 64;

/// Choice of a page.
#[derive(Clone, Copy, Debug)]
pub struct PageChoice {
    /// The largest page.
    pub most: PageSize,
    /// Greatest side of a texel, local units; 0 for the largest page.
    pub texel: f64,
    /// Places each billboard twice, front and back.
    pub back_sides: bool,
    /// Packs tightly, which takes seconds.
    pub tight: bool,
}

impl Atlas {
    /// Places the outlines on the smallest page on which texels are at most `choice.texel` wide; on the largest one if there is none. Sides
    /// are those of the largest page, halved, but at least [`LEAST_SIDE`].
    ///
    /// # Errors
    /// The errors of [`Self::pack`].
    pub fn pack_smallest(planes: &[Plane], outlines: &[Outline], choice: PageChoice) -> Result<Self> {
        let pack = if choice.tight { Self::pack } else { Self::pack_loosely };
        let sides = if choice.back_sides { 2.0 } else { 1.0 };
        let needed = sides * outlines.iter().map(Outline::area).sum::<f64>();
        let holds = |page: &PageSize| needed <= page.texels() as f64 * choice.texel * choice.texel;
        let smaller = pages(choice.most).into_iter().filter(|page| choice.texel > 0.0 && holds(page));
        for page in smaller.filter(|page| *page != choice.most) {
            match pack(planes, outlines, AtlasSettings::of_size(page, choice.back_sides)) {
                Ok(atlas) if atlas.texel() <= choice.texel => return Ok(atlas),
                _ => {} // The next page is larger.
            }
        }
        pack(planes, outlines, AtlasSettings::of_size(choice.most, choice.back_sides))
    }
}

/// Returns the pages up to `most`, ascending: one side or the other is twice as long each time.
fn pages(most: PageSize) -> Vec<PageSize> {
    let mut pages = vec![most];
    let mut page = most;
    loop {
        let PageSize { width, height } = page;
        page = if height >= width && height >= 2 * LEAST_SIDE {
            PageSize { width, height: height / 2 }
        } else if width >= 2 * LEAST_SIDE {
            PageSize { width: width / 2, height }
        } else {
            break;
        };
        pages.push(page);
    }
    pages.reverse();
    pages
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;

    #[test]
    fn pages_double_one_side_at_a_time() {
        let sizes: Vec<(usize, usize)> = pages(256.into()).iter().map(|page| (page.width, page.height)).collect();
        assert_eq!(sizes, [(64, 64), (128, 64), (128, 128), (256, 128), (256, 256)]);
        assert_eq!(pages(PageSize { width: 64, height: 100 }).len(), 1);
    }

    #[test]
    fn a_page_is_as_small_as_its_texels_may_be_large() {
        let square = Outline::along(&[DVec2::ZERO, DVec2::ONE], DVec2::X);
        let plane = Plane { normal: DVec3::Z, distance: 0.0 };
        let packed = |texel| {
            let choice = PageChoice { most: 1024.into(), texel, back_sides: false, tight: true };
            Atlas::pack_smallest(&[plane], &[square], choice).unwrap()
        };
        // With gutters of 2 texels a square of side 1 has 60 texels on a page of 64, 124 on one of 128, 252 on one of 256.
        for (texel, side) in [(1.0 / 59.0, 64), (1.0 / 61.0, 128), (1.0 / 200.0, 256), (1e-9, 1024)] {
            let atlas = packed(texel);
            assert_eq!(atlas.size, PageSize::from(side), "texels of {texel}");
            assert!(atlas.texel() <= texel || side == 1024);
        }
    }
}
