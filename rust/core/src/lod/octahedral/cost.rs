//! What an octahedral impostor costs to draw, by the model of [`crate::metrics::drawing_cost`].
//!
//! A fragment blends three views. For each it reads two depths, a color and a normal: twelve reads, where a fragment of a cloud reads three or
//! four (color, normal, roughness, translucency). So it counts as [`READS`] fragments.

use glam::{DVec2, DVec3};

use super::Layout;
use super::mapping::axes;
use crate::error::Result;
use crate::geometry::Frame;
use crate::metrics::{DrawingCost, check_scale, counted_views};

/// Fragments of a cloud that cost as much as one of an octahedral impostor.
const READS: f64 = 3.0;

impl Layout {
    /// Returns half of the width and of the height of the quad that holds the tree as seen from `eye`, of length 1 and in the layout's axes;
    /// in the caller's units. `shaders/octahedral.glsl` draws the same quad.
    #[must_use]
    pub fn quad(&self, eye: DVec3) -> DVec2 {
        let [_, up] = axes(eye);
        let height = up.truncate().length() * self.extent.x + up.z.abs() * self.half.z;
        DVec2::new(self.extent.x, height.min(self.extent.y))
    }

    /// Returns the cost of drawing an impostor with this layout where a length of 1, in the caller's units, covers `scale` pixels. `frame`: of the
    /// leaves. `up`: as in the settings of the chain.
    ///
    /// # Errors
    /// A `scale` that is not above 0 and finite; an `up` without a finite length above 0.
    pub fn cost(&self, frame: &Frame, scale: f64, up: DVec3) -> Result<DrawingCost> {
        check_scale(scale, up)?;
        let inverse = self.axes.transpose();
        let area = |direction: DVec3| 4.0 * self.quad(inverse * direction.normalize()).element_product();
        let areas: Vec<f64> = counted_views(up).around(frame).map(|view| area(view.direction)).collect();
        let mean = areas.iter().sum::<f64>() / areas.len() as f64;
        Ok(DrawingCost { triangles: 2, area: mean, fragments: READS * mean * scale * scale, layers: READS })
    }
}
