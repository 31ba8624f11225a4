//! `Level` and `Chain`: results in the tree's own coordinates.

use std::sync::Arc;

use glam::DVec3;
use leafcloud::atlas::Billboard;
use leafcloud::geometry::Frame;
use leafcloud::lod::{Chain, LeftOut, Level, share_page};
use leafcloud::prune::Kept;
use leafcloud::transition::Projection;
use leafcloud::{Error, Foliage};
use leafcloud_choose::{Chosen, LeafLevel, TriedEpsilon};
use leafcloud_curve::Stages;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arrays::{self, image_array, image_or_none, point_groups, vector_rows};
use crate::cloud::{CloudInFrame, PyCloud};
use crate::curve::offer_dict;
use crate::errors::read;
use crate::foliage::PyFoliage;
use crate::image_errors::{Pair, PyImageErrors, from_the_side, measured, reported};
use crate::ktx2;
use crate::leaf_level::PyLeafLevel;
use crate::octahedral_level::PyOctahedralLevel;
use crate::tools::cost_dict;
use crate::work::{guard, interruptible};
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
    let empty = |chain: &Arc<Chain>| {
        let Chain {
            left_out, ranks, pivots, growth, contrast, kept, whole, measuring_seconds, prepare_seconds, ..
        } = chain.as_ref();
        Chain {
            levels: Vec::new(),
            left_out: left_out.clone(),
            ranks: ranks.clone(),
            pivots: pivots.clone(),
            growth: *growth,
            contrast: *contrast,
            kept: kept.clone(),
            whole: whole.clone(),
            measuring_seconds: *measuring_seconds,
            prepare_seconds: *prepare_seconds,
        }
    };
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

#[pyclass(name = "Level", module = "leafcloud", frozen)]
#[derive(Clone)]
pub struct PyLevel {
    chain: Arc<Chain>,
    index: usize,
    radius: f64,
    /// Fewer leaves before the first cloud, which is made from all.
    fewer: Option<Arc<LeafLevel>>,
}

impl PyLevel {
    fn level(&self) -> &Level {
        &self.chain.levels[self.index]
    }

    /// Returns the triangles that this level is made of, at `a` of their transition to it.
    fn before_at(&self, before: &Foliage, a: f64) -> Result<Foliage, Error> {
        let Some(projection) = &self.level().projection else {
            return Err(Error::invalid("nothing morphs to the cross impostor; the level before it only fades out"));
        };
        let kept = self.chain.kept.as_ref().filter(|_| self.index == 0);
        let fewer = self.fewer.as_ref().and_then(|level| level.kept.as_ref());
        if let Some(fewer) = fewer.filter(|fewer| fewer.triangles.len() == before.triangle_count()) {
            return self.fewer_at(projection, fewer, before, a);
        }
        let lacks = kept.is_some_and(|kept| kept.triangles.iter().any(|&t| t as usize >= before.triangle_count()));
        let kept = if lacks { None } else { kept.map(|kept| kept.of(before)).transpose()? };
        let finer = kept.as_ref().unwrap_or(before);
        let (given, wanted) = (finer.triangle_count(), projection.targets.len());
        if given != wanted {
            return Err(Error::invalid(format!(
                "the level before has {given} triangles, but {wanted} morph; give the foliage of the level before"
            )));
        }
        projection.at(finer, a)
    }

    /// Returns fewer leaves at `a` of their transition to the first cloud. They stay as large as they are. Those that the crown hides shrink into
    /// their corners' mean.
    fn fewer_at(&self, projection: &Projection, fewer: &Kept, before: &Foliage, a: f64) -> Result<Foliage, Error> {
        let place = |triangle: u32| match &self.chain.kept {
            None => Some(triangle as usize),
            Some(kept) => kept.triangles.binary_search(&triangle).ok(),
        };
        let in_before = |p| before.frame().to_local(self.level().frame.to_caller(p));
        let target = |(number, (&triangle, &growth)): (usize, (&u32, &f64))| {
            let from = before.corners(number);
            let onto: [DVec3; 3] = match place(triangle) {
                None => [(from[0] + from[1] + from[2]) / 3.0; 3],
                Some(place) => {
                    let pivot = projection.pivot_targets[place];
                    projection.targets[place].map(|p| in_before(pivot + (p - pivot) * growth))
                }
            };
            std::array::from_fn(|i| from[i].lerp(onto[i], a))
        };
        let corners: Vec<[DVec3; 3]> = fewer.triangles.iter().zip(&fewer.growth).enumerate().map(target).collect();
        before.with_corners(&corners)
    }
}

#[pymethods]
impl PyLevel {
    #[getter]
    fn cloud(&self) -> Option<PyCloud> {
        let level = self.level();
        level.cloud.as_ref().map(|cloud| {
            PyCloud(CloudInFrame {
                cloud: Arc::new(cloud.clone()),
                frame: level.frame,
                radius: self.radius,
                mean_deviation: level.mean_deviation,
            })
        })
    }

    #[getter]
    fn method(&self) -> &'static str {
        self.level().method
    }

    #[getter]
    fn corners<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (frame, atlas) = (self.level().frame, &self.level().atlas);
        vector_rows(py, atlas.billboards.iter().flat_map(Billboard::drawn_corners).map(|p| frame.to_tree(p)))
    }

    #[getter]
    fn uvs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let atlas = &self.level().atlas;
        let flat: Vec<f32> = atlas.billboards.iter().flat_map(|b| atlas.uvs(b)).flatten().collect();
        let count = flat.len() / 2;
        flat.into_pyarray(py).reshape([count, 2])
    }

    #[getter]
    fn polygon_sizes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let polygons = self.level().atlas.billboards.iter().flat_map(|b| &b.polygons);
        polygons.map(|polygon| polygon.len() as u32).collect::<Vec<_>>().into_pyarray(py)
    }

    #[getter]
    fn polygon_billboards<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let numbered = (0u32..).zip(&self.level().atlas.billboards);
        let owners = numbered.flat_map(|(number, b)| b.polygons.iter().map(move |_| number));
        owners.collect::<Vec<_>>().into_pyarray(py)
    }

    #[getter]
    fn triangles(&self) -> usize {
        self.level().atlas.triangles()
    }

    fn plane_pivots<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let level = self.level();
        let pivots = guard(|| level.plane_pivots())?;
        vector_rows(py, pivots.into_iter())
    }

    #[getter]
    fn plane_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let ids: Vec<u32> = self.level().atlas.billboards.iter().map(|b| b.plane).collect();
        ids.into_pyarray(py)
    }

    #[getter]
    fn regions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let regions = self.level().atlas.billboards.iter().map(|b| b.region);
        let flat: Vec<u32> = regions.flat_map(|r| [r.x, r.y, r.width, r.height].map(|side| side as u32)).collect();
        let count = flat.len() / 4;
        flat.into_pyarray(py).reshape([count, 4])
    }

    #[getter]
    fn two_sided(&self) -> bool {
        self.level().two_sided
    }

    #[getter]
    fn ranks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.level().ranks.clone().into_pyarray(py)
    }

    #[getter]
    fn base_color<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        image_array(py, &self.level().page.base_color)
    }

    #[getter]
    fn normal<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        image_or_none(py, self.level().page.normal.as_ref())
    }

    #[getter]
    fn orm<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        image_or_none(py, self.level().page.orm.as_ref())
    }

    #[getter]
    fn translucency<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        image_or_none(py, self.level().page.translucency.as_ref())
    }

    #[getter]
    fn bent_normal<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        image_or_none(py, self.level().page.bent_normal.as_ref())
    }

    #[getter]
    fn leaf_uv<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        image_or_none(py, self.level().page.leaf_uv.as_ref())
    }

    #[getter]
    fn leaf_id<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        image_or_none(py, self.level().page.leaf_id.as_ref())
    }

    fn mips<'py>(&self, py: Python<'py>, channel: &str) -> PyResult<Vec<Bound<'py, PyArray3<u8>>>> {
        let (level, name) = (self.clone(), channel.to_owned());
        let levels = interruptible(py, move |_| ktx2::mips(level.level(), &name))?;
        levels.iter().map(|image| image_array(py, image)).collect()
    }

    fn alpha_pivots(&self, py: Python<'_>) -> PyResult<Vec<f32>> {
        let level = self.clone();
        interruptible(py, move |_| Ok(level.level().alpha_pivots()))
    }

    fn ktx2<'py>(&self, py: Python<'py>, channel: &str) -> PyResult<Bound<'py, PyBytes>> {
        let (level, name) = (self.clone(), channel.to_owned());
        let file = interruptible(py, move |progress| ktx2::file_of(level.level(), &name, progress));
        file.map(|file| PyBytes::new(py, &file))
    }

    #[getter]
    fn alpha_cutoff(&self) -> f32 {
        self.level().alpha_cutoff
    }

    #[getter]
    fn texels(&self) -> usize {
        self.level().atlas.texels()
    }

    #[getter]
    fn texel_size(&self) -> f64 {
        self.level().atlas.texel() * self.level().frame.radius
    }

    #[getter]
    fn page_share(&self) -> f64 {
        self.level().page_share()
    }

    #[getter]
    fn occupancy(&self) -> f64 {
        self.level().atlas.occupancy()
    }

    #[getter]
    fn targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let frame = self.level().frame;
        let targets = self.level().projection.iter().flat_map(|p| &p.targets);
        let of_leaves = self.index == 0; // A mirror changes the order of the leaves' corners, but not of the billboards'.
        let in_order = |corners| if of_leaves { frame.placement.wound(corners) } else { corners };
        point_groups(py, targets.map(|&corners| in_order(corners).map(|p| frame.to_tree(p))))
    }

    #[getter]
    fn pivots<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let frame = self.level().frame;
        vector_rows(py, self.level().projection.iter().flat_map(|p| &p.pivots).map(|&p| frame.to_tree(p)))
    }

    #[getter]
    fn pivot_targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let frame = self.level().frame;
        vector_rows(py, self.level().projection.iter().flat_map(|p| &p.pivot_targets).map(|&p| frame.to_tree(p)))
    }

    #[getter]
    fn in_plane_motion(&self) -> f64 {
        self.level().in_plane_motion / self.radius
    }

    #[getter]
    fn refined(&self) -> Option<Vec<(usize, f64)>> {
        self.level().refined.as_ref().map(|refined| refined.errors.clone())
    }

    #[getter]
    fn refined_planes(&self) -> Option<Vec<(usize, f64)>> {
        self.level().refined_planes.as_ref().map(|refined| refined.errors.clone())
    }

    #[getter]
    fn mean_deviation(&self) -> f64 {
        self.level().mean_deviation / self.radius
    }

    #[getter]
    fn max_deviation_leaves(&self) -> f64 {
        self.level().max_deviation_leaves / self.radius
    }

    #[getter]
    fn coverage(&self) -> f64 {
        self.level().coverage
    }

    #[getter]
    fn image_error(&self, py: Python<'_>) -> PyResult<f64> {
        reported(py, self.level().pictures.clone())
    }

    fn pictures<'py>(&self, py: Python<'py>) -> PyResult<Pair<'py>> {
        from_the_side(py, &self.level().pictures)
    }

    #[pyo3(signature = (target = None))]
    fn image_errors(&self, py: Python<'_>, target: Option<f64>) -> PyResult<PyImageErrors> {
        measured(py, self.level().pictures.clone(), target)
    }

    #[getter]
    fn seconds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let seconds = self.level().seconds;
        let dict = PyDict::new(py);
        dict.set_item("fit", seconds.fit)?;
        dict.set_item("pack", seconds.pack)?;
        dict.set_item("bake", seconds.bake)?;
        dict.set_item("look", seconds.metrics)?;
        dict.set_item("refine", seconds.refine)?;
        Ok(dict)
    }

    #[getter]
    fn channel_seconds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, seconds) in &self.level().channel_seconds {
            dict.set_item(name, seconds)?;
        }
        Ok(dict)
    }

    fn morphed(&self, py: Python<'_>, before: &Bound<'_, PyAny>, a: &Bound<'_, PyAny>) -> PyResult<PyFoliage> {
        let before: Bound<'_, PyFoliage> = read(before, "before", "a Foliage")?;
        let a = arrays::transition(a)?;
        let (level, before) = (self.clone(), Arc::clone(&before.get().0));
        let foliage = interruptible(py, move |_| level.before_at(&before, a))?;
        Ok(PyFoliage(Arc::new(foliage)))
    }

    #[pyo3(signature = (*, shares = false))]
    fn foliage(&self, shares: bool) -> PyResult<PyFoliage> {
        let foliage = guard(|| if shares { self.level().shares() } else { self.level().foliage() })?;
        Ok(PyFoliage(Arc::new(foliage)))
    }
}
