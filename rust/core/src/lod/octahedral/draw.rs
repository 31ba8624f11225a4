//! The law by which an octahedral impostor is drawn, in software, for judging it. `shaders/octahedral.glsl` and the add-on's nodes have the
//! same law. Orthographic: all rays go along e, the direction from the center to the eye.
//!
//! A view k of the three around e looks from d, with the axes r and u of its picture. A ray passes the picture's plane in q; at the height h
//! toward the viewer, the ray is at s(h) = q + h·t, with t = e / (d·e), in the axes r and u. The leaves are first taken to be at h = 0; the depth
//! stored there is the next h, [`STEPS`] times. Alpha is Σ w·α and the color Σ w·α·c / Σ w·α over the three views.
//!
//! Eyes deeper than 45° below the horizon see the picture from 45°.

use glam::{DMat3, DVec2, DVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::mapping::{around, axes, from_grid};
use super::{Layout, Size};
use crate::color::{decode_table, encode, quantise};
use crate::error::Result;
use crate::foliage::Image;
use crate::metrics::{View, brightness};

/// Corrections of the height by the stored depth.
pub const STEPS: usize = 2;

/// The part of the law that is the same for all rays of a picture: one of the three views.
#[derive(Clone, Copy, Debug)]
pub struct Projected {
    /// Column and row of the view on the grid.
    pub tile: (usize, usize),
    /// Weight of the view.
    pub weight: f64,
    /// Place in the view's picture, in half sides of it, for a step of 1 to the right in the drawn picture.
    pub right: DVec2,
    /// The same for a step of 1 up.
    pub up: DVec2,
    /// The same for a stored depth of 1.
    pub shift: DVec2,
}

/// Returns the three views for an eye in the direction `eye`, of length 1, in the layout's axes.
#[must_use]
pub fn projected(eye: DVec3, layout: &Layout) -> [Projected; 3] {
    let (extent, grid) = (layout.extent, layout.size.grid);
    let ray = eye.with_z(eye.z.max(-eye.truncate().length())).try_normalize().unwrap_or(DVec3::Z);
    let [right, up] = axes(ray);
    around(eye, grid).map(|view| {
        let toward = from_grid(DVec2::new(view.column as f64, view.row as f64), grid);
        let [x, y] = axes(toward);
        let along = ray / toward.dot(ray);
        let place = |q: DVec3| DVec2::new(x.dot(q) / extent.x, y.dot(q) / extent.y);
        let step = |axis: DVec3| place(axis - along * toward.dot(axis));
        Projected {
            tile: (view.column, view.row),
            weight: view.weight,
            right: step(right),
            up: step(up),
            shift: place(along) * extent.z,
        }
    })
}

/// Light over the stored openness.
pub(super) const OPEN: f32 = 1.5;

/// Where a view shows a ray: between four texels of its picture.
#[derive(Clone, Copy)]
struct Tap {
    /// The texel above on the left, as an index into the page.
    first: u32,
    /// Shares of the right column and of the lower row.
    shares: [f32; 2],
}

/// The rays through all samples of a picture, and the places where the three nearest views show them. They follow from the stored depth
/// alone, so rays that are traced once serve every color, alpha and light.
pub(super) struct Rays<'a> {
    layout: &'a Layout,
    /// Pixels along each side, and samples along each side of a pixel.
    size: usize,
    side: usize,
    views: [Projected; 3],
    /// Taps in each view, samples of a pixel together.
    taps: Vec<[Tap; 3]>,
}

impl<'a> Rays<'a> {
    /// Traces the rays of `view`. `depth`: the stored depth of each texel.
    pub fn traced(layout: &'a Layout, depth: &[f32], view: &View) -> Self {
        let inverse: DMat3 = layout.axes.transpose();
        let eye = inverse * view.direction.normalize();
        let views = projected(eye, layout);
        let [right, up] = axes(eye);
        let [across, upward] = view.axes(view.direction.normalize()).map(|axis| inverse * axis * view.radius);
        let middle = inverse * (view.centre - layout.centre);
        let (size, side) = (view.size, view.samples.side());
        let step = |i: usize| 2.0 * (i as f64 + 0.5) / (size * side) as f64 - 1.0;
        let taps = |index: usize| {
            let (pixel, sample) = (index / (side * side), index % (side * side));
            let (column, row) = (pixel % size * side + sample % side, pixel / size * side + sample / side);
            let place = middle + across * step(column) - upward * step(row);
            views.map(|view| tap(layout, depth, &view, right.dot(place), up.dot(place)))
        };
        let taps = (0..size * size * side * side).into_par_iter().map(taps).collect();
        Self { layout, size, side, views, taps }
    }

    /// Returns the alpha of each sample, from that of each texel.
    pub fn alphas(&self, alpha: &[f32]) -> Vec<f32> {
        let of = |taps: &[Tap; 3]| {
            let pairs = self.views.iter().zip(taps);
            pairs.map(|(view, tap)| view.weight as f32 * tap.between(self.layout, |i| alpha[i])).sum()
        };
        self.taps.par_iter().map(of).collect()
    }

    /// Returns a picture of no color with the mean alpha of each pixel's samples.
    ///
    /// # Errors
    /// A view of no pixels.
    pub fn silhouette(&self, alphas: impl Iterator<Item = f32>) -> Result<Image> {
        let mut alphas = alphas;
        let count = self.side * self.side;
        let pixel = |_| [0, 0, 0, quantise(alphas.by_ref().take(count).sum::<f32>() / count as f32)];
        Image::new(self.size, self.size, (0..self.size * self.size).map(pixel).collect::<Vec<_>>())
    }

    /// Returns a picture in N lights. `shade` returns linear color and alpha of a sample in each of them.
    fn pictures<const N: usize>(&self, shade: impl Fn(&[Tap; 3]) -> [Vec4; N] + Sync) -> Result<[Image; N]> {
        let count = self.side * self.side;
        let pixel = |samples: &[[Tap; 3]]| {
            let mut sums = [Vec4::ZERO; N];
            for taps in samples {
                for (sum, color) in sums.iter_mut().zip(shade(taps)) {
                    *sum += (color.truncate() * color.w).extend(color.w);
                }
            }
            sums.map(|sum| {
                let straight = if sum.w > 0.0 { sum.truncate() / sum.w } else { Vec3::ZERO };
                [encode(straight.x), encode(straight.y), encode(straight.z), quantise(sum.w / count as f32)]
            })
        };
        let pixels: Vec<[[u8; 4]; N]> = self.taps.par_chunks(count).map(pixel).collect();
        let picture = |i: usize| {
            let pixels = pixels.iter().map(|pixel| pixel[i]).collect::<Vec<_>>();
            Image::new(self.size, self.size, pixels)
        };
        let pictures: Vec<Image> = (0..N).map(picture).collect::<Result<_>>()?;
        Ok(pictures.try_into().expect("N pictures"))
    }
}

/// Returns the place in a view where it shows the ray at `right` and `up` from the center.
fn tap(layout: &Layout, depth: &[f32], view: &Projected, right: f64, up: f64) -> Tap {
    let flat = view.right * right + view.up * up;
    let at = |height: f32| Tap::at(layout, view.tile, flat + view.shift * f64::from(height));
    let mut height = 0.0;
    for _ in 0..STEPS {
        height = at(height).between(layout, |i| depth[i]);
    }
    at(height)
}

impl Tap {
    /// Returns the tap at a place in a view's picture, in half sides from the middle. Outside is as the border.
    fn at(layout: &Layout, (column, row): (usize, usize), place: DVec2) -> Self {
        let Size { grid, texels } = layout.size;
        let last = (texels - 1) as f64;
        let at = DVec2::new(0.5 + 0.5 * place.x, 0.5 - 0.5 * place.y) * texels as f64 - 0.5;
        let at = at.clamp(DVec2::ZERO, DVec2::splat(last));
        // The numbers are not negative, so a cast rounds down.
        let [x, y] = [at.x, at.y].map(|x| (x as usize).min(texels - 2));
        let first = (row * texels + y) * grid * texels + column * texels + x;
        Self { first: first as u32, shares: [(at.x - x as f64) as f32, (at.y - y as f64) as f32] }
    }

    /// Returns the bilinear mean of the four texels.
    fn between<T>(&self, layout: &Layout, texel: impl Fn(usize) -> T) -> T
    where
        T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let [fx, fy] = self.shares;
        let first = self.first as usize;
        let below = first + layout.size.grid * layout.size.texels;
        (texel(first) * (1.0 - fx) + texel(first + 1) * fx) * (1.0 - fy)
            + (texel(below) * (1.0 - fx) + texel(below + 1) * fx) * fy
    }
}

/// Returns the stored depth of each texel.
pub(super) fn depths(normal_depth: &Image) -> Vec<f32> {
    normal_depth.pixels().par_iter().map(|pixel| f32::from(pixel[3]) / 127.5 - 1.0).collect()
}

/// The pages of an impostor in linear light, for drawing.
pub(super) struct Pages<'a> {
    layout: &'a Layout,
    /// Linear colors with straight alpha.
    color: Vec<Vec4>,
    /// Normals in the axes of the view, and in w the openness.
    shading: Vec<Vec4>,
}

impl<'a> Pages<'a> {
    pub fn new(layout: &'a Layout, color: &Image, normal_depth: &Image) -> Self {
        let table = decode_table();
        let linear = |&[r, g, b, a]: &[u8; 4]| {
            Vec3::from_array([r, g, b].map(|code| table[code as usize])).extend(f32::from(a) / 255.0)
        };
        let shading = |pixel: &[u8; 4]| {
            let [x, y] = [pixel[0], pixel[1]].map(|code| f32::from(code) / 127.5 - 1.0);
            Vec4::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt(), f32::from(pixel[2]) / 255.0)
        };
        Self {
            layout,
            color: color.pixels().par_iter().map(linear).collect(),
            shading: normal_depth.pixels().par_iter().map(shading).collect(),
        }
    }

    /// Draws the impostor flat-lit. With a cutoff above 0, samples of a smaller alpha show nothing and the others are opaque.
    ///
    /// # Errors
    /// A view of no pixels.
    pub fn flat(&self, rays: &Rays, cutoff: f32) -> Result<Image> {
        let [flat] = rays.pictures(|taps| [cut_out(self.color(&rays.views, taps), cutoff)])?;
        Ok(flat)
    }

    /// Draws the impostor flat-lit and under a sun in this direction, with a cutoff as in [`Self::flat`].
    ///
    /// # Errors
    /// A view of no pixels.
    pub fn flat_and_lit(&self, rays: &Rays, cutoff: f32, sun: DVec3) -> Result<[Image; 2]> {
        let sun = (self.layout.axes.transpose() * sun).as_vec3();
        let axes = rays.views.map(|view| {
            let toward = from_grid(DVec2::new(view.tile.0 as f64, view.tile.1 as f64), self.layout.size.grid);
            let [x, y] = axes(toward);
            [x, y, toward].map(DVec3::as_vec3)
        });
        rays.pictures(|taps| {
            let color = cut_out(self.color(&rays.views, taps), cutoff);
            // Nobody sees the light of transparent samples.
            let light = if color.w > 0.0 { self.brightness(&rays.views, &axes, taps, sun) } else { 1.0 };
            [color, (color.truncate() * light).extend(color.w)]
        })
    }

    /// Returns linear color and alpha, blended from three places.
    fn color(&self, views: &[Projected; 3], taps: &[Tap; 3]) -> Vec4 {
        let (mut sum, mut alpha) = (Vec3::ZERO, 0.0);
        for (view, tap) in views.iter().zip(taps) {
            let color = tap.between(self.layout, |i| self.color[i]);
            let share = view.weight as f32 * color.w;
            sum += color.truncate() * share;
            alpha += share;
        }
        if alpha > 0.0 { (sum / alpha).extend(alpha) } else { Vec4::ZERO }
    }

    /// Returns the brightness under a sun. `sun` is in the layout's axes; `axes`: right, up and toward the eye of each view.
    fn brightness(&self, views: &[Projected; 3], axes: &[[Vec3; 3]; 3], taps: &[Tap; 3], sun: Vec3) -> f32 {
        let (mut normal, mut open, mut alpha) = (Vec3::ZERO, 0.0, 0.0);
        for ((view, [x, y, toward]), tap) in views.iter().zip(axes).zip(taps) {
            let shading = tap.between(self.layout, |i| self.shading[i]);
            let share = view.weight as f32 * tap.between(self.layout, |i| self.color[i].w);
            normal += (*x * shading.x + *y * shading.y + *toward * shading.z) * share;
            open += shading.w * share;
            alpha += share;
        }
        let light = if alpha > 0.0 { (OPEN * open / alpha).min(1.0) } else { 1.0 };
        brightness(normal.normalize_or_zero().dot(sun), light)
    }
}

/// Returns a sample cut out at `cutoff`; as it is if that is 0.
fn cut_out(color: Vec4, cutoff: f32) -> Vec4 {
    if cutoff > 0.0 { color.truncate().extend(opaque_from(color.w, cutoff)) } else { color }
}

/// Returns 1 for an alpha of at least `cutoff`, else 0.
pub(super) fn opaque_from(alpha: f32, cutoff: f32) -> f32 {
    f32::from(u8::from(alpha >= cutoff))
}
