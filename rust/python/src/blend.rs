//! `BlendOrder`: the drawing order of alpha-blended triangles.

use std::ops::Range;

use glam::DVec3;
use leafcloud::Error;
use leafcloud::blend_order::{BlendOrder, Node};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::arrays;
use crate::errors::read;
use crate::work::interruptible;

#[pyclass(name = "BlendOrder", module = "leafcloud", frozen)]
pub struct PyBlendOrder(BlendOrder);

#[pymethods]
impl PyBlendOrder {
    #[getter]
    fn sources<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        self.0.corners.iter().map(|corner| corner.source).collect::<Vec<_>>().into_pyarray(py)
    }

    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::vector_rows(py, self.0.corners.iter().map(|corner| DVec3::from_array(corner.weights)))
    }

    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        rows(py, self.0.triangles.as_flattened().to_vec(), 3)
    }

    #[getter]
    fn planes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let plane = |node: &Node| node.normal.extend(node.offset).to_array();
        rows(py, self.0.nodes.iter().flat_map(plane).collect(), 4)
    }

    #[getter]
    fn children<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let numbers = |node: &Node| node.children.map(|child| child.map_or(-1, i64::from));
        rows(py, self.0.nodes.iter().flat_map(numbers).collect(), 2)
    }

    #[getter]
    fn ranges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let ends = |Range { start, end }: &Range<u32>| [*start, *end];
        rows(py, self.0.nodes.iter().flat_map(|node| ends(&node.triangles)).collect(), 2)
    }
}

fn rows<T: numpy::Element>(py: Python<'_>, flat: Vec<T>, columns: usize) -> PyResult<Bound<'_, PyArray2<T>>> {
    let count = flat.len() / columns;
    flat.into_pyarray(py).reshape([count, columns])
}

#[pyfunction]
#[pyo3(signature = (positions, triangles, *, toward = None, most = None))]
pub fn blend_order(
    py: Python<'_>,
    positions: &Bound<'_, PyAny>,
    triangles: &Bound<'_, PyAny>,
    toward: Option<&Bound<'_, PyAny>>,
    most: Option<&Bound<'_, PyAny>>,
) -> PyResult<PyBlendOrder> {
    let positions = arrays::points(positions, "positions")?;
    let triangles = arrays::triangles(triangles)?;
    let toward = toward.map_or(Ok(DVec3::Z), |v| arrays::vector(v, "toward"))?;
    let most = most.map(|v| read(v, "most", "a whole number of pieces, or None")).transpose()?;
    let order =
        interruptible(py, move |progress| BlendOrder::new(&corners(&positions, &triangles)?, toward, most, progress))?;
    Ok(PyBlendOrder(order))
}

fn corners(positions: &[DVec3], triangles: &[[u32; 3]]) -> leafcloud::Result<Vec<[DVec3; 3]>> {
    let at = |&index: &u32| {
        positions.get(index as usize).copied().ok_or_else(|| {
            Error::invalid(format!("a triangle uses vertex {index}, but there are {} positions", positions.len()))
        })
    };
    triangles.iter().map(|[a, b, c]| Ok([at(a)?, at(b)?, at(c)?])).collect()
}
