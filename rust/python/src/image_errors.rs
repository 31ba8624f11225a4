//! `ImageErrors`: the image error of a level by the size of the crown. The pictures that it is measured in.

use leafcloud::Image;
use leafcloud::metrics::Comparison;
use leafcloud_flip::{ImageErrors, crown_pixels, image_error};
use numpy::PyArray3;
use pyo3::prelude::*;

use crate::arrays::image_array;
use crate::work::interruptible;

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

/// Measures the errors of pictures, for all sizes or up to the first error above `target`.
pub fn measured(py: Python<'_>, pictures: Comparison, target: Option<f64>) -> PyResult<PyImageErrors> {
    let target = target.unwrap_or(f64::INFINITY);
    interruptible(py, move |_| Ok(PyImageErrors(ImageErrors::up_to(&pictures, target))))
}

/// Measures the error that reports have.
pub fn reported(py: Python<'_>, pictures: Comparison) -> PyResult<f64> {
    interruptible(py, move |_| Ok(image_error(&pictures)))
}

/// Two images: of the leaves and of the level.
pub type Pair<'py> = (Bound<'py, PyArray3<u8>>, Bound<'py, PyArray3<u8>>);

/// Returns the pictures of the view nearest to the horizon, lit if there are lit ones.
pub fn from_the_side<'py>(py: Python<'py>, pictures: &Comparison) -> PyResult<Pair<'py>> {
    let pictures = pictures.lit.as_ref().unwrap_or(&pictures.flat);
    // The directions go down by equal heights from the top to half as far below the horizon.
    let level = |images: &[Image]| images[2 * images.len() / 3].clone();
    Ok((image_array(py, &level(&pictures.base))?, image_array(py, &level(&pictures.level))?))
}
