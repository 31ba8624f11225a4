//! `Curve`: the cost curve, accuracy over time.

use std::sync::Arc;

use leafcloud::fit::Named;
use leafcloud_curve::chart::{Chart, ChartSize, Cost};
use leafcloud_curve::{Choice, Curve, Model, Offer, Point, Prediction, Preset, Sweep, offers};
use numpy::PyArray3;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::image_array;
use crate::errors::Failure;
use crate::options::Options;
use crate::work::interruptible;

#[pyclass(name = "Curve", module = "leafcloud", frozen)]
#[derive(Clone)]
pub struct PyCurve(pub Arc<Curve>);

#[pymethods]
impl PyCurve {
    #[getter]
    fn rows<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        self.0.points.iter().map(|point| row(py, point)).collect()
    }

    #[getter]
    fn refused<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let row = |refused: &leafcloud_curve::Refused| {
            let dict = PyDict::new(py);
            dict.set_item("settings", settings(py, &refused.choice)?)?;
            dict.set_item("reason", &refused.reason)?;
            Ok(dict)
        };
        self.0.refused.iter().map(row).collect()
    }

    #[getter]
    fn quick(&self) -> bool {
        self.0.sweep == Sweep::Quick
    }

    #[getter]
    fn offers<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        offers(&self.0).iter().map(|offer| offer_dict(py, offer)).collect()
    }

    #[getter]
    fn presets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (offers, dict) = (offers(&self.0), PyDict::new(py));
        for preset in Preset::ALL {
            let offer = preset.of(&offers).map(|offer| offer_dict(py, offer)).transpose()?;
            dict.set_item(preset.name(), offer)?;
        }
        Ok(dict)
    }

    #[pyo3(signature = (**options))]
    fn predict<'py>(&self, py: Python<'py>, options: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyDict>> {
        let options = Options::new(options)?;
        let settings = options.chain()?;
        options.finish()?;
        settings.check().map_err(Failure::from)?;
        prediction(py, &Model::new(&self.0).predict(&Choice::of(&settings)))
    }

    #[pyo3(signature = (over = "seconds", *, title = "", width = 960, height = 640, text = 1.0))]
    fn svg(&self, py: Python<'_>, over: &str, title: &str, width: u32, height: u32, text: f64) -> PyResult<String> {
        let size = ChartSize { width, height, text };
        let (curve, over, title) = (self.clone(), over.to_owned(), title.to_owned());
        interruptible(py, move |_| curve.chart(&over, &title)?.svg(size))
    }

    #[pyo3(signature = (over = "seconds", *, title = "", width = 960, height = 640, text = 1.0))]
    fn picture<'py>(
        &self,
        py: Python<'py>,
        over: &str,
        title: &str,
        width: u32,
        height: u32,
        text: f64,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let size = ChartSize { width, height, text };
        let (curve, over, title) = (self.clone(), over.to_owned(), title.to_owned());
        let image = interruptible(py, move |_| curve.chart(&over, &title)?.picture(size))?;
        image_array(py, &image)
    }
}

impl PyCurve {
    fn chart(&self, over: &str, title: &str) -> leafcloud::Result<Chart> {
        if over == "offers" {
            return Ok(Chart::of_offers(title, &offers(&self.0)));
        }
        Ok(Chart::of_points(title, &self.0.points, Cost::from_name(over)?))
    }
}

/// Returns the settings that a sweep varies, by name.
fn settings<'py>(py: Python<'py>, choice: &Choice) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("method", choice.method.name())?;
    dict.set_item("effort", choice.effort.name())?;
    dict.set_item("epsilon", choice.epsilon)?;
    dict.set_item("candidates", choice.candidates)?;
    dict.set_item("max_billboards", choice.max_billboards)?;
    dict.set_item("levels", choice.levels)?;
    dict.set_item("cross", choice.cross)?;
    dict.set_item("texture_size", choice.texture_size)?;
    dict.set_item("samples", choice.samples)?;
    dict.set_item("tight_pages", choice.tight_pages)?;
    Ok(dict)
}

fn row<'py>(py: Python<'py>, point: &Point) -> PyResult<Bound<'py, PyDict>> {
    let seconds = PyDict::new(py);
    for (stage, value) in point.seconds.named() {
        seconds.set_item(stage, value)?;
    }
    seconds.set_item("total", point.seconds.total())?;
    let dict = PyDict::new(py);
    dict.set_item("settings", settings(py, &point.choice)?)?;
    dict.set_item("measured_on", point.measured_on)?;
    dict.set_item("seconds", seconds)?;
    dict.set_item("peak_bytes", point.peak_bytes)?;
    dict.set_item("billboards", point.billboards)?;
    dict.set_item("triangles", point.triangles)?;
    dict.set_item("texels", point.texels)?;
    dict.set_item("bytes", point.bytes)?;
    dict.set_item("texel", point.texel)?;
    dict.set_item("max_deviation", point.max_deviation)?;
    dict.set_item("mean_deviation", point.mean_deviation)?;
    dict.set_item("image_error", point.image_error)?;
    dict.set_item("front", point.front)?;
    Ok(dict)
}

fn prediction<'py>(py: Python<'py>, predicted: &Prediction) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("seconds", predicted.seconds)?;
    dict.set_item("image_error", predicted.image_error)?;
    Ok(dict)
}

/// Returns an offer: settings and their prediction.
pub fn offer_dict<'py>(py: Python<'py>, offer: &Offer) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("settings", settings(py, &offer.choice)?)?;
    dict.set_item("predicted", prediction(py, &offer.predicted)?)?;
    Ok(dict)
}
