//! `Cloud`: planes and parents in the tree's own coordinates.

use std::sync::Arc;

use leafcloud::Cloud;
use leafcloud::geometry::{Frame, Plane};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

/// A cloud with its frame, for values in the tree's own coordinates.
#[derive(Clone)]
pub struct CloudInFrame {
    pub cloud: Arc<Cloud>,
    pub frame: Frame,
    /// R: ε and deviations are fractions of it.
    pub radius: f64,
    /// Area-weighted mean deviation, in the world.
    pub mean_deviation: f64,
}

#[pyclass(name = "Cloud", module = "leafcloud", frozen)]
pub struct PyCloud(pub CloudInFrame);

#[pymethods]
impl PyCloud {
    #[getter]
    fn planes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let row = |plane: &Plane| {
            let Plane { normal, distance } = plane.to_tree(&self.0.frame);
            [normal.x, normal.y, normal.z, distance]
        };
        let flat: Vec<f64> = self.0.cloud.planes.iter().flat_map(row).collect();
        flat.into_pyarray(py).reshape([self.0.cloud.planes.len(), 4])
    }

    #[getter]
    fn parents<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        self.0.cloud.parents.clone().into_pyarray(py)
    }

    #[getter]
    fn deviations<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.0.cloud.deviations.clone().into_pyarray(py)
    }

    #[getter]
    fn epsilon(&self) -> f64 {
        self.0.cloud.bound / self.0.radius
    }

    #[getter]
    fn max_deviation(&self) -> f64 {
        self.0.cloud.max_deviation() / self.0.radius
    }

    #[getter]
    fn mean_deviation(&self) -> f64 {
        self.0.mean_deviation / self.0.radius
    }
}
