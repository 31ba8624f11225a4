//! Pictures, files and the laws, as functions.

use std::path::PathBuf;
use std::sync::Arc;

use leafcloud::judge::{self, View};
use leafcloud::textures::Samples;
use leafcloud::textures::image::write_png as core_write_png;
use leafcloud::{gltf, prune, transition as laws};
use numpy::{AllowTypeChange, PyArray3, PyArrayLike1};
use pyo3::prelude::*;

use crate::arrays;
use crate::errors::{Failure, guard, refuse};
use crate::foliage::PyFoliage;

#[pyfunction]
#[pyo3(signature = (parts, direction, size, *, centre, radius, up = None, samples = 4))]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn render<'py>(
    py: Python<'py>,
    parts: Vec<Bound<'py, PyFoliage>>,
    direction: &Bound<'py, PyAny>,
    size: usize,
    centre: &Bound<'py, PyAny>,
    radius: f64,
    up: Option<&Bound<'py, PyAny>>,
    samples: usize,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let view = View {
        direction: arrays::vector(direction, "direction")?,
        up: up.map_or(Ok(glam::DVec3::Z), |v| arrays::vector(v, "up"))?,
        centre: arrays::vector(centre, "centre")?,
        radius,
        size,
        samples: Samples::new(samples).map_err(Failure::from)?,
    };
    let parts: Vec<_> = parts.iter().map(|p| Arc::clone(&p.get().0)).collect();
    let image = py.detach(|| {
        let parts: Vec<&leafcloud::Foliage> = parts.iter().map(AsRef::as_ref).collect();
        guard(|| judge::render(&parts, &view))
    })?;
    arrays::image_array(py, &image)
}

#[pyfunction]
pub fn write_png(py: Python<'_>, path: PathBuf, image: &Bound<'_, PyAny>) -> PyResult<()> {
    let image = arrays::image(image)?;
    Ok(py.detach(|| guard(|| core_write_png(&path, &image)))?)
}

#[pyfunction]
#[pyo3(signature = (path, *, names = None))]
pub fn read_gltf(py: Python<'_>, path: PathBuf, names: Option<Vec<String>>) -> PyResult<PyFoliage> {
    let names = names.unwrap_or_else(|| gltf::DEFAULT_NAMES.map(str::to_owned).to_vec());
    let foliage = py.detach(|| guard(|| gltf::read(&path, &names)))?;
    Ok(PyFoliage(Arc::new(foliage)))
}

#[pyfunction]
#[pyo3(signature = (distance, start, half = 0.5))]
pub fn keep(distance: f64, start: f64, half: f64) -> PyResult<f64> {
    let allowed = start > 0.0 && half > 0.0 && half <= 0.5;
    if !allowed {
        return Err(refuse(format!("start is {start} and half {half}; start must be above 0, half in (0, 0.5]")));
    }
    Ok(prune::keep(distance, start, half))
}

#[pyfunction]
pub fn leaf_scale(rank: f64, keep: f64) -> PyResult<f64> {
    Ok(prune::leaf_scale(rank, share(keep)?))
}

#[pyfunction]
pub fn area_scale(
    ranks: PyArrayLike1<'_, f64, AllowTypeChange>,
    areas: PyArrayLike1<'_, f64, AllowTypeChange>,
    keep: f64,
) -> PyResult<f64> {
    let (ranks, areas) = (ranks.as_array(), areas.as_array());
    if ranks.len() != areas.len() {
        return Err(refuse(format!("{} ranks and {} areas; there must be as many of each", ranks.len(), areas.len())));
    }
    Ok(prune::area_scale(ranks.iter().copied().zip(areas.iter().copied()), share(keep)?))
}

#[pyfunction]
pub fn transition(distance: f64, start: f64, end: f64) -> f64 {
    laws::transition(distance, start, end)
}

#[pyfunction]
pub fn switch_distance(deviation: f64, pixels: f64, resolution: f64, field_of_view: f64) -> PyResult<f64> {
    let positive = [pixels, resolution, field_of_view].iter().all(|x| *x > 0.0);
    if !(positive && deviation >= 0.0 && field_of_view < std::f64::consts::PI) {
        return Err(refuse(format!(
            "deviation {deviation}, pixels {pixels}, resolution {resolution}, field of view {field_of_view}; all must be above 0, \
             the field of view below π"
        )));
    }
    Ok(laws::switch_distance(deviation, pixels, resolution, field_of_view))
}

fn share(keep: f64) -> PyResult<f64> {
    if (0.0..=1.0).contains(&keep) {
        return Ok(keep);
    }
    Err(refuse(format!("keep is {keep}; it must lie in [0, 1]")))
}
