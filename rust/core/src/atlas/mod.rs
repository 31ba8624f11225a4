//! Atlas layout: the place of each billboard's outline on the atlas page.
//!
//! Each level has one page, so that it is one draw call. The whole page has one texel density, the greatest (in steps of ¼ %) at which all
//! outlines fit with their gutters. Packing uses maximal free rectangles, quadratic in the number of billboards; more than [`MANY`]
//! billboards are packed on shelves.

mod rectangles;
mod smallest;
mod tightest;

pub use smallest::PageChoice;
pub use tightest::tightest;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::geometry::{Outline, Plane};
use crate::limits;

use rectangles::BoxSize;

/// Billboard count above which quadratic packing takes too long.
const MANY: usize = 2000;

/// Search for the density, from the highest down. It is nearly a matter of chance whether outlines fit, so many tries find a good density.
#[derive(Clone, Copy)]
struct DensitySearch {
    /// Factor from one density to the next, below 1.
    step: f64,
    /// Number of densities tried in parallel.
    together: i32,
    /// Most orders of the outlines tried at each density.
    orders: usize,
}

const TIGHT: DensitySearch = DensitySearch { step: 0.9975, together: 16, orders: 1000 };
const LOOSE: DensitySearch = DensitySearch { step: 0.99, together: 4, orders: 1 };

/// Most work at one density: pairs of billboards times orders.
const MOST_WORK: usize = 5_000_000;

/// Outlines smaller than this count as points, local units: no density makes them visible.
const SMALLEST: f64 = 1e-12;

/// Size of an atlas page in texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageSize {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl PageSize {
    /// Returns the number of texels.
    #[must_use]
    pub fn texels(self) -> usize {
        self.width * self.height
    }
}

/// A square page with the given side in texels.
impl From<usize> for PageSize {
    fn from(side: usize) -> Self {
        Self { width: side, height: side }
    }
}

impl std::fmt::Display for PageSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} × {} texels", self.width, self.height)
    }
}

/// Settings of an atlas layout.
#[derive(Clone, Copy, Debug)]
pub struct AtlasSettings {
    /// Both sides in [`limits::ATLAS_SIDE`].
    pub size: PageSize,
    /// Unused texels around each outline, against bleeding by filters.
    pub gutter: usize,
    /// Places each billboard twice, front and back.
    pub back_sides: bool,
}

impl AtlasSettings {
    /// Returns settings with the default gutter for a page of this size: 4 texels at 2048, at least 2.
    #[must_use]
    pub fn of_size(size: impl Into<PageSize>, back_sides: bool) -> Self {
        let size = size.into();
        Self { size, gutter: (size.width.min(size.height) / 512).max(2), back_sides }
    }

    /// Returns the number of outlines that fit at one texel each, with their gutters.
    #[must_use]
    pub fn room(&self) -> usize {
        self.size.texels() / (self.sides() * (1 + 2 * self.gutter).pow(2))
    }

    fn sides(self) -> usize {
        if self.back_sides { 2 } else { 1 }
    }

    fn check(self) -> Result<()> {
        let PageSize { width, height } = self.size;
        [width, height].into_iter().try_for_each(|side| limits::ATLAS_SIDE.check("texture_size", side as f64))
    }
}

/// A rectangle of texels on the atlas page; row 0 on top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Leftmost column.
    pub x: usize,
    /// Topmost row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Region {
    /// Returns the region grown by this many texels on every side; they must lie on the page.
    #[must_use]
    pub(crate) fn grown(self, by: usize) -> Self {
        let Self { x, y, width, height } = self;
        Self { x: x - by, y: y - by, width: width + 2 * by, height: height + 2 * by }
    }
}

/// The polygon that is a billboard's whole region.
const RECTANGLE: [DVec2; 4] = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];

/// A plane's rectangle, its place on the page, and the polygons that are drawn of it.
#[derive(Clone, Debug)]
pub struct Billboard {
    /// The plane of the cloud.
    pub plane: u32,
    /// Whether it shows the back, the side opposite the plane's normal.
    pub back: bool,
    /// Corners of the region, local frame: lower left, lower right, upper right, upper left; counter-clockwise seen from the shown side.
    pub corners: [DVec3; 4],
    /// The convex polygons that are drawn, within the region: (0, 0) lower left, (1, 1) upper right. Corners are counter-clockwise seen from
    /// the shown side. A new layout has the whole region.
    pub polygons: Vec<Vec<DVec2>>,
    /// Place of its texture on the page.
    pub region: Region,
}

/// Atlas layout of a level: all billboards on one page.
#[derive(Clone, Debug)]
pub struct Atlas {
    /// Size of the page.
    pub size: PageSize,
    /// Unused texels around each billboard.
    pub gutter: usize,
    /// All billboards, plane by plane, front before back.
    pub billboards: Vec<Billboard>,
}

impl Atlas {
    /// Places the outlines, one for each plane, as tightly as a search finds.
    ///
    /// # Errors
    /// A page size outside its range; more outlines than fit at one texel each.
    pub fn pack(planes: &[Plane], outlines: &[Outline], settings: AtlasSettings) -> Result<Self> {
        Self::packed(planes, outlines, settings, TIGHT)
    }

    /// Places the outlines in a tenth of the time of [`Self::pack`]: tries fewer densities, each in one order.
    ///
    /// # Errors
    /// The errors of [`Self::pack`].
    pub fn pack_loosely(planes: &[Plane], outlines: &[Outline], settings: AtlasSettings) -> Result<Self> {
        Self::packed(planes, outlines, settings, LOOSE)
    }

    fn packed(planes: &[Plane], outlines: &[Outline], settings: AtlasSettings, search: DensitySearch) -> Result<Self> {
        settings.check()?;
        if outlines.len() > settings.room() {
            return Err(too_many(outlines.len(), settings.size));
        }
        let area: f64 = outlines.iter().map(|o| o.size().x * o.size().y).sum();
        let longest = outlines.iter().map(|o| o.size().max_element()).fold(0.0, f64::max);
        let side = settings.size.width.max(settings.size.height) as f64;
        let filled = (settings.size.texels() as f64 / (area * settings.sides() as f64)).sqrt();
        let mut density = filled.min(side / longest.max(SMALLEST));
        while density * longest.max(SMALLEST) >= 1.0 {
            let lower = |steps: i32| density * libm::pow(search.step, f64::from(steps));
            let densities: Vec<f64> = (0..search.together).map(lower).collect();
            let fits =
                |&density: &f64| place(outlines, density, settings, search.orders).map(|packed| (density, packed));
            if let Some((density, packed)) = densities.par_iter().find_map_first(fits) {
                return Ok(Self::build(planes, outlines, &packed, density, settings));
            }
            density = lower(search.together);
        }
        Err(too_many(outlines.len(), settings.size))
    }

    /// Returns the layout with the whole rectangle of each billboard as its only polygon.
    #[must_use]
    pub fn with_rectangles(&self) -> Self {
        let mut whole = self.clone();
        whole.billboards.iter_mut().for_each(|billboard| billboard.polygons = vec![RECTANGLE.to_vec()]);
        whole
    }

    fn build(planes: &[Plane], outlines: &[Outline], packed: &[Placed], density: f64, settings: AtlasSettings) -> Self {
        let billboards = packed.iter().map(|p| {
            let plane = planes[p.plane as usize];
            let outline = &outlines[p.plane as usize];
            let outline = if p.turned { outline.turned() } else { *outline };
            let corners = corners(&plane, &outline, p.region, density);
            let front = Billboard {
                plane: p.plane,
                back: false,
                corners,
                polygons: vec![RECTANGLE.to_vec()],
                region: p.region,
            };
            if p.back { front.mirrored() } else { front }
        });
        Self { size: settings.size, gutter: settings.gutter, billboards: billboards.collect() }
    }

    /// Returns each billboard's place on the page.
    pub fn regions(&self) -> impl Iterator<Item = Region> {
        self.billboards.iter().map(|billboard| billboard.region)
    }

    /// Returns the number of texels in billboards.
    #[must_use]
    pub fn texels(&self) -> usize {
        self.billboards.iter().map(|b| b.region.width * b.region.height).sum()
    }

    /// Returns the share of the page that billboards and their gutters fill.
    #[must_use]
    pub fn occupancy(&self) -> f64 {
        let with_gutter = |length: usize| length + 2 * self.gutter;
        let taken = self.billboards.iter().map(|b| with_gutter(b.region.width) * with_gutter(b.region.height));
        taken.sum::<usize>() as f64 / self.size.texels() as f64
    }

    /// Returns the side of a texel, local units. It is the same for the whole page.
    #[must_use]
    pub fn texel(&self) -> f64 {
        let [a, b, ..] = self.billboards[0].corners;
        a.distance(b) / self.billboards[0].region.width as f64
    }

    /// Returns the texture coordinates of a billboard's corners, polygon after polygon: origin in the page's lower left corner, v up.
    pub fn uvs(&self, billboard: &Billboard) -> impl Iterator<Item = [f32; 2]> {
        let Region { x, y, width, height } = billboard.region;
        let (columns, rows) = (self.size.width as f64, self.size.height as f64);
        billboard.polygons.iter().flatten().map(move |p| {
            let column = x as f64 + p.x * width as f64;
            let row = (y + height) as f64 - p.y * height as f64;
            [(column / columns) as f32, (1.0 - row / rows) as f32]
        })
    }

    /// Returns the number of triangles that all billboards draw.
    #[must_use]
    pub fn triangles(&self) -> usize {
        self.billboards.iter().map(Billboard::triangles).sum()
    }
}

impl Billboard {
    /// Returns the corners of all polygons, one after another, local frame.
    pub fn drawn_corners(&self) -> impl Iterator<Item = DVec3> {
        self.polygons.iter().flatten().map(|p| self.lifted(*p))
    }

    /// Returns the number of triangles that it draws.
    #[must_use]
    pub fn triangles(&self) -> usize {
        self.polygons.iter().map(|polygon| polygon.len() - 2).sum()
    }

    /// Returns a point of the region in space, local frame.
    #[must_use]
    pub fn lifted(&self, p: DVec2) -> DVec3 {
        let [origin, right, _, up] = self.corners;
        origin + (right - origin) * p.x + (up - origin) * p.y
    }

    /// Returns a point of the billboard's plane within the region; the inverse of [`Self::lifted`].
    #[must_use]
    pub fn lowered(&self, p: DVec3) -> DVec2 {
        let [origin, right, _, up] = self.corners;
        let along = |side: DVec3| (p - origin).dot(side) / side.length_squared();
        DVec2::new(along(right - origin), along(up - origin))
    }

    /// Returns the same billboard seen from its other side.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        let [a, b, c, d] = self.corners;
        let mirrored = |polygon: &Vec<DVec2>| {
            let mut mirrored: Vec<DVec2> = polygon.iter().rev().map(|p| DVec2::new(1.0 - p.x, p.y)).collect();
            mirrored.rotate_right(2); // A rectangle begins in its lower left corner again.
            mirrored
        };
        let polygons = self.polygons.iter().map(mirrored).collect();
        Self { back: !self.back, corners: [b, a, d, c], polygons, ..self.clone() }
    }
}

fn too_many(billboards: usize, size: PageSize) -> Error {
    Error::invalid(format!(
        "{billboards} billboards do not fit on a texture of {size}; raise `texture_size` or `epsilon`"
    ))
}

/// A packed outline.
struct Placed {
    plane: u32,
    back: bool,
    turned: bool,
    region: Region,
}

/// Returns the number of whole texels that cover a length, at least 1.
fn texels(length: f64, density: f64) -> usize {
    // The small tolerance keeps 100.0000001 texels, a rounding error of 100, at 100.
    ((length * density - 1e-6).ceil() as usize).max(1)
}

fn place(outlines: &[Outline], density: f64, settings: AtlasSettings, most: usize) -> Option<Vec<Placed>> {
    let border = 2 * settings.gutter;
    let sides: &[bool] = if settings.back_sides { &[false, true] } else { &[false] };
    let planes = (0..outlines.len()).flat_map(|plane| sides.iter().map(move |&back| (plane, back)));
    let size = |o: &Outline| (texels(o.size().x, density) + border, texels(o.size().y, density) + border);
    let boxes: Vec<BoxSize> = outlines.iter().flat_map(|outline| sides.iter().map(move |_| size(outline))).collect();
    if boxes.iter().map(|(width, height)| width * height).sum::<usize>() > settings.size.texels() {
        return None;
    }
    let packed = if boxes.len() > MANY {
        on_shelves(&boxes, settings.size)?
    } else {
        rectangles::pack(&boxes, settings.size, true, orders(boxes.len(), most))?
    };
    let placed = |(((plane, back), place), size): (((usize, bool), Region), &BoxSize)| Placed {
        plane: plane as u32,
        back,
        turned: (place.width, place.height) != *size,
        region: Region {
            x: place.x + settings.gutter,
            y: place.y + settings.gutter,
            width: place.width - border,
            height: place.height - border,
        },
    };
    Some(planes.zip(packed).zip(&boxes).map(placed).collect())
}

fn orders(boxes: usize, most: usize) -> usize {
    (1 + MOST_WORK / (boxes * boxes).max(1)).min(most)
}

/// Returns the relative work of packing this many billboards tightly: pairs of billboards times orders tried at a density.
#[must_use]
pub fn tight_work(billboards: usize) -> usize {
    let boxes = billboards.min(MANY);
    orders(boxes, TIGHT.orders) * boxes * boxes
}

/// Packs boxes on shelves, the highest first; `None` if they do not fit. O(n log n), and nearly as tight for many boxes. (The crate
/// `etagere` packs on shelves too, but counts in 16 bits.)
fn on_shelves(boxes: &[BoxSize], page: PageSize) -> Option<Vec<Region>> {
    let mut order: Vec<usize> = (0..boxes.len()).collect();
    order.sort_by_key(|&index| (std::cmp::Reverse((boxes[index].1, boxes[index].0)), index));
    let (mut x, mut y, mut shelf) = (0, 0, 0);
    let mut put = |index: usize| {
        let (width, height) = boxes[index];
        if x + width > page.width {
            (x, y, shelf) = (0, y + shelf, 0);
        }
        // The first of a shelf is its highest.
        shelf = shelf.max(height);
        let place = Region { x, y, width, height };
        x += width;
        (width <= page.width && y + height <= page.height).then_some((index, place))
    };
    let mut placed: Vec<(usize, Region)> = order.into_iter().map(&mut put).collect::<Option<_>>()?;
    placed.sort_by_key(|&(index, _)| index);
    Some(placed.into_iter().map(|(_, place)| place).collect())
}

/// Returns the corners of a region of whole texels, centered on the outline, as seen from the front.
fn corners(plane: &Plane, outline: &Outline, region: Region, density: f64) -> [DVec3; 4] {
    let (x, y) = plane.axes();
    let lift = |p: DVec2| plane.normal * plane.distance + x * p.x + y * p.y;
    let middle = (outline.low + outline.high) / 2.0;
    let centre = outline.x * middle.x + outline.x.perp() * middle.y;
    let across = outline.x * (region.width as f64 / density / 2.0);
    let up = outline.x.perp() * (region.height as f64 / density / 2.0);
    [centre - across - up, centre + across - up, centre + across + up, centre - across + up].map(lift)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn rectangle(width: f64, height: f64) -> Outline {
        Outline::along(&[DVec2::ZERO, DVec2::new(width, height)], DVec2::X)
    }

    const FRONT: Plane = Plane { normal: DVec3::Z, distance: 0.0 };

    fn pack(outlines: &[Outline], back_sides: bool) -> Atlas {
        pack_on(256.into(), outlines, back_sides)
    }

    fn pack_on(size: PageSize, outlines: &[Outline], back_sides: bool) -> Atlas {
        let settings = AtlasSettings { size, gutter: 2, back_sides };
        Atlas::pack(&vec![FRONT; outlines.len()], outlines, settings).unwrap()
    }

    #[test]
    fn one_square_fills_the_page_but_for_the_gutter() {
        let atlas = pack(&[rectangle(1.0, 1.0)], false);
        let Region { width, height, .. } = atlas.billboards[0].region;
        assert!(width == height && (247..=252).contains(&width));
        let [a, b, c, d] = atlas.billboards[0].corners;
        assert!((b - a).cross(d - a).z > 0.0, "counter-clockwise from the front");
        assert!((a + c).distance(DVec3::new(1.0, 1.0, 0.0)) < 1e-12, "centered on the outline");
    }

    #[test]
    fn backs_mirror_fronts() {
        let atlas = pack(&[rectangle(2.0, 1.0)], true);
        let [front, back] = &atlas.billboards[..] else { panic!("a pair") };
        assert!(!front.back && back.back);
        let normal = |b: &Billboard| (b.corners[1] - b.corners[0]).cross(b.corners[3] - b.corners[0]).z.signum();
        assert_eq!((normal(front), normal(back)), (1.0, -1.0));
    }

    #[test]
    fn too_many_are_refused() {
        let settings = AtlasSettings { size: 16.into(), gutter: 2, back_sides: false };
        let outlines = vec![rectangle(1.0, 1.0); 100];
        let error = Atlas::pack(&vec![FRONT; 100], &outlines, settings).unwrap_err().to_string();
        assert!(error.contains("100 billboards") && error.contains("16 × 16 texels"));
        assert!(Atlas::pack(&[FRONT], &outlines[..1], AtlasSettings { size: 0.into(), ..settings }).is_err());
    }

    #[test]
    fn a_page_of_many_is_well_filled() {
        let outlines: Vec<_> = (0..100u32).map(|i| rectangle(1.0 + f64::from(i % 7), 1.0 + f64::from(i % 5))).collect();
        let settings = AtlasSettings { size: 2048.into(), gutter: 4, back_sides: false };
        let atlas = Atlas::pack(&vec![FRONT; 100], &outlines, settings).unwrap();
        assert!(atlas.occupancy() > 0.92, "{}", atlas.occupancy());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn regions_keep_apart_and_densities_agree(
            sizes in prop::collection::vec((0.0..3.0, 0.0..3.0), 1..40),
            back in any::<bool>(),
            height in 100usize..400,
        ) {
            let outlines: Vec<_> = sizes.iter().map(|&(w, h): &(f64, f64)| rectangle(w, h)).collect();
            prop_assume!(outlines.iter().any(|o| o.size().max_element() > 0.1));
            let atlas = pack_on(PageSize { width: 256, height }, &outlines, back);
            prop_assert_eq!(atlas.billboards.len(), outlines.len() * if back { 2 } else { 1 });
            let mut owners = vec![0u8; 256 * height];
            let mut density = None;
            for b in &atlas.billboards {
                let Region { x, y, width, height } = b.region;
                for row in y - 1..=y + height {
                    for column in x - 1..=x + width {
                        owners[row * 256 + column] += 1;
                    }
                }
                let length = b.corners[0].distance(b.corners[1]);
                let here = width as f64 / length;
                let first = *density.get_or_insert(here);
                prop_assert!((here / first - 1.0).abs() < 1e-9);
            }
            prop_assert!(owners.iter().all(|&o| o <= 1));
        }
    }
}
