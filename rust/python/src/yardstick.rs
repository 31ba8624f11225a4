//! `Yardstick`: whether a level looks like its leaves, by what an equally good tree passes.

use std::borrow::Cow;
use std::sync::Arc;

use leafcloud::Foliage;
use leafcloud_choose::yardstick::LARGEST;
use leafcloud_choose::{Judgement, Passed, Subject, Wishes, Yardstick};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{read, refuse};
use crate::foliage::PyFoliage;
use crate::octahedral_level::PyOctahedralLevel;
use crate::tools::upright;
use crate::work::interruptible;

#[pyclass(name = "Yardstick", module = "leafcloud", frozen)]
pub struct PyYardstick(Arc<Yardstick<'static>>);

#[pymethods]
impl PyYardstick {
    #[new]
    #[pyo3(signature = (leaves, *, still = None, up = None, lit = true))]
    fn new(
        leaves: &Bound<'_, PyAny>,
        still: Option<&Bound<'_, PyAny>>,
        up: Option<&Bound<'_, PyAny>>,
        lit: bool,
    ) -> PyResult<Self> {
        let foliage = |value: &Bound<'_, PyAny>, name| -> PyResult<Cow<'static, Foliage>> {
            let value: Bound<'_, PyFoliage> = read(value, name, "a Foliage")?;
            Ok(Cow::Owned(Foliage::clone(&value.get().0)))
        };
        let (leaves, still) = (foliage(leaves, "leaves")?, still.map(|still| foliage(still, "still")).transpose()?);
        Ok(Self(Arc::new(Yardstick::new(leaves, still, upright(up)?, lit, LARGEST))))
    }

    #[pyo3(signature = (level, *, q = 1.0))]
    fn judge<'py>(&self, py: Python<'py>, level: &Bound<'py, PyAny>, q: f64) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let yardstick = Arc::clone(&self.0);
        let judged = if let Ok(impostor) = level.cast::<PyOctahedralLevel>() {
            let impostor = Arc::clone(&impostor.get().impostor);
            interruptible(py, move |_| all(&yardstick, Subject::Octahedral(&impostor), q))?
        } else if let Ok(foliage) = level.cast::<PyFoliage>() {
            let foliage = Arc::clone(&foliage.get().0);
            interruptible(py, move |_| all(&yardstick, Subject::Foliage(&foliage), q))?
        } else {
            return Err(refuse("level must be a Foliage or an OctahedralLevel"));
        };
        judged.iter().map(|each| judgement_dict(py, each, q)).collect()
    }
}

#[pyfunction]
pub fn allowed_difference(quality: f64) -> f64 {
    Wishes { quality, ..Wishes::default() }.q()
}

#[pyfunction]
pub fn page_side(memory_budget: f64) -> usize {
    Wishes { memory_budget, ..Wishes::default() }.page_side(TYPICAL_IMAGES)
}

/// Images of a page: base color and normals.
const TYPICAL_IMAGES: usize = 2;

fn all(yardstick: &Yardstick, level: Subject, q: f64) -> leafcloud::Result<Vec<Judgement>> {
    let judged =
        yardstick.sides().map(|side| yardstick.judge(level, side, q)).collect::<leafcloud::Result<Vec<_>>>()?;
    Ok(judged.into_iter().flatten().collect())
}

/// Returns the figures of a judgement.
fn judgement_dict<'py>(py: Python<'py>, judged: &Judgement, q: f64) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let (excess, by) = judged.excess(q);
    dict.set_item("crown_pixels", judged.crown)?;
    dict.set_item("difference", judged.difference)?;
    dict.set_item("contrast", judged.looks.contrast.to_vec())?;
    dict.set_item("coverage", judged.looks.coverage)?;
    dict.set_item("places", judged.places)?;
    dict.set_item("color", judged.looks.color)?;
    dict.set_item("excess", excess)?;
    dict.set_item("by", by)?;
    Ok(dict)
}

/// Returns where a level takes over.
pub fn passed_dict<'py>(py: Python<'py>, passed: &Passed, q: f64) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("crown_pixels", passed.crown)?;
    dict.set_item("passes", passed.passes)?;
    dict.set_item("judged", judgement_dict(py, &passed.judged, q)?)?;
    Ok(dict)
}
