//! `Yardstick`: whether a level looks like its leaves, by what an equally good tree passes.

use std::sync::Arc;

use leafcloud::Foliage;
use leafcloud_choose::{Judgement, Yardstick};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{read, refuse};
use crate::foliage::PyFoliage;
use crate::octahedral_level::PyOctahedralLevel;
use crate::tools::upright;
use crate::work::interruptible;

#[pyclass(name = "Yardstick", module = "leafcloud", frozen)]
pub struct PyYardstick(Arc<Yardstick>);

#[pymethods]
impl PyYardstick {
    #[new]
    #[pyo3(signature = (leaves, *, still = None, up = None, views = 4, lit = true))]
    fn new(
        py: Python<'_>,
        leaves: &Bound<'_, PyAny>,
        still: Option<&Bound<'_, PyAny>>,
        up: Option<&Bound<'_, PyAny>>,
        views: usize,
        lit: bool,
    ) -> PyResult<Self> {
        let foliage = |value: &Bound<'_, PyAny>, name| -> PyResult<Arc<Foliage>> {
            let value: Bound<'_, PyFoliage> = read(value, name, "a Foliage")?;
            Ok(Arc::clone(&value.get().0))
        };
        let (leaves, still) = (foliage(leaves, "leaves")?, still.map(|still| foliage(still, "still")).transpose()?);
        let views = Yardstick::views(views, upright(up)?).map_err(crate::errors::Failure::from)?;
        let made = interruptible(py, move |_| Yardstick::new(&leaves, still.as_deref(), views, lit))?;
        Ok(Self(Arc::new(made)))
    }

    #[pyo3(signature = (level, *, q = 1.0))]
    fn judge<'py>(&self, py: Python<'py>, level: &Bound<'py, PyAny>, q: f64) -> PyResult<Bound<'py, PyDict>> {
        let yardstick = Arc::clone(&self.0);
        let (largest, judged) = if let Ok(impostor) = level.cast::<PyOctahedralLevel>() {
            let impostor = Arc::clone(&impostor.get().impostor);
            interruptible(py, move |_| Ok(judged(&yardstick, &impostor.compare(yardstick.reference())?, q)))?
        } else if let Ok(foliage) = level.cast::<PyFoliage>() {
            let foliage = Arc::clone(&foliage.get().0);
            interruptible(py, move |_| Ok(judged(&yardstick, &yardstick.pictures(&foliage)?, q)))?
        } else {
            return Err(refuse("level must be a Foliage or an OctahedralLevel"));
        };
        let dict = PyDict::new(py);
        dict.set_item("largest", largest)?;
        let rows = judged.iter().map(|each| judgement_dict(py, each, q)).collect::<PyResult<Vec<_>>>()?;
        dict.set_item("sizes", rows)?;
        Ok(dict)
    }
}

fn judged(yardstick: &Yardstick, pictures: &leafcloud::metrics::Comparison, q: f64) -> (Option<f64>, Vec<Judgement>) {
    let all = yardstick.sides().filter_map(|side| yardstick.judge(pictures, side, q)).collect();
    (yardstick.largest(pictures, q).map(|(size, _)| size), all)
}

/// Returns the figures of a judgement.
pub fn judgement_dict<'py>(py: Python<'py>, judged: &Judgement, q: f64) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let (excess, by) = judged.excess(q);
    dict.set_item("crown_pixels", judged.crown)?;
    dict.set_item("difference", judged.flip)?;
    dict.set_item("contrast", judged.looks.contrast.to_vec())?;
    dict.set_item("coverage", judged.looks.coverage)?;
    dict.set_item("places", judged.cells)?;
    dict.set_item("color", judged.looks.color)?;
    dict.set_item("excess", excess)?;
    dict.set_item("by", by)?;
    Ok(dict)
}
