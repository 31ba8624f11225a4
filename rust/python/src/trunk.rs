//! `simplify`: trunks and branches with fewer triangles.

use leafcloud::groups::number_by_appearance;
use leafcloud::{Attributes, Foliage, Material};
use leafcloud_trunk::Simplified;
use numpy::{IntoPyArray, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::arrays;
use crate::errors::read;
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
    fn error(&self) -> f64 {
        self.0.error
    }
}

#[pyfunction]
#[pyo3(signature = (positions, triangles, *, error, uvs = None, normals = None, colors = None, material_ids = None))]
#[allow(clippy::too_many_arguments)] // the Python signature
pub fn simplify(
    py: Python<'_>,
    positions: &Bound<'_, PyAny>,
    triangles: &Bound<'_, PyAny>,
    error: &Bound<'_, PyAny>,
    uvs: Option<&Bound<'_, PyAny>>,
    normals: Option<&Bound<'_, PyAny>>,
    colors: Option<&Bound<'_, PyAny>>,
    material_ids: Option<&Bound<'_, PyAny>>,
) -> PyResult<PySimplified> {
    let error = read(error, "error", "a length above 0, in the units of the positions")?;
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
        leafcloud_trunk::simplify(&trunk, error, progress)
    })?;
    Ok(PySimplified(simplified))
}
