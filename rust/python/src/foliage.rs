//! `Material` and `Foliage`.

use std::sync::Arc;

use glam::{DVec3, Vec3, Vec4};
use leafcloud::{AlphaMode, Attributes, Foliage, Material};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;

use crate::arrays;
use crate::errors::{read, refuse};
use crate::work::interruptible;

#[pyclass(name = "Material", module = "leafcloud", frozen)]
#[derive(Clone)]
pub struct PyMaterial(pub Material);

#[pymethods]
impl PyMaterial {
    #[new]
    #[pyo3(signature = (name = "leaf", *, base_color = None, image = None, alpha_mode = "OPAQUE", alpha_cutoff = 0.5, double_sided = true, normal = None, roughness = 1.0, metallic = 0.0, orm = None, translucency = None, translucency_image = None))]
    #[allow(clippy::too_many_arguments)] // the Python signature
    fn new(
        name: &str,
        base_color: Option<&Bound<'_, PyAny>>,
        image: Option<&Bound<'_, PyAny>>,
        alpha_mode: &str,
        alpha_cutoff: f32,
        double_sided: bool,
        normal: Option<&Bound<'_, PyAny>>,
        roughness: f32,
        metallic: f32,
        orm: Option<&Bound<'_, PyAny>>,
        translucency: Option<&Bound<'_, PyAny>>,
        translucency_image: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let alpha_mode = match alpha_mode {
            "OPAQUE" => AlphaMode::Opaque,
            "MASK" => AlphaMode::Mask(alpha_cutoff),
            "BLEND" => AlphaMode::Blend,
            other => return Err(refuse(format!("alpha_mode is {other:?}; it must be OPAQUE, MASK or BLEND"))),
        };
        let base_color = base_color.map_or(Ok([1.0; 4]), |v| read(v, "base_color", "four floats in [0, 1]"))?;
        let translucency = translucency.map_or(Ok([0.0; 3]), |v| read(v, "translucency", "three floats in [0, 1]"))?;
        let picture = |value: Option<&Bound<'_, PyAny>>| value.map(arrays::image).transpose();
        let material = Material {
            name: name.to_owned(),
            base_color: Vec4::from_array(base_color),
            image: picture(image)?,
            alpha_mode,
            double_sided,
            normal: picture(normal)?,
            roughness,
            metallic,
            orm: picture(orm)?,
            translucency: Vec3::from_array(translucency),
            translucency_image: picture(translucency_image)?,
            ..Material::default()
        };
        material.check().map_err(|e| refuse(e.to_string()))?;
        Ok(Self(material))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }
}

#[pyclass(name = "Foliage", module = "leafcloud", frozen)]
pub struct PyFoliage(pub Arc<Foliage>);

#[pymethods]
impl PyFoliage {
    #[new]
    #[pyo3(signature = (positions, triangles, *, matrix = None, uvs = None, normals = None, colors = None, back_colors = None, material_ids = None, materials = None, leaf_ids = None, protected = None))]
    #[allow(clippy::too_many_arguments)] // the Python signature
    fn new(
        py: Python<'_>,
        positions: &Bound<'_, PyAny>,
        triangles: &Bound<'_, PyAny>,
        matrix: Option<&Bound<'_, PyAny>>,
        uvs: Option<&Bound<'_, PyAny>>,
        normals: Option<&Bound<'_, PyAny>>,
        colors: Option<&Bound<'_, PyAny>>,
        back_colors: Option<&Bound<'_, PyAny>>,
        material_ids: Option<&Bound<'_, PyAny>>,
        materials: Option<&Bound<'_, PyAny>>,
        leaf_ids: Option<&Bound<'_, PyAny>>,
        protected: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let placement = matrix.map(arrays::placement).transpose()?;
        let positions = arrays::points(positions, "positions")?;
        let triangles = arrays::triangles(triangles)?;
        let attributes = Attributes {
            uvs: uvs.map_or(Ok(Vec::new()), |v| arrays::corner_values(v, "uvs", &triangles).map(arrays::to_vec2))?,
            normals: normals
                .map_or(Ok(Vec::new()), |v| arrays::corner_values(v, "normals", &triangles).map(arrays::to_vec3))?,
            colors: colors
                .map_or(Ok(Vec::new()), |v| arrays::corner_values(v, "colors", &triangles).map(arrays::to_vec4))?,
            back_colors: back_colors
                .map_or(Ok(Vec::new()), |v| arrays::corner_values(v, "back_colors", &triangles).map(arrays::to_vec3))?,
            material_ids: material_ids.map_or(Ok(Vec::new()), material_indices)?,
            leaf_ids: leaf_ids.map_or(Ok(Vec::new()), |v| arrays::identifiers(v, "leaf_ids"))?,
            protected: protected.map_or(Ok(Vec::new()), |v| arrays::truths(v, "protected"))?,
        };
        let materials: Vec<Bound<'_, PyMaterial>> =
            materials.map_or(Ok(Vec::new()), |v| read(v, "materials", "a list of Material"))?;
        let materials = materials.iter().map(|m| m.get().0.clone()).collect();
        let foliage = interruptible(py, move |_| match placement {
            Some(placement) => Foliage::placed(placement, &positions, triangles, attributes, materials),
            None => Foliage::new(&positions, triangles, attributes, materials),
        })?;
        Ok(Self(Arc::new(foliage)))
    }

    #[getter]
    fn centre<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.0.frame().to_tree(DVec3::ZERO).to_array().to_vec().into_pyarray(py)
    }

    #[getter]
    fn world_centre<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.0.frame().centre.to_array().to_vec().into_pyarray(py)
    }

    #[getter]
    fn mirrored(&self) -> bool {
        self.0.frame().placement.mirrors()
    }

    #[getter]
    fn radius(&self) -> f64 {
        self.0.frame().radius
    }

    #[getter]
    fn triangle_count(&self) -> usize {
        self.0.triangle_count()
    }

    #[getter]
    fn leaf_count(&self) -> usize {
        self.0.leaf_count()
    }

    #[getter]
    fn area(&self) -> f64 {
        let areas = (0..self.0.triangle_count()).map(|t| self.0.area_vector(t).length());
        areas.sum::<f64>() * self.0.frame().radius.powi(2)
    }

    #[getter]
    fn leaf_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        self.0.leaf_ids().to_vec().into_pyarray(py)
    }
}

fn material_indices(value: &Bound<'_, PyAny>) -> PyResult<Vec<u32>> {
    let index = |i: i64| {
        u32::try_from(i).map_err(|_| refuse(format!("material id {i} is out of range; ids count the materials from 0")))
    };
    arrays::identifiers(value, "material_ids")?.into_iter().map(index).collect()
}
