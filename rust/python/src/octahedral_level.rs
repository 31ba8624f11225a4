//! `OctahedralLevel`: the last level as an octahedral impostor, in the tree's own coordinates.

use std::sync::Arc;

use leafcloud::lod::Octahedral;
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::image_array;
use crate::errors::{Failure, read};
use crate::image_errors::{Pair, PyImageErrors, from_the_side, measured, reported};
use crate::level::PyLevel;
use crate::tools::{cost_dict, sun_direction, upright, view};
use crate::work::interruptible;

#[pyclass(name = "OctahedralLevel", module = "leafcloud", frozen)]
#[derive(Clone)]
pub struct PyOctahedralLevel {
    pub impostor: Arc<Octahedral>,
    /// The level in files for readers without the shader.
    pub cross: PyLevel,
}

#[pymethods]
impl PyOctahedralLevel {
    #[classattr]
    fn cloud() -> Option<Py<PyAny>> {
        None
    }

    #[classattr]
    fn method() -> &'static str {
        "octahedral"
    }

    #[classattr]
    fn triangles() -> usize {
        2
    }

    #[classattr]
    fn page_share() -> f64 {
        1.0
    }

    #[classattr]
    fn two_sided() -> bool {
        false
    }

    #[getter]
    fn cross(&self) -> PyLevel {
        self.cross.clone()
    }

    #[getter]
    fn color<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        image_array(py, &self.impostor.color)
    }

    #[getter]
    fn normal_depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        image_array(py, &self.impostor.normal_depth)
    }

    #[getter]
    fn alpha_cutoff(&self) -> f32 {
        self.impostor.alpha_cutoff
    }

    #[getter]
    fn grid(&self) -> usize {
        self.impostor.layout.size.grid
    }

    #[getter]
    fn view_texels(&self) -> usize {
        self.impostor.layout.size.texels
    }

    #[getter]
    fn texels(&self) -> usize {
        self.impostor.color.pixels().len()
    }

    #[getter]
    fn texel_size(&self) -> f64 {
        self.impostor.layout.texel()
    }

    #[getter]
    fn to_layout<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let Octahedral { layout, frame, .. } = self.impostor.as_ref();
        let transform = layout.of_tree(&frame.placement);
        let rows = transform.matrix3.transpose();
        let row = |axis: glam::DVec3, offset: f64| [axis.x, axis.y, axis.z, offset];
        let t = transform.translation;
        let flat = [row(rows.x_axis, t.x), row(rows.y_axis, t.y), row(rows.z_axis, t.z)].as_flattened().to_vec();
        flat.into_pyarray(py).reshape([3, 4])
    }

    #[getter]
    fn extent(&self) -> (f64, f64) {
        let extent = self.impostor.layout.extent;
        (extent.x / extent.z, extent.y / extent.z)
    }

    #[getter]
    fn half(&self) -> (f64, f64, f64) {
        let layout = &self.impostor.layout;
        (layout.half / layout.extent.z).into()
    }

    #[getter]
    fn max_deviation_leaves(&self) -> f64 {
        self.impostor.layout.texel() / self.impostor.frame.radius
    }

    #[getter]
    fn coverage(&self) -> f64 {
        self.impostor.pictures.coverage()
    }

    #[getter]
    fn image_error(&self, py: Python<'_>) -> PyResult<f64> {
        reported(py, self.impostor.pictures.clone())
    }

    fn pictures<'py>(&self, py: Python<'py>) -> PyResult<Pair<'py>> {
        from_the_side(py, &self.impostor.pictures)
    }

    #[pyo3(signature = (target = None))]
    fn image_errors(&self, py: Python<'_>, target: Option<f64>) -> PyResult<PyImageErrors> {
        measured(py, self.impostor.pictures.clone(), target)
    }

    #[getter]
    fn seconds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for stage in ["fit", "pack", "look", "refine"] {
            dict.set_item(stage, 0.0)?;
        }
        dict.set_item("bake", self.impostor.seconds)?;
        Ok(dict)
    }

    #[pyo3(signature = (direction, size, *, centre, radius, up = None, samples = None, sun = None))]
    #[allow(clippy::too_many_arguments)] // the Python signature
    fn render<'py>(
        &self,
        py: Python<'py>,
        direction: &Bound<'py, PyAny>,
        size: &Bound<'py, PyAny>,
        centre: &Bound<'py, PyAny>,
        radius: &Bound<'py, PyAny>,
        up: Option<&Bound<'py, PyAny>>,
        samples: Option<&Bound<'py, PyAny>>,
        sun: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let view = view(direction, size, centre, radius, up, samples)?;
        let sun = sun.map(sun_direction).transpose()?;
        let impostor = Arc::clone(&self.impostor);
        let image = interruptible(py, move |_| impostor.draw(&view, 0.0, sun))?;
        image_array(py, &image)
    }

    #[pyo3(signature = (scale, *, up = None))]
    fn drawing_cost<'py>(
        &self,
        py: Python<'py>,
        scale: &Bound<'py, PyAny>,
        up: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let Octahedral { layout, frame, .. } = self.impostor.as_ref();
        let scale = read(scale, "scale", "a number of pixels above 0")?;
        let cost = layout.cost(frame, scale, upright(up)?).map_err(Failure::from)?;
        cost_dict(py, &cost)
    }
}
