//! `simplify`: trunks and branches with fewer triangles. `unrolled_uvs`: their texture coordinates, without jumps.

use std::sync::Arc;

use glam::DVec3;
use leafcloud::groups::number_by_appearance;
use leafcloud::{Attributes, Foliage, Material};
use leafcloud_simplify::{Sight, Simplified};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

use crate::arrays;
use crate::errors::{read, refuse};
use crate::foliage::PyFoliage;
use crate::work::interruptible;

#[pyclass(name = "Simplified", module = "leafcloud", frozen)]
pub struct PySimplified(Simplified);

#[pymethods]
impl PySimplified {
    #[getter]
    fn corners<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let rows = self.0.corners.len();
        self.0.corners.as_flattened().to_vec().into_pyarray(py).reshape([rows, 3])
    }

    #[getter]
    fn change(&self) -> f64 {
        self.0.change
    }
}

#[pyfunction]
#[pyo3(signature = (positions, triangles, *, leaves = None, pixel, change, most = None, uvs = None, normals = None, colors = None, material_ids = None))]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn simplify(
    py: Python<'_>,
    positions: &Bound<'_, PyAny>,
    triangles: &Bound<'_, PyAny>,
    leaves: Option<&Bound<'_, PyFoliage>>,
    pixel: &Bound<'_, PyAny>,
    change: &Bound<'_, PyAny>,
    most: Option<&Bound<'_, PyAny>>,
    uvs: Option<&Bound<'_, PyAny>>,
    normals: Option<&Bound<'_, PyAny>>,
    colors: Option<&Bound<'_, PyAny>>,
    material_ids: Option<&Bound<'_, PyAny>>,
) -> PyResult<PySimplified> {
    let pixel = read(pixel, "pixel", "a length above 0, in the units of the positions")?;
    let change = read(change, "change", "a share between 0 and 1")?;
    let most = most.map_or(Ok(usize::MAX), |value| read(value, "most", "a whole number of triangles"))?;
    let leaves = leaves.map(|leaves| Arc::clone(&leaves.get().0));
    let positions = arrays::points(positions, "positions")?;
    let triangles = arrays::triangles(triangles)?;
    let ids = material_ids.map_or(Ok(Vec::new()), |v| arrays::identifiers(v, "material_ids"))?;
    let (material_ids, materials) = number_by_appearance(ids.into_iter());
    let attributes = Attributes {
        uvs: uvs.map_or(Ok(Vec::new()), |v| arrays::corner_values(v, "uvs", &triangles).map(arrays::to_vec2))?,
        normals: normals
            .map_or(Ok(Vec::new()), |v| arrays::corner_values(v, "normals", &triangles).map(arrays::to_vec3))?,
        colors: colors
            .map_or(Ok(Vec::new()), |v| arrays::corner_values(v, "colors", &triangles).map(arrays::to_vec4))?,
        material_ids,
        ..Attributes::default()
    };
    let simplified = interruptible(py, move |progress| {
        let trunk = Foliage::new(&positions, triangles, attributes, vec![Material::default(); materials])?;
        let sight = Sight { leaves: leaves.as_deref(), pixel, up: DVec3::Z };
        leafcloud_simplify::simplify(&trunk, sight, change, most, progress)
    })?;
    Ok(PySimplified(simplified))
}

#[pyfunction]
pub fn unrolled_uvs<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    triangles: &Bound<'py, PyAny>,
    uvs: &Bound<'py, PyAny>,
    repeats: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let positions = arrays::points(positions, "positions")?;
    let triangles = arrays::triangles(triangles)?;
    let uvs = arrays::to_vec2(arrays::corner_values(uvs, "uvs", &triangles)?);
    let repeats = arrays::truths(repeats, "repeats")?;
    let rows = triangles.len();
    if repeats.len() != rows {
        return Err(refuse(format!(
            "repeats has {} rows; it must have one for each of {rows} triangles",
            repeats.len()
        )));
    }
    let attributes = Attributes { uvs, ..Attributes::default() };
    let unrolled = interruptible(py, move |_| {
        let trunk = Foliage::new(&positions, triangles, attributes, vec![Material::default()])?;
        Ok(leafcloud_simplify::unrolled(&trunk, &repeats))
    })?;
    let flat: Vec<f32> = unrolled.as_flattened().iter().flat_map(glam::Vec2::to_array).collect();
    flat.into_pyarray(py).reshape([rows, 3, 2])
}
