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

/// Light over the visible share of the sky: a leaf on the hull sees half of the sky, and gets all of its light; the sun reaches half of such
/// leaves.
const OPEN: f32 = 1.5;

/// Where a view shows a ray.
struct Place {
    /// Column and row of the view on the grid.
    tile: (usize, usize),
    weight: f32,
    /// Place in the view's picture, in half sides from the middle.
    within: DVec2,
}

/// The pages of an impostor in linear light, for drawing.
pub(super) struct Pages<'a> {
    layout: &'a Layout,
    /// Linear colors with straight alpha.
    color: Vec<Vec4>,
    depth: Vec<f32>,
    /// Normals in the axes of the view, and in w the openness.
    shading: Vec<Vec4>,
}

impl<'a> Pages<'a> {
    pub fn new(layout: &'a Layout, color: &Image, normal_depth: &Image) -> Self {
        let table = decode_table();
        let linear = |&[r, g, b, a]: &[u8; 4]| {
            Vec3::from_array([r, g, b].map(|code| table[code as usize])).extend(f32::from(a) / 255.0)
        };
        let depth = |pixel: &[u8; 4]| f32::from(pixel[3]) / 127.5 - 1.0;
        let shading = |pixel: &[u8; 4]| {
            let [x, y] = [pixel[0], pixel[1]].map(|code| f32::from(code) / 127.5 - 1.0);
            Vec4::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt(), f32::from(pixel[2]) / 255.0)
        };
        Self {
            layout,
            color: color.pixels().par_iter().map(linear).collect(),
            depth: normal_depth.pixels().par_iter().map(depth).collect(),
            shading: normal_depth.pixels().par_iter().map(shading).collect(),
        }
    }

    /// Draws the impostor as seen in `view`, flat-lit or under a sun in this direction. With a cutoff above 0, samples of a smaller alpha show
    /// nothing and the others are opaque.
    ///
    /// # Errors
    /// A view of no pixels.
    pub fn draw(&self, view: &View, cutoff: f32, sun: Option<DVec3>) -> Result<Image> {
        match sun {
            None => self.drawn(view, cutoff, |places| self.colors(places)),
            Some(sun) => {
                let sun = (self.layout.axes.transpose() * sun).as_vec3();
                self.drawn(view, cutoff, |places| self.colors(places) * self.brightness(places, sun))
            }
        }
    }

    fn drawn(&self, view: &View, cutoff: f32, shade: impl Fn(&[Place; 3]) -> Vec4 + Sync) -> Result<Image> {
        let inverse: DMat3 = self.layout.axes.transpose();
        let eye = inverse * view.direction.normalize();
        let views = projected(eye, self.layout);
        let [right, up] = axes(eye);
        let [across, upward] = view.axes(view.direction.normalize()).map(|axis| inverse * axis * view.radius);
        let middle = inverse * (view.centre - self.layout.centre);
        let (size, side) = (view.size, view.samples.side());
        let step = |i: usize| 2.0 * (i as f64 + 0.5) / (size * side) as f64 - 1.0;
        let pixel = |index: usize| {
            let (column, row) = (index % size * side, index / size * side);
            let mut sum = Vec4::ZERO;
            for i in 0..side * side {
                let place = middle + across * step(column + i % side) - upward * step(row + i / side);
                let color = shade(&self.places(&views, right.dot(place), up.dot(place)));
                let alpha = if cutoff > 0.0 { f32::from(u8::from(color.w >= cutoff)) } else { color.w };
                sum += (color.truncate() * alpha).extend(alpha);
            }
            let straight = if sum.w > 0.0 { sum.truncate() / sum.w } else { Vec3::ZERO };
            [encode(straight.x), encode(straight.y), encode(straight.z), quantise(sum.w / (side * side) as f32)]
        };
        let pixels: Vec<[u8; 4]> = (0..size * size).into_par_iter().map(pixel).collect();
        Image::new(size, size, pixels)
    }

    /// Returns the place in each view where it shows the ray at `right` and `up` from the center.
    fn places(&self, views: &[Projected; 3], right: f64, up: f64) -> [Place; 3] {
        views.map(|view| {
            let flat = view.right * right + view.up * up;
            let mut height = 0.0;
            for _ in 0..STEPS {
                height = self.within(view.tile, flat + view.shift * f64::from(height), |i| self.depth[i]);
            }
            Place { tile: view.tile, weight: view.weight as f32, within: flat + view.shift * f64::from(height) }
        })
    }

    /// Returns linear color and alpha, blended from three places.
    fn colors(&self, places: &[Place; 3]) -> Vec4 {
        let (mut sum, mut alpha) = (Vec3::ZERO, 0.0);
        for place in places {
            let color = self.within(place.tile, place.within, |i| self.color[i]);
            let share = place.weight * color.w;
            sum += color.truncate() * share;
            alpha += share;
        }
        if alpha > 0.0 { (sum / alpha).extend(alpha) } else { Vec4::ZERO }
    }

    /// Returns the brightness under a sun, as a factor on color and 1 for alpha. `sun` is in the layout's axes.
    fn brightness(&self, places: &[Place; 3], sun: Vec3) -> Vec4 {
        let (mut normal, mut open, mut alpha) = (Vec3::ZERO, 0.0, 0.0);
        for place in places {
            let shading = self.within(place.tile, place.within, |i| self.shading[i]);
            let share = place.weight * self.within(place.tile, place.within, |i| self.color[i]).w;
            let (column, row) = place.tile;
            let toward = from_grid(DVec2::new(column as f64, row as f64), self.layout.size.grid);
            let [x, y] = axes(toward).map(DVec3::as_vec3);
            normal += (x * shading.x + y * shading.y + toward.as_vec3() * shading.z) * share;
            open += shading.w * share;
            alpha += share;
        }
        let light = if alpha > 0.0 { (OPEN * open / alpha).min(1.0) } else { 1.0 };
        Vec3::splat(brightness(normal.normalize_or_zero().dot(sun), light)).extend(1.0)
    }

    /// Returns the value at a place in a view's picture, bilinear between texels; `place` is in half sides from the middle, and outside is as
    /// the border.
    fn within<T>(&self, (column, row): (usize, usize), place: DVec2, texel: impl Fn(usize) -> T) -> T
    where
        T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let Size { grid, texels } = self.layout.size;
        let last = (texels - 1) as f64;
        let at = DVec2::new(0.5 + 0.5 * place.x, 0.5 - 0.5 * place.y) * texels as f64 - 0.5;
        let at = at.clamp(DVec2::ZERO, DVec2::splat(last));
        let low = at.floor().min(DVec2::splat(last - 1.0));
        let [fx, fy] = (at - low).as_vec2().to_array();
        let first = (row * texels + low.y as usize) * grid * texels + column * texels + low.x as usize;
        let below = first + grid * texels;
        (texel(first) * (1.0 - fx) + texel(first + 1) * fx) * (1.0 - fy)
            + (texel(below) * (1.0 - fx) + texel(below + 1) * fx) * fy
    }
}
