//! The judge: what a level looks like beside the leaves.

mod measure;
mod render;

pub use measure::{Judgement, compare};
pub use render::{View, render};

use glam::DVec3;
use rayon::prelude::*;

use crate::error::Result;
use crate::foliage::{Foliage, Image};
use crate::geometry::Frame;
use crate::textures::Samples;

/// From where, how large and how finely the judge looks.
#[derive(Clone, Copy, Debug)]
pub struct Views {
    /// How many directions.
    pub count: usize,
    /// Side of each picture in pixels.
    pub size: usize,
    /// Sub-samples along each side of a pixel.
    pub samples: Samples,
    /// Turns the whole set, in golden angles: sets of different turns share no direction.
    pub turn: f64,
}

impl Views {
    /// Directions from the centre to the eye: a spiral over the upper three quarters of the sphere, since trees are rarely seen from
    /// straight below.
    fn directions(&self) -> impl Iterator<Item = DVec3> + '_ {
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        (0..self.count).map(move |i| {
            let z = 1.0 - 1.5 * (i as f64 + 0.5) / self.count as f64;
            let (radius, angle) = ((1.0 - z * z).sqrt(), (i as f64 + self.turn) * golden);
            DVec3::new(radius * libm::cos(angle), radius * libm::sin(angle), z)
        })
    }
}

/// Pictures of one thing from all views, to compare others with.
pub struct Judge {
    views: Vec<View>,
    pictures: Vec<Image>,
}

impl Judge {
    /// Looks at the parts of the base; the sphere of `frame` fills the pictures.
    ///
    /// # Errors
    /// A picture without pixels.
    pub fn new(base: &[&Foliage], frame: &Frame, views: Views) -> Result<Self> {
        let view = |direction| View {
            direction,
            up: DVec3::Z,
            centre: frame.centre,
            radius: frame.radius * 1.025,
            size: views.size,
            samples: views.samples,
        };
        let views: Vec<View> = views.directions().map(view).collect();
        let pictures = views.iter().map(|v| render(base, v)).collect::<Result<_>>()?;
        Ok(Self { views, pictures })
    }

    /// The mean over the views of the coverage of `level` over that of the base.
    ///
    /// # Errors
    /// A picture without pixels.
    pub fn coverage(&self, level: &Foliage) -> Result<f64> {
        let one = |(view, base)| Ok(measure::coverage(base, &render(&[level], view)?));
        let ratios: Vec<f64> = self.views.iter().zip(&self.pictures).map(one).collect::<Result<_>>()?;
        Ok(ratios.iter().sum::<f64>() / ratios.len() as f64)
    }

    /// The means over the views of what `level` looks like.
    ///
    /// # Errors
    /// A picture without pixels.
    pub fn judge(&self, level: &Foliage) -> Result<Judgement> {
        let rows = self.views.iter().map(|v| render(&[level], v)).collect::<Result<Vec<_>>>()?;
        let judged: Vec<Judgement> =
            self.pictures.par_iter().zip(&rows).map(|(base, other)| compare(base, other)).collect();
        Ok(Judgement::mean(&judged))
    }
}
