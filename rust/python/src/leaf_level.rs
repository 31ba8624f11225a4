//! `LeafLevel`: a level of leaves, in the tree's own coordinates.

use std::sync::Arc;

use glam::DVec3;
use leafcloud::Foliage;
use leafcloud::geometry::Frame;
use leafcloud_choose::LeafLevel;
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{self, point_groups, vector_rows};
use crate::chain::{KeptArrays, kept_arrays};
use crate::errors::{read, refuse};
use crate::foliage::PyFoliage;
use crate::image_errors::{Pair, PyImageErrors, from_the_side, measured, reported};
use crate::work::interruptible;

#[pyclass(name = "LeafLevel", module = "leafcloud", frozen)]
#[derive(Clone)]
pub struct PyLeafLevel {
    pub level: Arc<LeafLevel>,
    /// Frame of the tree's own leaves.
    pub frame: Frame,
}

impl PyLeafLevel {
    /// Returns triangles in local coordinates as (n, 3, 3) in the tree's.
    fn in_tree<'py>(&self, py: Python<'py>, triangles: &[[DVec3; 3]]) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let placed = |corners: &[DVec3; 3]| self.frame.placement.wound(*corners).map(|p| self.frame.to_tree(p));
        point_groups(py, triangles.iter().map(placed))
    }
}

#[pymethods]
impl PyLeafLevel {
    #[classattr]
    fn cloud() -> Option<Py<PyAny>> {
        None
    }

    #[getter]
    fn method(&self) -> &'static str {
        if self.level.kept.is_none() { "simplified" } else { "fewer" }
    }

    #[getter]
    fn kept<'py>(&self, py: Python<'py>) -> Option<KeptArrays<'py>> {
        self.level.kept.as_ref().map(|kept| kept_arrays(py, kept))
    }

    #[getter]
    fn corners<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let placement = self.frame.placement;
        // A mirror changes the order of a triangle's corners, of the input's triangles as of the result's.
        let place = |corner: u32| corner - corner % 3 + placement.wound([0, 1, 2])[corner as usize % 3];
        let rows = self.level.leaves.corners.iter();
        let flat: Vec<u32> = rows.flat_map(|corners| placement.wound(*corners).map(place)).collect();
        let count = flat.len() / 3;
        flat.into_pyarray(py).reshape([count, 3])
    }

    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.in_tree(py, &self.level.leaves.places)
    }

    #[getter]
    fn targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        self.in_tree(py, &self.level.leaves.targets)
    }

    #[getter]
    fn pivots<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        vector_rows(py, self.level.pivots.iter().map(|&p| self.frame.to_tree(p)))
    }

    #[getter]
    fn pivot_targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        vector_rows(py, self.level.pivot_targets.iter().map(|&p| self.frame.to_tree(p)))
    }

    #[getter]
    fn triangles(&self) -> usize {
        self.level.leaves.corners.len()
    }

    #[getter]
    fn max_deviation_leaves(&self) -> f64 {
        self.level.leaves.deviation
    }

    #[getter]
    fn coverage(&self) -> f64 {
        self.level.pictures.coverage()
    }

    #[getter]
    fn image_error(&self, py: Python<'_>) -> PyResult<f64> {
        reported(py, self.level.pictures.clone())
    }

    fn pictures<'py>(&self, py: Python<'py>) -> PyResult<Pair<'py>> {
        from_the_side(py, &self.level.pictures)
    }

    #[pyo3(signature = (target = None))]
    fn image_errors(&self, py: Python<'_>, target: Option<f64>) -> PyResult<PyImageErrors> {
        measured(py, self.level.pictures.clone(), target)
    }

    #[classattr]
    fn texel_size() -> f64 {
        0.0
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
    fn seconds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        dict.set_item("fit", self.level.seconds)?;
        for stage in ["pack", "bake", "look", "refine"] {
            dict.set_item(stage, 0.0)?;
        }
        Ok(dict)
    }

    fn morphed(&self, py: Python<'_>, before: &Bound<'_, PyAny>, a: &Bound<'_, PyAny>) -> PyResult<PyFoliage> {
        let before: Bound<'_, PyFoliage> = read(before, "before", "a Foliage")?;
        let a = arrays::transition(a)?;
        let (level, before, frame) = (Arc::clone(&self.level), Arc::clone(&before.get().0), self.frame);
        let (given, wanted) = (before.triangle_count(), level.leaves.targets.len());
        if given != wanted {
            return Err(refuse(format!(
                "the leaves have {given} triangles, but {wanted} morph; give the foliage that the level is made of"
            )));
        }
        let foliage = interruptible(py, move |_| {
            let at = |(t, targets): (usize, &[DVec3; 3])| {
                let from = before.corners(t);
                // The level before may have another frame than the tree.
                let onto = targets.map(|p| before.frame().to_local(frame.to_caller(p)));
                std::array::from_fn(|i| from[i].lerp(onto[i], a))
            };
            let corners: Vec<[DVec3; 3]> = level.leaves.targets.iter().enumerate().map(at).collect();
            before.with_corners(&corners)
        })?;
        Ok(PyFoliage(Arc::new(foliage)))
    }

    fn foliage(&self) -> PyFoliage {
        let foliage: Foliage = self.level.leaves.foliage.clone();
        PyFoliage(Arc::new(foliage))
    }
}
