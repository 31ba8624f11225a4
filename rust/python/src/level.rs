//! `Level`: a billboard cloud or the cross impostor, in the tree's own coordinates.

use std::sync::Arc;

use glam::DVec3;
use leafcloud::atlas::Billboard;
use leafcloud::lod::{Chain, Level};
use leafcloud::prune::Kept;
use leafcloud::transition::Projection;
use leafcloud::{Error, Foliage};
use leafcloud_choose::LeafLevel;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arrays::{self, image_array, image_or_none, point_groups, vector_rows};
use crate::cloud::{CloudInFrame, PyCloud};
use crate::errors::read;
use crate::foliage::PyFoliage;
use crate::image_errors::{Pair, PyImageErrors, from_the_side, measured, reported};
use crate::ktx2;
use crate::work::{guard, interruptible};

#[pyclass(name = "Level", module = "leafcloud", frozen)]
#[derive(Clone)]
pub struct PyLevel {
    pub chain: Arc<Chain>,
    pub index: usize,
    /// R of the leaves.
    pub radius: f64,
    /// Fewer leaves before the first cloud, which is made from all.
    pub fewer: Option<Arc<LeafLevel>>,
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
                cloud: Arc::clone(cloud),
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
