//! `ImageErrors`: the image error of a level by the size of the crown.

use std::sync::{Arc, OnceLock};

use leafcloud::metrics::Comparison;
use leafcloud_flip::{ImageErrors, crown_pixels, image_error};
use pyo3::prelude::*;

/// Image errors of a level, measured when they are first asked for. Clones share them.
#[derive(Clone, Default)]
pub struct Measured {
    reported: Arc<OnceLock<f64>>,
    by_size: Arc<OnceLock<ImageErrors>>,
}

impl Measured {
    pub fn reported(&self, pictures: &Comparison) -> f64 {
        *self.reported.get_or_init(|| image_error(pictures))
    }

    pub fn by_size(&self, pictures: &Comparison) -> PyImageErrors {
        PyImageErrors(self.by_size.get_or_init(|| ImageErrors::of(pictures)).clone())
    }
}

#[pyclass(name = "ImageErrors", module = "leafcloud", frozen)]
pub struct PyImageErrors(pub ImageErrors);

#[pymethods]
impl PyImageErrors {
    #[getter]
    fn sizes(&self) -> Vec<f64> {
        self.0.0.iter().map(|(side, _)| crown_pixels(*side as f64)).collect()
    }

    #[getter]
    fn errors(&self) -> Vec<f64> {
        self.0.0.iter().map(|(_, error)| *error).collect()
    }

    fn largest_size(&self, target: f64) -> Option<f64> {
        self.0.largest_size(target).map(crown_pixels)
    }
}
