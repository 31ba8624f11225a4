//! Levels of several trees on one page, so that a forest needs one texture a level.
//!
//! Regions are carried over with their gutters, texel by texel and unturned, onto the smallest page that holds them; nothing is drawn or
//! filtered again. All get one cutoff, the mean of theirs: alpha is moved so that just the same texels pass.

use std::sync::{Arc, OnceLock};

use crate::error::{Error, Result};
use crate::foliage::Image;
use crate::sheet::{Billboard, PageSize, Region, Sheet, tightest};
use crate::textures::{Page, fill_gaps, mips};

use super::Level;

/// The levels with their billboards on one page, the same for all.
///
/// # Errors
/// Levels of different channels, or of which some are blended and some cut out; more than fits on 16384 × 16384 texels.
pub fn share_page(levels: &[&Level]) -> Result<Vec<Level>> {
    check_channels(levels)?;
    check_alpha(levels)?;
    let boxes: Vec<(usize, usize)> =
        levels.iter().flat_map(|level| outer_regions(level)).map(|r| (r.width, r.height)).collect();
    let too_large = || {
        Error::invalid(format!(
            "{} billboards of {} trees do not fit on one page of 16384 × 16384 texels; bake smaller textures, or share fewer",
            boxes.len(),
            levels.len()
        ))
    };
    let (size, places) = tightest(&boxes).ok_or_else(too_large)?;
    let mut places = places.into_iter();
    let moves: Vec<Vec<Move>> = levels
        .iter()
        .map(|level| outer_regions(level).zip(places.by_ref()).map(|(from, to)| Move { from, to }).collect())
        .collect();
    let cutoff = levels.iter().map(|level| level.alpha_cutoff).sum::<f32>() / levels.len() as f32;
    let page = shared(levels, &moves, size, cutoff);
    let sheets = levels.iter().zip(&moves);
    let regions: Arc<[Region]> =
        sheets.flat_map(|(level, moves)| moved_billboards(&level.sheet, moves)).map(|b| b.region).collect();
    let moved = |(level, moves): (&&Level, &Vec<Move>)| Level {
        sheet: Sheet { size, gutter: level.sheet.gutter, billboards: moved_billboards(&level.sheet, moves) },
        page: page.clone(),
        regions: Arc::clone(&regions),
        alpha_cutoff: cutoff,
        engine: OnceLock::new(),
        ..(*level).clone()
    };
    Ok(levels.iter().zip(&moves).map(moved).collect())
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

/// A region with its gutters, and the upper left corner of its new place.
struct Move {
    from: Region,
    to: (usize, usize),
}

fn outer_regions(level: &Level) -> impl Iterator<Item = Region> {
    let gutter = level.sheet.gutter;
    level.sheet.billboards.iter().map(move |Billboard { region, .. }| Region {
        x: region.x - gutter,
        y: region.y - gutter,
        width: region.width + 2 * gutter,
        height: region.height + 2 * gutter,
    })
}

fn moved_billboards(sheet: &Sheet, moves: &[Move]) -> Vec<Billboard> {
    let moved = |(billboard, Move { to, .. }): (&Billboard, &Move)| Billboard {
        region: Region { x: to.0 + sheet.gutter, y: to.1 + sheet.gutter, ..billboard.region },
        ..billboard.clone()
    };
    sheet.billboards.iter().zip(moves).map(moved).collect()
}

fn shared(levels: &[&Level], moves: &[Vec<Move>], size: PageSize, cutoff: f32) -> Page {
    let cutoffs: Vec<[u8; 256]> = levels.iter().map(|level| alpha_table(level.alpha_cutoff, cutoff)).collect();
    levels[0].page.rebuilt(|name| {
        let mut pixels = vec![None; size.texels()];
        for ((level, moves), alpha) in levels.iter().zip(moves).zip(&cutoffs) {
            let Some((_, image)) = level.page.images().find(|(known, _)| *known == name) else { continue };
            let settled = |[r, g, b, a]: [u8; 4]| [r, g, b, if name == "base_color" { alpha[a as usize] } else { a }];
            for Move { from, to } in moves {
                for row in 0..from.height {
                    let source = &image.pixels()[(from.y + row) * image.width() + from.x..][..from.width];
                    let target = &mut pixels[(to.1 + row) * size.width + to.0..][..from.width];
                    target.iter_mut().zip(source).for_each(|(to, &from)| *to = Some(settled(from)));
                }
            }
        }
        match name {
            "base_color" => fill_gaps(size.width, &pixels),
            // Labels have no means.
            "leaf_uv" | "leaf_id" => whole(size, pixels.into_iter().map(|pixel| pixel.unwrap_or([0, 0, 0, 255]))),
            _ => fill_gaps(size.width, &pixels).mapped(|[r, g, b, _]| [r, g, b, 255]),
        }
    })
}

fn whole(size: PageSize, pixels: impl Iterator<Item = [u8; 4]>) -> Image {
    Image::new(size.width, size.height, pixels.collect::<Vec<_>>()).expect("a pixel for each texel")
}

/// Codes of alpha for another cutoff: linear on either side, and what passed still does.
fn alpha_table(old: f32, new: f32) -> [u8; 256] {
    let [before, after] = [old, new].map(|cutoff| f32::from(mips::code_at_least(cutoff)));
    std::array::from_fn(|code| {
        let code = code as f32;
        if code >= before {
            (after + (code - before) / (255.0 - before).max(1.0) * (255.0 - after)).round() as u8
        } else {
            (code * after / before).round().min(after - 1.0) as u8
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_passed_passes_and_nothing_else() {
        for (old, new) in [(0.5, 0.3), (0.2, 0.6), (0.5, 0.5), (1.0, 0.1), (0.01, 0.9)] {
            let table = alpha_table(old, new);
            for code in 0..=255u8 {
                let passes = |code: u8, cutoff: f32| f32::from(code) / 255.0 >= cutoff;
                assert_eq!(passes(code, old), passes(table[code as usize], new), "{code} at {old} for {new}");
            }
            assert!(table.is_sorted());
            assert!(old != new || table.iter().zip(0..=255u8).all(|(&moved, code)| moved == code));
        }
    }
}
