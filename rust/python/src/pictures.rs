//! Functions for pictures: FLIP of each pixel, image files in memory, text.

use leafcloud::textures::animation::encode_png as core_encode_png;
use leafcloud::textures::image::decode;
use leafcloud::{Error, Image, Result};
use leafcloud_curve::text_picture;
use leafcloud_flip::flip_map as core_flip_map;
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays;
use crate::errors::{read, refuse};
use crate::work::interruptible;

#[pyfunction]
pub fn flip_map<'py>(
    py: Python<'py>,
    base: &Bound<'py, PyAny>,
    other: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (base, other) = (arrays::image(base)?, arrays::image(other)?);
    let (height, width) = (base.height(), base.width());
    if (height, width) != (other.height(), other.width()) {
        return Err(refuse(format!(
            "the images have {width} × {height} and {} × {} pixels; both must have one size",
            other.width(),
            other.height()
        )));
    }
    let errors = interruptible(py, move |_| Ok(core_flip_map(&base, &other)))?;
    errors.into_pyarray(py).reshape([height, width])
}

#[pyfunction]
#[pyo3(signature = (frames, *, milliseconds = None, colors = None))]
pub fn encode_png<'py>(
    py: Python<'py>,
    frames: &Bound<'py, PyAny>,
    milliseconds: Option<&Bound<'py, PyAny>>,
    colors: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyBytes>> {
    let frames: Vec<Bound<'py, PyAny>> = read(frames, "frames", "a list of images")?;
    let frames = frames.iter().map(arrays::image).collect::<PyResult<Vec<_>>>()?;
    let milliseconds: Vec<u16> =
        milliseconds.map_or(Ok(Vec::new()), |v| read(v, "milliseconds", "whole numbers from 0 to 65535"))?;
    let colors = colors.map(|v| read(v, "colors", "a whole number from 2 to 256")).transpose()?;
    let file = interruptible(py, move |_| core_encode_png(&frames, &milliseconds, colors))?;
    Ok(PyBytes::new(py, &file))
}

#[pyfunction]
pub fn decode_image<'py>(py: Python<'py>, content: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let content: Vec<u8> = read(content, "content", "the bytes of an image file")?;
    let image = interruptible(py, move |_| image_of(&content))?;
    arrays::image_array(py, &image)
}

fn image_of(content: &[u8]) -> Result<Image> {
    if !content.starts_with(&leafcloud_ktx2::SIGNATURE) {
        return decode(content);
    }
    let picture = leafcloud_ktx2::decode(content).map_err(|error| Error::invalid(error.to_string()))?;
    Image::new(picture.width, picture.height, picture.pixels)
}

#[pyfunction]
pub fn draw_text<'py>(
    py: Python<'py>,
    text: &Bound<'py, PyAny>,
    size: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let text: String = read(text, "text", "a text")?;
    let size: f64 = read(size, "size", "a number of pixels")?;
    let picture = interruptible(py, move |_| text_picture(&text, size))?;
    picture.ink.into_pyarray(py).reshape([picture.height, picture.width])
}
