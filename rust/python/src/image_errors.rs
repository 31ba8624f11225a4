//! `ImageErrors`: the image error of a level by the size of the crown.

use leafcloud_flip::{ImageErrors, crown_pixels};
use pyo3::prelude::*;

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
