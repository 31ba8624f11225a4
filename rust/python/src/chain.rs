//! `Chain`: the levels of a tree with the reasons for them, in the tree's own coordinates.

use std::sync::Arc;

use leafcloud::Error;
use leafcloud::geometry::Frame;
use leafcloud::lod::{Chain, LeftOut, Level, share_page};
use leafcloud::prune::Kept;
use leafcloud_choose::{Chosen, LeafLevel, TriedEpsilon};
use leafcloud_curve::Stages;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::vector_rows;
use crate::curve::offer_dict;
use crate::leaf_level::PyLeafLevel;
use crate::level::PyLevel;
use crate::octahedral_level::PyOctahedralLevel;
use crate::tools::cost_dict;
use crate::work::interruptible;
use crate::yardstick::passed_dict;

/// Indices of kept triangles and their growth factors.
pub type KeptArrays<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>);

#[pyclass(name = "Chain", module = "leafcloud", frozen)]
pub struct PyChain {
    pub chosen: Chosen,
    /// Frame of the leaves.
    pub frame: Frame,
}

impl PyChain {
    fn chain(&self) -> &Chain {
        &self.chosen.chain
    }
}

#[pymethods]
impl PyChain {
    #[getter]
    fn chosen<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self.chosen.offer.as_ref().map(|offer| offer_dict(py, offer)).transpose()
    }

    #[getter]
    fn seconds(&self) -> f64 {
        let Chosen { chain, leaf_levels, octahedral, .. } = &self.chosen;
        let leaves: f64 = leaf_levels.iter().map(|own| own.seconds).sum();
        Stages::of(chain).total() + leaves + octahedral.as_ref().map_or(0.0, |own| own.seconds)
    }

    #[getter]
    fn levels(&self, py: Python<'_>) -> PyResult<Vec<Py<PyAny>>> {
        let Chosen { leaf_levels, octahedral, .. } = &self.chosen;
        let simplified = |level: &Arc<LeafLevel>| PyLeafLevel { level: Arc::clone(level), frame: self.frame };
        let own = leaf_levels.iter().map(|level| Ok(Py::new(py, simplified(level))?.into_any()));
        let mut clouds = self.clouds();
        let last = octahedral
            .as_ref()
            .and_then(|impostor| Some(PyOctahedralLevel { impostor: Arc::clone(impostor), cross: clouds.pop()? }));
        let clouds = clouds.into_iter().map(|level| Ok(Py::new(py, level)?.into_any()));
        own.chain(clouds).chain(last.map(|level| Ok(Py::new(py, level)?.into_any()))).collect()
    }

    #[getter]
    fn clouds(&self) -> Vec<PyLevel> {
        let Chosen { chain, leaf_levels, .. } = &self.chosen;
        let fewer = |index| leaf_levels.last().filter(|level| index == 0 && level.kept.is_some()).map(Arc::clone);
        let level = |index| PyLevel { chain: Arc::clone(chain), index, radius: self.frame.radius, fewer: fewer(index) };
        (0..chain.levels.len()).map(level).collect()
    }

    #[getter]
    fn takes_over<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        self.chosen.takes_over.iter().map(|passed| passed_dict(py, passed, self.chosen.q)).collect()
    }

    #[getter]
    fn plain_takes_over<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self.chosen.plain.iter().map(|passed| passed_dict(py, passed, self.chosen.q)).next().transpose()
    }

    #[getter]
    fn tried<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let row = |each: &TriedEpsilon| {
            let dict = PyDict::new(py);
            dict.set_item("epsilon", each.epsilon)?;
            dict.set_item("excess", each.excess.0)?;
            dict.set_item("by", each.excess.1)?;
            dict.set_item("billboards", each.billboards)?;
            Ok(dict)
        };
        self.chosen.tried.iter().map(row).collect()
    }

    #[getter]
    fn left_out<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let row = |each: &LeftOut| {
            let dict = PyDict::new(py);
            dict.set_item("method", each.method)?;
            dict.set_item("epsilon", each.epsilon)?;
            dict.set_item("crown_pixels", 2.0 * each.radius_pixels)?;
            dict.set_item("cost", cost_dict(py, &each.cost)?)?;
            dict.set_item("before", cost_dict(py, &each.before)?)?;
            Ok(dict)
        };
        self.chain().left_out.iter().map(row).collect()
    }

    #[getter]
    fn ranks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.chain().ranks.clone().into_pyarray(py)
    }

    #[getter]
    fn pivots<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        vector_rows(py, self.chain().pivots.iter().copied())
    }

    #[getter]
    fn twigs<'py>(&self, py: Python<'py>) -> Vec<Bound<'py, PyArray1<u32>>> {
        self.chosen.twigs.iter().map(|twigs| twigs.clone().into_pyarray(py)).collect()
    }

    #[getter]
    fn growth(&self) -> (f64, f64) {
        (self.chain().growth.first, self.chain().growth.second)
    }

    #[getter]
    fn contrast(&self) -> (f64, f64) {
        (self.chain().contrast.first, self.chain().contrast.second)
    }

    #[getter]
    fn look_seconds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let seconds = self.chain().measuring_seconds;
        let dict = PyDict::new(py);
        dict.set_item("order", seconds.order)?;
        dict.set_item("hidden", seconds.hidden)?;
        dict.set_item("sky", seconds.sky)?;
        dict.set_item("growth", seconds.growth)?;
        dict.set_item("contrast", seconds.contrast)?;
        Ok(dict)
    }

    #[getter]
    fn kept<'py>(&self, py: Python<'py>) -> Option<KeptArrays<'py>> {
        self.chain().kept.as_ref().map(|kept| kept_arrays(py, kept))
    }
}

pub fn kept_arrays<'py>(py: Python<'py>, kept: &Kept) -> KeptArrays<'py> {
    (kept.triangles.clone().into_pyarray(py), kept.growth.clone().into_pyarray(py))
}

/// Puts the levels of several chains with the same number on one page. Chains may have different numbers of levels.
#[pyfunction]
pub fn share_pages(py: Python<'_>, chains: Vec<Bound<'_, PyChain>>) -> PyResult<Vec<PyChain>> {
    let owned: Vec<(Chosen, Frame)> = chains.iter().map(|own| (own.get().chosen.clone(), own.get().frame)).collect();
    let chains: Vec<Arc<Chain>> = owned.iter().map(|(chosen, _)| Arc::clone(&chosen.chain)).collect();
    let shared = interruptible(py, move |_| share_all(&chains))?;
    let with_own = |(chain, (chosen, frame))| PyChain { chosen: Chosen { chain: Arc::new(chain), ..chosen }, frame };
    Ok(shared.into_iter().zip(owned).map(with_own).collect())
}

fn share_all(chains: &[Arc<Chain>]) -> Result<Vec<Chain>, Error> {
    let empty = |chain: &Arc<Chain>| Chain { levels: Vec::new(), ..chain.as_ref().clone() };
    let mut shared: Vec<Chain> = chains.iter().map(empty).collect();
    for number in 0..chains.iter().map(|chain| chain.levels.len()).max().unwrap_or(0) {
        let (owners, levels): (Vec<usize>, Vec<&Level>) =
            chains.iter().enumerate().filter_map(|(i, chain)| Some((i, chain.levels.get(number)?))).unzip();
        for (owner, level) in owners.into_iter().zip(share_page(&levels)?) {
            shared[owner].levels.push(level);
        }
    }
    Ok(shared)
}
