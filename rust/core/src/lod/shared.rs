//! One atlas page for the levels of several trees, so that a forest needs one texture per level.
//!
//! Regions are copied with their gutters, texel by texel and unrotated, onto the smallest page that holds them. Nothing is drawn or
//! filtered again. Each level keeps its own alpha cutoff: a common cutoff would change filtered alpha, and with it the density of a crown.

use std::sync::Arc;

use super::level::Level;
use crate::atlas::{Atlas, Billboard, PageSize, Region, tightest};
use crate::error::{Error, Result};
use crate::foliage::Image;
use crate::textures::fill_gaps;

/// Returns the levels with their billboards on one common atlas page.
///
/// # Errors
/// No levels; levels with different channels; alpha blended levels mixed with cut-out ones; more than fits on 16384 × 16384 texels.
pub fn share_page(levels: &[&Level]) -> Result<Vec<Level>> {
    check_channels(levels)?;
    check_alpha(levels)?;
    let boxes: Vec<(usize, usize)> =
        levels.iter().flat_map(|level| outer_regions(level)).map(|region| (region.width, region.height)).collect();
    let too_large = || {
        Error::invalid(format!(
            "{} billboards of {} trees do not fit on one atlas page of 16384 × 16384 texels; bake smaller textures or share fewer trees",
            boxes.len(),
            levels.len()
        ))
    };
    let fits = |size: &PageSize| size.width.max(size.height) <= LARGEST;
    let (size, places) = tightest(&boxes).filter(|(size, _)| fits(size)).ok_or_else(too_large)?;
    let size = PageSize { width: size.width.next_multiple_of(BLOCK), height: size.height.next_multiple_of(BLOCK) };
    let mut places = places.into_iter();
    let moves: Vec<Vec<Move>> = levels
        .iter()
        .map(|level| outer_regions(level).zip(places.by_ref()).map(|(from, to)| Move { from, to }).collect())
        .collect();
    let page = levels[0].page.rebuilt(|name| {
        let images = levels.iter().map(|level| level.page.images().find(|(known, _)| *known == name));
        let images: Vec<&Image> = images.flatten().map(|(_, image)| image).collect();
        carried(&images, &moves, size, name)
    });
    let moved = |(level, moves): (&&Level, &Vec<Move>)| Atlas {
        size,
        gutter: level.atlas.gutter,
        billboards: moved_billboards(&level.atlas, moves),
    };
    let atlases: Vec<Atlas> = levels.iter().zip(&moves).map(moved).collect();
    let sharer = |(level, atlas): (&&Level, &Atlas)| (atlas.clone(), level.alpha_cutoff);
    let sharers: Arc<[(Atlas, f32)]> = levels.iter().zip(&atlases).map(sharer).collect();
    let placed = |(level, atlas): (&&Level, Atlas)| Level {
        atlas,
        page: page.clone(),
        sharers: Arc::clone(&sharers),
        ..(*level).clone()
    };
    Ok(levels.iter().zip(atlases).map(placed).collect())
}

fn check_channels(levels: &[&Level]) -> Result<()> {
    let names = |level: &Level| level.page.images().map(|(name, _)| name).collect::<Vec<_>>().join(", ");
    let Some((first, others)) = levels.split_first() else {
        return Err(Error::invalid("there are no levels to share an atlas page; give at least two"));
    };
    match others.iter().position(|level| names(level) != names(first)) {
        Some(other) => Err(Error::invalid(format!(
            "a tree has the channels {}, but the first tree has {}; bake all trees with the same effects",
            names(others[other]),
            names(first)
        ))),
        None => Ok(()),
    }
}

fn check_alpha(levels: &[&Level]) -> Result<()> {
    let blended = |level: &&&Level| level.alpha_cutoff == 0.0;
    match levels.iter().filter(blended).count() {
        count if count == 0 || count == levels.len() => Ok(()),
        count => Err(Error::invalid(format!(
            "{count} of {} trees are alpha blended, the others are cut out; bake all trees with the same blended setting",
            levels.len()
        ))),
    }
}

/// Longest side of an atlas page, in texels.
const LARGEST: usize = 16_384;

/// The sides of a page are multiples of this, so that its first six mip levels are means of 2 × 2 texels.
const BLOCK: usize = 64;

/// A region with its gutters, and the upper left corner of its new place.
struct Move {
    from: Region,
    to: (usize, usize),
}

fn outer_regions(level: &Level) -> impl Iterator<Item = Region> {
    level.atlas.regions().map(|region| region.grown(level.atlas.gutter))
}

fn moved_billboards(atlas: &Atlas, moves: &[Move]) -> Vec<Billboard> {
    let moved = |(billboard, Move { to, .. }): (&Billboard, &Move)| Billboard {
        region: Region { x: to.0 + atlas.gutter, y: to.1 + atlas.gutter, ..billboard.region },
        ..billboard.clone()
    };
    atlas.billboards.iter().zip(moves).map(moved).collect()
}

/// Copies the regions of all levels into one image of a channel; `images` has one image for each level.
fn carried(images: &[&Image], moves: &[Vec<Move>], size: PageSize, channel: &str) -> Image {
    let mut pixels = vec![None; size.texels()];
    for (image, moves) in images.iter().zip(moves) {
        for Move { from, to } in moves {
            for row in 0..from.height {
                let source = &image.pixels()[(from.y + row) * image.width() + from.x..][..from.width];
                let target = &mut pixels[(to.1 + row) * size.width + to.0..][..from.width];
                target.iter_mut().zip(source).for_each(|(to, &from)| *to = Some(from));
            }
        }
    }
    match channel {
        "base_color" => fill_gaps(size.width, &pixels),
        // Labels cannot be averaged.
        "leaf_uv" | "leaf_id" => whole(size, pixels.into_iter().map(|pixel| pixel.unwrap_or([0, 0, 0, 255]))),
        _ => fill_gaps(size.width, &pixels).mapped(|[r, g, b, _]| [r, g, b, 255]),
    }
}

fn whole(size: PageSize, pixels: impl Iterator<Item = [u8; 4]>) -> Image {
    Image::new(size.width, size.height, pixels.collect::<Vec<_>>()).expect("a pixel for each texel")
}
