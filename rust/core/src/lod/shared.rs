//! Levels of several trees on one page, so that a forest needs one texture a level.
//!
//! Regions are carried over with their gutters, texel by texel and unturned, onto the smallest page that holds them; nothing is drawn or
//! filtered again. The same is done with the pages for engines. Each level keeps the cutoffs that these were made for: one for all would
//! change what filters make of alpha, and so how dense a crown looks.

use std::sync::{Arc, OnceLock};

use crate::error::{Error, Result};
use crate::foliage::Image;
use crate::sheet::{Billboard, PageSize, Region, Sheet, tightest};
use crate::textures::fill_gaps;
use crate::textures::mips::Part;

use super::Level;

/// The levels with their billboards on one page, the same for all. Not to be asked for on a worker of rayon's.
///
/// # Errors
/// Levels of different channels, or of which some are blended and some cut out; more than fits on 16384 × 16384 texels.
pub fn share_page(levels: &[&Level]) -> Result<Vec<Level>> {
    check_channels(levels)?;
    check_alpha(levels)?;
    let grid = levels.iter().map(|level| level.grid()).max().unwrap_or(1);
    let from_grid = |region: &Region| (region.x % grid, region.y % grid);
    let in_cells = |region: Region| {
        let (x, y) = from_grid(&region);
        ((x + region.width).div_ceil(grid), (y + region.height).div_ceil(grid))
    };
    let boxes: Vec<(usize, usize)> = levels.iter().flat_map(|level| outer_regions(level)).map(in_cells).collect();
    let too_large = || {
        Error::invalid(format!(
            "{} billboards of {} trees do not fit on one page of 16384 × 16384 texels; bake smaller textures, or share fewer",
            boxes.len(),
            levels.len()
        ))
    };
    let fits = |cells: &PageSize| cells.width.max(cells.height) * grid <= LARGEST;
    let (cells, places) = tightest(&boxes).filter(|(cells, _)| fits(cells)).ok_or_else(too_large)?;
    let size = PageSize { width: cells.width * grid, height: cells.height * grid };
    let mut places = places.into_iter();
    let moves: Vec<Vec<Move>> = levels
        .iter()
        .map(|level| {
            let moved = |(from, (column, row)): (Region, (usize, usize))| {
                let (x, y) = from_grid(&from);
                Move { from, to: (column * grid + x, row * grid + y) }
            };
            outer_regions(level).zip(places.by_ref()).map(moved).collect()
        })
        .collect();
    let page = levels[0].page.rebuilt(|name| {
        let images = levels.iter().map(|level| level.page.images().find(|(known, _)| *known == name));
        let images: Vec<&Image> = images.flatten().map(|(_, image)| image).collect();
        carried(&images, &moves, size, name)
    });
    let images: Vec<&Image> = levels.iter().map(|level| &level.for_engines().0).collect();
    let engine = carried(&images, &moves, size, "base_color");
    let moved = |(level, moves): (&&Level, &Vec<Move>)| Sheet {
        size,
        gutter: level.sheet.gutter,
        billboards: moved_billboards(&level.sheet, moves),
    };
    let sheets: Vec<Sheet> = levels.iter().zip(&moves).map(moved).collect();
    let part = |(level, sheet): (&&Level, &Sheet)| Part::of(sheet, level.for_engines().1);
    let sharers: Arc<[Part]> = levels.iter().zip(&sheets).map(part).collect();
    let placed = |(level, sheet): (&&Level, Sheet)| Level {
        sheet,
        page: page.clone(),
        sharers: Arc::clone(&sharers),
        engine: OnceLock::from((engine.clone(), level.for_engines().1)),
        ..(*level).clone()
    };
    Ok(levels.iter().zip(sheets).map(placed).collect())
}

fn check_channels(levels: &[&Level]) -> Result<()> {
    let names = |level: &Level| level.page.images().map(|(name, _)| name).collect::<Vec<_>>().join(", ");
    let Some((first, others)) = levels.split_first() else {
        return Err(Error::invalid("there are no levels to share a page; give two at least"));
    };
    match others.iter().position(|level| names(level) != names(first)) {
        Some(other) => Err(Error::invalid(format!(
            "a tree has the channels {}, but the first has {}; bake all with the same effects",
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
            "{count} of {} trees are blended, the others are cut out; bake all with the same blended",
            levels.len()
        ))),
    }
}

/// The longest side of a page.
const LARGEST: usize = 16_384;

/// A region with its gutters, and the upper left corner of its new place.
struct Move {
    from: Region,
    to: (usize, usize),
}

fn outer_regions(level: &Level) -> impl Iterator<Item = Region> {
    level.sheet.regions().map(|region| region.grown(level.sheet.gutter))
}

fn moved_billboards(sheet: &Sheet, moves: &[Move]) -> Vec<Billboard> {
    let moved = |(billboard, Move { to, .. }): (&Billboard, &Move)| Billboard {
        region: Region { x: to.0 + sheet.gutter, y: to.1 + sheet.gutter, ..billboard.region },
        ..billboard.clone()
    };
    sheet.billboards.iter().zip(moves).map(moved).collect()
}

/// The images of one channel, one for each level, as one.
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
        // Labels have no means.
        "leaf_uv" | "leaf_id" => whole(size, pixels.into_iter().map(|pixel| pixel.unwrap_or([0, 0, 0, 255]))),
        _ => fill_gaps(size.width, &pixels).mapped(|[r, g, b, _]| [r, g, b, 255]),
    }
}

fn whole(size: PageSize, pixels: impl Iterator<Item = [u8; 4]>) -> Image {
    Image::new(size.width, size.height, pixels.collect::<Vec<_>>()).expect("a pixel for each texel")
}
