//! Functions for renders, files and the laws of pruning and transition.

use std::path::PathBuf;
use std::sync::Arc;

use leafcloud::limits;
use leafcloud::metrics::{self, DrawingCost, View};
use leafcloud::textures::image::write_png as core_write_png;
use leafcloud::textures::{self, Samples};
use leafcloud::{gltf, prune, transition as laws};
use numpy::{AllowTypeChange, IntoPyArray, PyArray1, PyArray3, PyArrayLike1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays;
use crate::errors::{read, refuse};
use crate::foliage::PyFoliage;
use crate::work::interruptible;

#[pyfunction]
#[pyo3(signature = (parts, direction, size, *, centre, radius, up = None, samples = None, filtered = None, sun = None))]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn render<'py>(
    py: Python<'py>,
    parts: &Bound<'py, PyAny>,
    direction: &Bound<'py, PyAny>,
    size: &Bound<'py, PyAny>,
    centre: &Bound<'py, PyAny>,
    radius: &Bound<'py, PyAny>,
    up: Option<&Bound<'py, PyAny>>,
    samples: Option<&Bound<'py, PyAny>>,
    filtered: Option<&Bound<'py, PyAny>>,
    sun: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let filtered: bool = filtered.map_or(Ok(true), |value| read(value, "filtered", "True or False"))?;
    let mut view = view(direction, size, centre, radius, up, samples)?;
    if !filtered {
        view.samples = view.samples.unfiltered();
    }
    let parts = foliages(parts)?;
    let sun = sun.map(sun_direction).transpose()?;
    let image = interruptible(py, move |progress| {
        let parts: Vec<&leafcloud::Foliage> = parts.iter().map(AsRef::as_ref).collect();
        match sun {
            None => metrics::render_watched(&parts, &view, progress),
            Some(sun) => metrics::render_lit(&parts, &view, sun, progress),
        }
    })?;
    arrays::image_array(py, &image)
}

/// Reads a view; `up` is z by default.
pub fn view(
    direction: &Bound<'_, PyAny>,
    size: &Bound<'_, PyAny>,
    centre: &Bound<'_, PyAny>,
    radius: &Bound<'_, PyAny>,
    up: Option<&Bound<'_, PyAny>>,
    samples: Option<&Bound<'_, PyAny>>,
) -> PyResult<View> {
    Ok(View {
        direction: arrays::vector(direction, "direction")?,
        up: upright(up)?,
        centre: arrays::vector(centre, "centre")?,
        radius: read(radius, "radius", "a number above 0")?,
        size: read(size, "size", "a whole number of pixels between 1 and 16384")?,
        samples: samples.map_or_else(|| Ok(Samples::default()), arrays::samples)?,
    })
}

/// Reads the direction to the sun; returns it with length 1.
pub fn sun_direction(sun: &Bound<'_, PyAny>) -> PyResult<glam::DVec3> {
    let sun = arrays::vector(sun, "sun")?;
    sun.try_normalize()
        .ok_or_else(|| refuse(format!("the sun's direction is {:?}; it needs a finite length above 0", sun.to_array())))
}

/// Reads an up direction; z by default.
pub fn upright(up: Option<&Bound<'_, PyAny>>) -> PyResult<glam::DVec3> {
    up.map_or(Ok(glam::DVec3::Z), |v| arrays::vector(v, "up"))
}

#[pyfunction]
#[pyo3(signature = (parts, scale, *, up = None))]
pub fn drawing_cost<'py>(
    py: Python<'py>,
    parts: &Bound<'py, PyAny>,
    scale: &Bound<'py, PyAny>,
    up: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let parts = foliages(parts)?;
    let scale = read(scale, "scale", "a number of pixels above 0")?;
    let up = upright(up)?;
    let cost = interruptible(py, move |progress| {
        let parts: Vec<&leafcloud::Foliage> = parts.iter().map(AsRef::as_ref).collect();
        metrics::drawing_cost(&parts, scale, up, progress)
    })?;
    cost_dict(py, &cost)
}

pub fn cost_dict<'py>(py: Python<'py>, cost: &DrawingCost) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("triangles", cost.triangles)?;
    dict.set_item("area", cost.area)?;
    dict.set_item("fragments", cost.fragments)?;
    dict.set_item("layers", cost.layers)?;
    dict.set_item("total", cost.total())?;
    Ok(dict)
}

fn foliages(parts: &Bound<'_, PyAny>) -> PyResult<Vec<Arc<leafcloud::Foliage>>> {
    let parts: Vec<Bound<'_, PyFoliage>> = read(parts, "parts", "a list of Foliage")?;
    Ok(parts.iter().map(|part| Arc::clone(&part.get().0)).collect())
}

#[pyfunction]
pub fn write_png(py: Python<'_>, path: PathBuf, image: &Bound<'_, PyAny>) -> PyResult<()> {
    let image = arrays::image(image)?;
    interruptible(py, move |_| core_write_png(&path, &image))
}

#[pyfunction]
pub fn fill_below<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    cutoff: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let image = arrays::image(image)?;
    let cutoff: f32 = read(cutoff, "cutoff", "a number between 0 and 1")?;
    if !(0.0..=1.0).contains(&cutoff) {
        return Err(refuse(format!("cutoff is {cutoff}; it must be between 0 and 1")));
    }
    let filled = interruptible(py, move |_| textures::fill_below(&image, 255.0 * cutoff))?;
    arrays::image_array(py, &filled)
}

#[pyfunction]
#[pyo3(signature = (path, *, names = None))]
pub fn read_gltf(py: Python<'_>, path: PathBuf, names: Option<Vec<String>>) -> PyResult<PyFoliage> {
    let names = names.unwrap_or_else(|| gltf::DEFAULT_NAMES.map(str::to_owned).to_vec());
    let foliage = interruptible(py, move |_| gltf::read(&path, &names))?;
    Ok(PyFoliage(Arc::new(foliage)))
}

#[pyfunction]
pub fn leaf_ids<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    triangles: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<u32>>> {
    let (positions, triangles) = (arrays::points(positions, "positions")?, arrays::triangles(triangles)?);
    let ids = interruptible(py, move |_| leafcloud::foliage::leaf_ids(&positions, &triangles))?;
    Ok(ids.into_pyarray(py))
}

#[pyfunction]
#[pyo3(signature = (distance, start, half = 0.5))]
pub fn keep(distance: f64, start: f64, half: f64) -> PyResult<f64> {
    if !(start > 0.0 && limits::PRUNE_HALF.hold(half)) {
        let limits = limits::PRUNE_HALF;
        return Err(refuse(format!("start is {start:?} and half {half:?}; start must be above 0, half {limits}")));
    }
    Ok(prune::keep(distance, start, half))
}

#[pyfunction]
pub fn leaf_scale(rank: f64, keep: f64) -> PyResult<f64> {
    check_rank(rank)?;
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
    ranks.iter().try_for_each(|&rank| check_rank(rank))?;
    if let Some(area) = areas.iter().find(|area| !(0.0..f64::INFINITY).contains(*area)) {
        return Err(refuse(format!("an area is {area:?}; areas must be finite and at least 0")));
    }
    Ok(prune::area_scale(ranks.iter().copied().zip(areas.iter().copied()), share(keep)?))
}

#[pyfunction]
pub fn transition(distance: f64, start: f64, end: f64) -> f64 {
    laws::transition(distance, start, end)
}

#[pyfunction]
pub fn switch_distance(deviation: f64, pixels: f64, resolution: f64, field_of_view: f64) -> PyResult<f64> {
    let above = |x: f64| x > 0.0 && x.is_finite();
    let positive = [pixels, resolution, field_of_view].into_iter().all(above);
    if !(positive && (deviation == 0.0 || above(deviation)) && field_of_view < std::f64::consts::PI) {
        return Err(refuse(format!(
            "deviation {deviation:?}, pixels {pixels:?}, resolution {resolution:?}, field of view {field_of_view:?}; the deviation must \
             be at least 0, the others above 0, all finite, the field of view below π"
        )));
    }
    if deviation == 0.0 {
        return Ok(0.0);
    }
    let distance = laws::switch_distance(deviation, pixels, resolution, field_of_view);
    if distance.is_finite() {
        return Ok(distance);
    }
    Err(refuse(format!(
        "a deviation of {deviation:?} over {pixels:?} pixels of {resolution:?} in {field_of_view:?} radians has no finite switch distance; \
         use a lower resolution or a wider field of view"
    )))
}

/// Rank of leaves that are never pruned.
const PROTECTED: f64 = -1.0;

fn check_rank(rank: f64) -> PyResult<()> {
    if (0.0..1.0).contains(&rank) || rank == PROTECTED {
        return Ok(());
    }
    Err(refuse(format!("a rank is {rank:?}; ranks must lie in [0, 1), or be -1 for leaves that stay")))
}

fn share(keep: f64) -> PyResult<f64> {
    if (0.0..=1.0).contains(&keep) {
        return Ok(keep);
    }
    Err(refuse(format!("keep is {keep:?}; it must lie in [0, 1]")))
}
