//! Keyword options to the core's settings, each read once; what is left over is unknown and refused.

use leafcloud::fit::{FitSettings, Method};
use leafcloud::lod::ChainSettings;
use leafcloud::textures::Samples;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays;
use crate::errors::{Failure, refuse};

/// Options that are taken out one by one.
pub struct Options<'py>(Option<Bound<'py, PyDict>>);

impl<'py> Options<'py> {
    pub fn new(options: Option<&Bound<'py, PyDict>>) -> PyResult<Self> {
        options.map(PyDictMethods::copy).transpose().map(Self)
    }

    fn take<T>(&self, name: &str, read: impl FnOnce(&Bound<'py, PyAny>) -> PyResult<T>, default: T) -> PyResult<T> {
        let Some(options) = &self.0 else { return Ok(default) };
        let Some(value) = options.get_item(name)? else { return Ok(default) };
        options.del_item(name)?;
        read(&value)
    }

    fn number(&self, name: &str, default: f64) -> PyResult<f64> {
        self.take(name, |v| v.extract().map_err(|_| wrong(name, v, "a number")), default)
    }

    fn count(&self, name: &str, default: usize) -> PyResult<usize> {
        self.take(name, |v| v.extract().map_err(|_| wrong(name, v, "a whole number of at least 0")), default)
    }

    fn flag(&self, name: &str, default: bool) -> PyResult<bool> {
        self.take(name, |v| v.extract().map_err(|_| wrong(name, v, "True or False")), default)
    }

    pub fn fit(&self) -> PyResult<FitSettings> {
        let default = FitSettings::default();
        let method = |v: &Bound<'py, PyAny>| {
            let name: String = v.extract().map_err(|_| wrong("method", v, "a name"))?;
            Ok(Method::from_name(&name).map_err(Failure::from)?)
        };
        Ok(FitSettings {
            method: self.take("method", method, default.method)?,
            epsilon: self.number("epsilon", default.epsilon)?,
            candidates: self.count("candidates", default.candidates)?,
            seed: self.count("seed", default.seed as usize)? as u64,
            whole_leaves: self.flag("whole_leaves", default.whole_leaves)?,
            facing: self.number("facing", default.facing)?,
        })
    }

    pub fn chain(&self) -> PyResult<ChainSettings> {
        let default = ChainSettings::default();
        let sides = |v: &Bound<'py, PyAny>| v.extract().map_err(|_| wrong("back_sides", v, "True, False or None"));
        let samples = |v: &Bound<'py, PyAny>| {
            let count = v.extract().map_err(|_| wrong("samples", v, "a whole number"))?;
            Ok(Samples::new(count).map_err(Failure::from)?)
        };
        Ok(ChainSettings {
            fit: self.fit()?,
            levels: self.count("levels", default.levels)?,
            cross: self.flag("cross", default.cross)?,
            up: self.take("up", |v| arrays::vector(v, "up"), default.up)?,
            texture_size: self.count("texture_size", default.texture_size)?,
            samples: self.take("samples", samples, default.samples)?,
            back_sides: self.take("back_sides", sides, default.back_sides)?,
        })
    }

    /// Refuses what nobody took.
    pub fn finish(self) -> PyResult<()> {
        let left: Vec<String> = self.0.iter().flat_map(PyDictMethods::keys).map(|key| key.to_string()).collect();
        if left.is_empty() { Ok(()) } else { Err(refuse(format!("unknown option {}", left.join(", ")))) }
    }
}

fn wrong(name: &str, value: &Bound<'_, PyAny>, wanted: &str) -> PyErr {
    refuse(format!("{name} is {value}; it must be {wanted}"))
}
