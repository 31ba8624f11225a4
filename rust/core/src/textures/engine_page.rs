//! Base color for engines that make box-filtered mip levels themselves, as from a PNG. Each part has a cutoff of its own.
//!
//! Texels are about a pixel large where the level takes over: a finer page would only be more to store, and its first mip levels would not
//! be seen. The coverage-keeping mip level of that size ([`super::mips`]) gets alpha that keeps its area behind it, too
//! ([`super::cascade`]).
//!
//! Blocks of texels overlap in other places than the leaves on the page, so the same area on the polygons covers up to a tenth more of a picture,
//! and shows other leaves: an oak was 4 % too bright. So pictures of the billboards correct the area and the mean color, on the mip levels that
//! are seen first: up to [`CORRECTIONS`] pages more, by the same recipe. Pictures also choose the cutoff, and refine the texels
//! ([`Pictured::refined`]); where they cannot, the next best cutoff gets a chance.

use glam::Vec3;

use super::cascade::{Keeping, Kept};
use super::light_grid::LightGrid;
use super::mips::{code_at_least, of_part};
use super::parts::{PagePart, apart, together};
use super::tone;
use crate::error::Result;
use crate::foliage::Image;

/// Most places on the polygons at which alpha is looked up, some thousand times.
const PLACES: usize = 1 << 14;

/// Number of mip levels that pictures show, from the first seen one on: a level is drawn up to some four times its distance.
const PICTURED: usize = 3;

/// Most corrections of the area.
const CORRECTIONS: usize = 2;

/// Most cutoffs with which a page is refined.
const REFINED: usize = 2;

/// Error of the coverage that needs no correction.
const COVERAGE_ERROR: f64 = 0.005;

/// How much larger the error of the area on mip levels ([`Kept::error`]) may become by a correction.
const WORSE: f64 = 0.15;

/// How much larger it may be than that of the best page for pictures to prefer a page: they show no mip level at which the tree has but some
/// pixels. A page of 24² texels with 0.15 more lost four fifths of its area on such a level.
const CHOSEN_WORSE: f64 = 0.1;

/// Range of the factors on the area.
const AREAS: (f64, f64) = (0.7, 1.4);

/// Base color, and for each part of the page the least alpha that is drawn.
#[derive(Clone, Debug)]
pub struct EnginePage {
    /// Base color.
    pub image: Image,
    /// Alpha cutoffs, greater than 0.
    pub cutoffs: Vec<f32>,
}

/// What pictures of a part tell.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// Coverage relative to the leaves.
    pub coverage: f64,
    /// Factors that give it the mean color of the leaves.
    pub tone: Vec3,
}

/// Pictures of the billboards of each part, given by its place among the parts of a page.
pub trait Pictured {
    /// Draws a part with an image and a cutoff.
    ///
    /// # Errors
    /// No billboard has an area.
    fn sight(&self, part: usize, image: Image, cutoff: f32) -> Result<Sight>;

    /// Returns how much a part with an image and a cutoff differs from the leaves on all mip levels; `None` without pictures that show it.
    ///
    /// # Errors
    /// No billboard has an area.
    fn error(&self, part: usize, image: &Image, cutoff: f32) -> Result<Option<f64>>;

    /// Returns the image of a part, refined by pictures of the leaves; `None` if it does not become better, and without such pictures.
    ///
    /// # Errors
    /// No billboard has an area.
    fn refined(&self, part: usize, image: &Image, cutoff: f32) -> Result<Option<Image>>;
}

impl EnginePage {
    /// Returns how often both sides of an image can be halved.
    #[must_use]
    pub fn most_halvings(image: &Image) -> usize {
        image.width().trailing_zeros().min(image.height().trailing_zeros()) as usize
    }

    /// Returns the page with sides halved so many times, or as often as both can be halved.
    ///
    /// # Errors
    /// No billboard has an area.
    pub fn new(page: &Image, parts: &[PagePart], halvings: usize, pictured: &(impl Pictured + ?Sized)) -> Result<Self> {
        let halvings = halvings.min(Self::most_halvings(page));
        let of_part = |(number, (page, part)): (usize, (Image, &PagePart))| -> Result<(Image, f32)> {
            let polygons = part.polygons(page.width(), PLACES);
            let area = polygons.share(&page.alpha(), page.width(), code_at_least(part.alpha_cutoff));
            let small = of_part(&page, part, halvings).pop().unwrap_or(page);
            let first_seen = part.first_seen.saturating_sub(halvings);
            let keeping = Keeping { page: &small, seen: (part.alpha_cutoff, first_seen), polygons: &polygons };
            let sights = |kept: &Kept| {
                let levels: Vec<LightGrid> = LightGrid::of(&kept.image).levels(first_seen + PICTURED).collect();
                let shown = levels.iter().skip(first_seen.min(levels.len() - 1));
                shown.map(|level| pictured.sight(number, level.to_image(), kept.cutoff)).collect()
            };
            let of_cutoffs = keeping.best_of_cutoffs(area);
            let worth = chosen(of_cutoffs, |kept| pictured.error(number, &kept.image, kept.cutoff))?;
            let corrected = worth.into_iter().map(|kept| corrected(kept, &keeping, area, sights));
            first_refined(corrected, |image, cutoff| pictured.refined(number, image, cutoff))
        };
        let made = apart(page, parts).into_iter().zip(parts).enumerate().map(of_part).collect::<Result<Vec<_>>>()?;
        let (images, cutoffs) = made.into_iter().unzip();
        Ok(Self { image: together(images, parts, halvings), cutoffs })
    }
}

/// Returns the pages that are worth a refinement, that of the least error first; the first one if there are no errors. Pages that lose area come
/// last: they count where no other page can be refined. `pages`: the one that keeps the area best first.
fn chosen(pages: Vec<Kept>, error: impl Fn(&Kept) -> Result<Option<f64>>) -> Result<Vec<Kept>> {
    let mut compared = Vec::new();
    let most = pages.first().map_or(0.0, |best| best.error + CHOSEN_WORSE);
    for page in pages {
        let Some(error) = error(&page)? else { return Ok(vec![page]) };
        compared.push((page.error > most, error, page));
    }
    compared.sort_by(|(lost, error, _), (others, other, _)| lost.cmp(others).then(error.total_cmp(other)));
    Ok(compared.into_iter().take(REFINED).map(|(.., page)| page).collect())
}

/// Returns the first page that a refinement makes better, refined, or the first page; each with its cutoff. Later ones are not made.
fn first_refined(
    pages: impl Iterator<Item = Result<(Image, f32)>>,
    refined: impl Fn(&Image, f32) -> Result<Option<Image>>,
) -> Result<(Image, f32)> {
    let mut first = None;
    for page in pages {
        let (image, cutoff) = page?;
        if let Some(refined) = refined(&image, cutoff)? {
            return Ok((refined, cutoff));
        }
        first.get_or_insert((image, cutoff));
    }
    Ok(first.expect("there is a page"))
}

/// Returns the image and the cutoff with the coverage and the mean color of the leaves, as nearly as mip levels can keep them. `sights`: of
/// these levels.
fn corrected(
    mut best: Kept,
    keeping: &Keeping,
    area: f64,
    sights: impl Fn(&Kept) -> Result<Vec<Sight>>,
) -> Result<(Image, f32)> {
    let mut seen = sights(&best)?;
    let mut factor = 1.0;
    for _ in 0..CORRECTIONS {
        let coverage = seen.iter().map(|sight| sight.coverage).sum::<f64>() / seen.len() as f64;
        if (coverage - 1.0).abs() <= COVERAGE_ERROR {
            break;
        }
        factor = (factor / coverage.max(f64::MIN_POSITIVE)).clamp(AREAS.0, AREAS.1);
        let next = keeping.with_area(area * factor, &best);
        let found = sights(&next)?;
        if error(&found) >= error(&seen) || next.error > best.error + WORSE {
            break;
        }
        (best, seen) = (next, found);
    }
    let tone = seen.iter().map(|sight| sight.tone).sum::<Vec3>() / seen.len() as f32;
    Ok((tone::scaled(&best.image, tone), best.cutoff))
}

/// Returns the squared error of the coverage: a denser first level must not make up for a sparser last one.
fn error(seen: &[Sight]) -> f64 {
    seen.iter().map(|sight| (sight.coverage - 1.0).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::super::mips::means;
    use super::*;
    use crate::atlas::Region;

    /// Pictures by a function of image and cutoff, without a refinement.
    struct By<F>(F);

    impl<F: Fn(Image, f32) -> Sight> Pictured for By<F> {
        fn sight(&self, _: usize, image: Image, cutoff: f32) -> Result<Sight> {
            Ok((self.0)(image, cutoff))
        }

        fn error(&self, _: usize, _: &Image, _: f32) -> Result<Option<f64>> {
            Ok(None)
        }

        fn refined(&self, _: usize, _: &Image, _: f32) -> Result<Option<Image>> {
            Ok(None)
        }
    }

    fn as_leaves() -> By<impl Fn(Image, f32) -> Sight> {
        By(|_, _| Sight { coverage: 1.0, tone: Vec3::ONE })
    }

    /// Two needles on each of 256 small billboards; the polygons are the billboards without their rims.
    fn sparse(alpha_cutoff: f32) -> (Image, PagePart) {
        let inside = |i: usize| (1..15).contains(&(i % 256 % 16)) && (1..15).contains(&(i / 256 % 16));
        let needle = |i: usize| [5, 10].contains(&((i % 256 % 16 + i / 256 % 16 / 3 + i / 4096) % 16));
        let alpha = |i: usize| if inside(i) && needle(i) { 255 } else { 0 };
        let page = Image::new(256, 256, (0..1 << 16).map(|i| [30, 90, 20, alpha(i)]).collect::<Vec<_>>()).unwrap();
        let region = |i: usize| Region { x: i % 16 * 16 + 1, y: i / 16 * 16 + 1, width: 14, height: 14 };
        let drawn = (0..1 << 16).map(|i| f32::from(u8::from(inside(i)))).collect();
        (page, PagePart { regions: (0..256).map(region).collect(), gutter: 1, alpha_cutoff, drawn, first_seen: 0 })
    }

    /// Returns the share of the polygons of `sparse` that a mip level shows, by bilinear filtering at 2 × 2 places in each texel of the page.
    fn shown(mip: &Image, part: &PagePart, cutoff: f32) -> f64 {
        let side = mip.width();
        let at = |x: f64, y: f64| {
            let clamped = |v: f64| v.clamp(0.0, side as f64 - 1.0) as usize;
            f64::from(mip.pixels()[clamped(y) * side + clamped(x)][3]) / 255.0
        };
        let passes = |x: f64, y: f64| {
            let (x, y) = (x * side as f64 / 256.0 - 0.5, y * side as f64 / 256.0 - 0.5);
            let (low, high) = ((x.floor(), y.floor()), (x.floor() + 1.0, y.floor() + 1.0));
            let row = |y: f64| at(low.0, y) * (high.0 - x) + at(high.0, y) * (x - low.0);
            row(low.1) * (high.1 - y) + row(high.1) * (y - low.1) >= f64::from(cutoff)
        };
        let texels: Vec<usize> = (0..1 << 16).filter(|&i| part.drawn[i] > 0.0).collect();
        let places = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
        let count = |i: &usize| {
            let (x, y) = ((i % 256) as f64, (i / 256) as f64);
            places.iter().filter(|(dx, dy)| passes(x + dx, y + dy)).count()
        };
        texels.iter().map(count).sum::<usize>() as f64 / (4 * texels.len()) as f64
    }

    #[test]
    fn sparse_billboards_keep_their_area_on_smaller_pages() {
        let (page, part) = sparse(0.5);
        let own = shown(&page, &part, 0.5);
        for halvings in 0..3 {
            let EnginePage { image, cutoffs } =
                EnginePage::new(&page, std::slice::from_ref(&part), halvings, &as_leaves()).unwrap();
            assert_eq!((image.width(), image.height()), (256 >> halvings, 256 >> halvings));
            for (number, mip) in means(&image).iter().take(3).enumerate() {
                let found = shown(mip, &part, cutoffs[0]) / own;
                assert!((found - 1.0).abs() < 0.45, "halved {halvings} times, level {number}: {found}");
            }
        }
        let plain = shown(&means(&page)[3], &part, 0.5);
        assert!(plain < 0.1 * own, "box filtering loses them: {plain} of {own}");
    }

    /// Pictures whose error is the area that a mip level shows. They refine pages that show less than `refined`.
    struct Losing {
        part: PagePart,
        mip: usize,
        refined: f64,
    }

    impl Losing {
        fn shown(&self, image: &Image, cutoff: f32) -> f64 {
            shown(&means(image)[self.mip], &self.part, cutoff)
        }
    }

    impl Pictured for Losing {
        fn sight(&self, _: usize, _: Image, _: f32) -> Result<Sight> {
            Ok(Sight { coverage: 1.0, tone: Vec3::ONE })
        }

        fn error(&self, _: usize, image: &Image, cutoff: f32) -> Result<Option<f64>> {
            Ok(Some(self.shown(image, cutoff)))
        }

        fn refined(&self, _: usize, image: &Image, cutoff: f32) -> Result<Option<Image>> {
            Ok((self.shown(image, cutoff) < self.refined).then(|| image.clone()))
        }
    }

    #[test]
    fn pictures_choose_a_page_that_loses_its_area_on_mip_levels_only_if_no_other_can_be_refined() {
        let (page, part) = sparse(0.5);
        let own = shown(&page, &part, 0.5);
        let kept = |pictured: &dyn Pictured| {
            let made = EnginePage::new(&page, std::slice::from_ref(&part), 1, pictured).unwrap();
            shown(&means(&made.image)[2], &part, made.cutoffs[0]) / own
        };
        let by_pictures = |refined: f64| kept(&Losing { part: part.clone(), mip: 2, refined: refined * own });
        let by_area = kept(&as_leaves());
        let (any, losing) = (by_pictures(f64::INFINITY), by_pictures(by_area - 0.3));
        assert!(any > by_area - 0.3, "{any} and {by_area}");
        assert!(losing < by_area - 0.3, "{losing} and {by_area}");
    }

    #[test]
    fn pictures_correct_the_area_and_the_mean_color() {
        let (needles, part) = sparse(0.5);
        // Hills many texels wide: a page with more or less of them keeps its area on mip levels, too.
        let wave = |texel: usize| (texel as f64 / 10.0).sin();
        let hill = |i: usize| 127.5 + 120.0 * wave(i % 256) * wave(i / 256);
        let page = needles.clone().with_alpha((0..1 << 16).map(|i| hill(i) as u8).collect());
        let own = shown(&page, &part, 0.5);
        let mean_area = |image: &Image, cutoff: f32| {
            means(image).iter().take(PICTURED).map(|mip| shown(mip, &part, cutoff)).sum::<f64>() / PICTURED as f64
        };
        let made = |denser: f64| {
            // Pictures in which each mip level covers so many times as much as its area.
            let sight = |image: Image, cutoff: f32| Sight {
                coverage: denser * shown(&image, &part, cutoff) / own,
                tone: Vec3::new(0.5, 1.0, 2.0),
            };
            EnginePage::new(&page, std::slice::from_ref(&part), 0, &By(sight)).unwrap()
        };
        for denser in [0.9, 1.0, 1.15] {
            let EnginePage { image, cutoffs } = made(denser);
            let covered = denser * mean_area(&image, cutoffs[0]) / own;
            assert!((covered - 1.0).abs() < 0.05, "{denser}: {covered}");
            // 30, 90 and 20 with half, the same and twice the linear light.
            let close = |p: &[u8; 4]| p[0].abs_diff(20) <= 1 && p[1] == 90 && p[2].abs_diff(32) <= 1;
            assert!(image.pixels().iter().filter(|p| p[3] > 0).all(close), "{:?}", image.pixels()[0]);
        }
    }

    /// Pictures that like a page the more, the closer its cutoff is to one, and blacken a page that they refine.
    struct Liking {
        cutoff: f32,
        /// Range of cutoffs of the pages that become better.
        refined: std::ops::Range<f32>,
    }

    impl Pictured for Liking {
        fn sight(&self, _: usize, _: Image, _: f32) -> Result<Sight> {
            Ok(Sight { coverage: 1.0, tone: Vec3::ONE })
        }

        fn error(&self, _: usize, _: &Image, cutoff: f32) -> Result<Option<f64>> {
            Ok(Some(f64::from(cutoff / self.cutoff).ln().abs()))
        }

        fn refined(&self, _: usize, image: &Image, cutoff: f32) -> Result<Option<Image>> {
            Ok(self.refined.contains(&cutoff).then(|| image.mapped(|[.., alpha]| [0, 0, 0, alpha])))
        }
    }

    #[test]
    fn pictures_choose_the_cutoff() {
        let (page, part) = sparse(0.5);
        let made = |cutoff: f32, refined: std::ops::Range<f32>| {
            let EnginePage { image, cutoffs } =
                EnginePage::new(&page, std::slice::from_ref(&part), 0, &Liking { cutoff, refined }).unwrap();
            (cutoffs[0], image.pixels().iter().all(|p| p[0] == 0))
        };
        // Cutoffs are tried at 0.08, 0.14, 0.24 and 0.4, each with 15 % more or less.
        for liked in [0.08, 0.4] {
            let (cutoff, refined) = made(liked, 0.0..1.0);
            assert!((cutoff / liked - 1.0).abs() < 0.16 && refined, "{liked}: {cutoff}");
        }
        // The best one cannot be refined: the next best, which can, is better; the best, if none can.
        let (cutoff, refined) = made(0.4, 0.0..0.3);
        assert!((cutoff / 0.24 - 1.0).abs() < 0.16 && refined, "{cutoff}");
        let (cutoff, refined) = made(0.4, 0.0..0.0);
        assert!((cutoff / 0.4 - 1.0).abs() < 0.16 && !refined, "{cutoff}");
    }

    #[test]
    fn each_part_of_a_page_has_its_cutoff() {
        let (page, whole) = sparse(0.5);
        let (left, right): (Vec<Region>, Vec<Region>) = whole.regions.iter().partition(|region| region.x < 128);
        let on = |left: bool| -> Vec<f32> {
            whole
                .drawn
                .iter()
                .enumerate()
                .map(|(i, &share)| if (i % 256 < 128) == left { share } else { 0.0 })
                .collect()
        };
        let parts = [
            PagePart { regions: left, drawn: on(true), alpha_cutoff: 0.2, ..whole.clone() },
            PagePart { regions: right, drawn: on(false), alpha_cutoff: 0.9, ..whole.clone() },
        ];
        let both = EnginePage::new(&page, &parts, 1, &as_leaves()).unwrap();
        for (number, part) in parts.iter().enumerate() {
            let mut alone: Vec<[u8; 4]> = page.pixels().to_vec();
            let other = |i: &usize| (i % 256 < 128) == (number == 1);
            (0..1 << 16).filter(other).for_each(|i| alone[i][3] = 0);
            let alone = Image::new(256, 256, alone).unwrap();
            let alone = EnginePage::new(&alone, std::slice::from_ref(part), 1, &as_leaves()).unwrap();
            assert_eq!(alone.cutoffs, [both.cutoffs[number]]);
            let own = |i: &usize| (i % 128 < 64) == (number == 0);
            assert!((0..1 << 14).filter(own).all(|i| alone.image.pixels()[i] == both.image.pixels()[i]));
        }
    }
}
