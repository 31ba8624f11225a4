//! The pages of an octahedral impostor: every view of the grid, rendered by the rasterizer of the atlas pages.

use glam::{DMat3, DVec2, DVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::draw::OPEN;
use super::mapping::{axes, from_grid};
use super::sharpen::sharpen;
use super::{Layout, Size};
use crate::color::quantise;
use crate::error::Result;
use crate::foliage::{Foliage, Image};
use crate::geometry::Frame;
use crate::progress::Progress;
use crate::textures::{
    Canvas, Channel, Outlook, Samples, ScreenTriangle, Seen, Shader, Sky, Window, fill_transparent, rasterise_timed,
};

/// The share of the light from above that each triangle of each part gets in its middle. Suns are above, so leaves on top of a crown are lit, and its
/// sides shade themselves: each direction of the sky counts by its height above the horizon. `frame`: of the leaves. `up`: of length 1, in the
/// caller's axes.
pub(super) fn openness(parts: &[&Foliage], frame: &Frame, up: DVec3) -> Vec<Vec<f32>> {
    // The mean of m + b · l over the upper half of the sky, weighted by height, is m + ⅔ b · up.
    let above = up.as_vec3() * (2.0 / 3.0);
    let sky = Sky::over(parts, frame);
    let share = |part: &Foliage, triangle: usize| {
        let [a, b, c] = part.corners(triangle);
        let Outlook { share, toward } = sky.from(part.frame().to_caller((a + b + c) / 3.0));
        ((share + toward.dot(above)) / OPEN).clamp(0.0, 1.0)
    };
    let of_part = |part: &&Foliage| (0..part.triangle_count()).into_par_iter().map(|t| share(part, t)).collect();
    parts.iter().map(of_part).collect()
}

/// What a view shows of each texel.
enum Texel<'a> {
    Color,
    /// Bent toward the hull of the crown by this share.
    Normal(f32),
    /// The parts, and [`openness`] of their triangles.
    Openness(&'a [&'a Foliage], &'a [Vec<f32>]),
    /// Height toward the viewer, as a share of the layout's depth.
    Depth,
}

impl Shader for Texel<'_> {
    fn shade(&self, seen: &Seen) -> Vec3 {
        match self {
            Self::Color => Channel::BaseColor.shade(seen),
            Self::Normal(bend) => Channel::Normal(*bend).shade(seen),
            Self::Openness(parts, shares) => {
                let ScreenTriangle { foliage, triangle, .. } = *seen.triangle;
                let part = parts.iter().position(|part| std::ptr::eq(*part, foliage));
                Vec3::splat(part.map_or(0.5, |part| shares[part][triangle as usize]))
            }
            Self::Depth => {
                let heights = Vec3::from_array(seen.triangle.corners.map(|corner| corner.z));
                Vec3::splat(heights.dot(seen.spot.weights))
            }
        }
    }
}

/// Samples along each side of a texel. Textures of leaves are filtered over the distance between samples.
const SAMPLES: usize = 2;

/// A triangle in the layout's axes, from its center.
pub(super) struct Placed<'a> {
    foliage: &'a Foliage,
    triangle: u32,
    pub corners: [DVec3; 3],
}

/// Returns all triangles of the parts in these axes, from a center in the caller's coordinates.
pub(super) fn placed<'a>(parts: &[&'a Foliage], axes: &DMat3, centre: DVec3) -> Vec<Placed<'a>> {
    let of_part = |&foliage: &&'a Foliage| {
        let inverse = axes.transpose();
        (0..foliage.triangle_count()).map(move |triangle| Placed {
            foliage,
            triangle: triangle as u32,
            corners: foliage.corners(triangle).map(|p| inverse * (foliage.frame().to_caller(p) - centre)),
        })
    };
    parts.iter().flat_map(of_part).collect()
}

/// The pages with the views that were rendered: base color (sRGB, straight alpha), and x and y of normals in the view's axes, openness and depth, all
/// but the openness in [−1, 1] as codes. Gaps have the values of their surroundings; views that are missing are zeros.
#[derive(Clone, Debug)]
pub(super) struct Rendered {
    pages: [Vec<[u8; 4]>; 2],
    known: Vec<bool>,
}

impl Rendered {
    pub fn none(Size { grid, texels }: Size) -> Self {
        let page = || vec![[0; 4]; (grid * texels).pow(2)];
        Self { pages: [page(), page()], known: vec![false; grid * grid] }
    }

    /// Renders those of some views, by column and row, that are missing.
    pub fn add(&mut self, views: impl Iterator<Item = (usize, usize)>, of: &Source, progress: Progress) -> Result<()> {
        let Size { grid, texels } = of.layout.size;
        let mut missing = Vec::new();
        for (column, row) in views {
            if !std::mem::replace(&mut self.known[row * grid + column], true) {
                missing.push((column, row));
            }
        }
        for (number, some) in missing.chunks(grid).enumerate() {
            progress.tell("bake", (number * grid) as f64 / missing.len() as f64)?;
            let views = some.par_iter().map(|&view| of.view(view)).collect::<Result<Vec<_>>>()?;
            for (&(column, row), view) in some.iter().zip(&views) {
                for (page, pixels) in self.pages.iter_mut().zip(view) {
                    for (y, line) in pixels.chunks(texels).enumerate() {
                        page[(row * texels + y) * grid * texels + column * texels..][..texels].copy_from_slice(line);
                    }
                }
            }
        }
        Ok(())
    }

    /// Returns the pages of color, and of normals and depth.
    pub fn images(&self) -> Result<[Image; 2]> {
        let [color, normal] = &self.pages;
        let side = color.len().isqrt();
        Ok([Image::new(side, side, color.clone())?, Image::new(side, side, normal.clone())?])
    }
}

/// What views show.
pub(super) struct Source<'a> {
    pub parts: &'a [&'a Foliage],
    pub layout: &'a Layout,
    /// [`placed`] parts.
    pub triangles: &'a [Placed<'a>],
    /// [`openness`] of their triangles.
    pub openness: &'a [Vec<f32>],
    /// Share by which normals are bent toward the hull of the crown.
    pub bend: f32,
}

impl Source<'_> {
    /// Returns the texels of both pages in the view in a column and row of the grid.
    fn view(&self, (column, row): (usize, usize)) -> Result<[Vec<[u8; 4]>; 2]> {
        let Size { grid, texels } = self.layout.size;
        let view = View::new(from_grid(DVec2::new(column as f64, row as f64), grid), self.layout);
        let drawn: Vec<ScreenTriangle> = self.triangles.iter().map(|triangle| view.place(triangle)).collect();
        let shaders =
            [Texel::Color, Texel::Normal(self.bend), Texel::Openness(self.parts, self.openness), Texel::Depth];
        let samples = Samples::new(SAMPLES)?;
        let (mut canvases, _) = rasterise_timed(&drawn, texels, texels, samples, &shaders, Progress::silent())?;
        sharpen(&mut canvases[0]);
        canvases.iter_mut().for_each(fill_transparent);
        Ok(codes(&canvases))
    }
}

/// The camera of a view.
struct View {
    /// To the right, up, toward the viewer, in the layout's axes; in half sides of the picture and in the layout's depth.
    right: DVec3,
    up: DVec3,
    toward: DVec3,
    half: f64,
    window: Window,
}

impl View {
    fn new(direction: DVec3, layout: &Layout) -> Self {
        let [right, up] = axes(direction);
        let turn = DMat3::from_cols(right, up, direction).transpose();
        let texels = layout.size.texels;
        Self {
            right: right / layout.extent.x,
            up: up / layout.extent.y,
            toward: direction / layout.extent.z,
            half: texels as f64 / 2.0,
            window: Window { columns: 0..texels, rows: 0..texels, view: (turn * layout.axes.transpose()).as_mat3() },
        }
    }

    fn place<'a>(&'a self, placed: &Placed<'a>) -> ScreenTriangle<'a> {
        let Self { right, up, toward, half, .. } = self;
        let corner =
            |q: DVec3| DVec3::new(half + half * right.dot(q), half - half * up.dot(q), toward.dot(q)).as_vec3();
        ScreenTriangle {
            corners: placed.corners.map(corner),
            foliage: placed.foliage,
            triangle: placed.triangle,
            window: &self.window,
            reach: f32::INFINITY,
        }
    }
}

/// Returns the texels of both pages of a view, from its color, normal, openness and depth.
fn codes(canvases: &[Canvas]) -> [Vec<[u8; 4]>; 2] {
    let [color, normal, openness, depth] = [0, 1, 2, 3].map(|number| &canvases[number]);
    let straight = |p: &Vec4| if p.w > 0.0 { p.truncate() / p.w } else { p.truncate() };
    let all = |(n, (o, z)): (&Vec4, (&Vec4, &Vec4))| {
        // Normals face the viewer, so z follows from x and y; a bent one may not.
        let n = straight(n).try_normalize().unwrap_or(Vec3::Z);
        let n = if n.z < 0.0 { n.truncate().normalize_or_zero() } else { n.truncate() };
        [0.5 + 0.5 * n.x, 0.5 + 0.5 * n.y, straight(o).x, 0.5 + 0.5 * straight(z).x].map(quantise)
    };
    let color = Channel::BaseColor.to_image(color);
    let heights = openness.pixels.iter().zip(&depth.pixels);
    [color.pixels().to_vec(), normal.pixels.iter().zip(heights).map(all).collect()]
}
