//! Numbers in the form of glTF's `EXT_meshopt_compression`, by the library meshoptimizer. Its decoder reads any stream
//! safely, but allocates as many rows as it is told: a stream that is far too short for them is refused before.

use leafcloud::{Error, Result};
use meshopt::{decode_index_buffer, decode_vertex_buffer, encode_index_buffer, encode_vertex_buffer_level};
use numpy::{AllowTypeChange, IntoPyArray, PyArray1, PyArray2, PyArrayLike2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays;
use crate::errors::{read, refuse};
use crate::work::interruptible;

/// Version of the vertex codec that `EXT_meshopt_compression` reads. It knows no levels of effort.
const VERSION: Option<i32> = Some(0);
const NO_LEVEL: i32 = 0;

/// Most decoded bytes for each byte of a stream: rows that are all alike take a byte for 256 bytes of each four.
const MOST_BYTES: usize = 2048;

/// Calls a function that is generic over the bytes of a row. glTF asks for multiples of 4; rows of up to four floats.
macro_rules! with_stride {
    ($stride:expr, $function:ident($($argument:expr),*)) => {
        match $stride {
            4 => $function::<4>($($argument),*),
            8 => $function::<8>($($argument),*),
            12 => $function::<12>($($argument),*),
            16 => $function::<16>($($argument),*),
            other => Err(Error::invalid(format!("rows have {other} bytes; they must have 4, 8, 12 or 16"))),
        }
    };
}

#[pyfunction]
pub fn compress_rows<'py>(
    py: Python<'py>,
    rows: PyArrayLike2<'py, u8, AllowTypeChange>,
) -> PyResult<Bound<'py, PyBytes>> {
    let view = rows.as_array();
    let (stride, bytes) = (view.ncols(), view.iter().copied().collect::<Vec<u8>>());
    let stream = interruptible(py, move |_| with_stride!(stride, encoded(&bytes)))?;
    Ok(PyBytes::new(py, &stream))
}

#[pyfunction]
pub fn decompress_rows<'py>(
    py: Python<'py>,
    stream: Vec<u8>,
    count: &Bound<'py, PyAny>,
    stride: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<u8>>> {
    let count: usize = read(count, "count", "a number of rows")?;
    let stride: usize = read(stride, "stride", "4, 8, 12 or 16")?;
    check_length(&stream, count, stride)?;
    let bytes = interruptible(py, move |_| with_stride!(stride, decoded(&stream, count)))?;
    bytes.into_pyarray(py).reshape([count, stride])
}

#[pyfunction]
pub fn compress_triangles<'py>(py: Python<'py>, triangles: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyBytes>> {
    let corners = arrays::triangles(triangles)?.into_flattened();
    let vertices = corners.iter().max().map_or(0, |&last| last as usize + 1);
    let stream = interruptible(py, move |_| encode_index_buffer(&corners, vertices).map_err(refusal))?;
    Ok(PyBytes::new(py, &stream))
}

#[pyfunction]
pub fn decompress_triangles<'py>(
    py: Python<'py>,
    stream: Vec<u8>,
    count: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<u32>>> {
    let count: usize = read(count, "count", "a number of triangles")?;
    check_length(&stream, count, 12)?;
    let corners = interruptible(py, move |_| decode_index_buffer::<u32>(&stream, 3 * count).map_err(refusal))?;
    PyArray1::from_vec(py, corners).reshape([count, 3])
}

fn encoded<const STRIDE: usize>(bytes: &[u8]) -> Result<Vec<u8>> {
    encode_vertex_buffer_level(bytes.as_chunks::<STRIDE>().0, NO_LEVEL, VERSION).map_err(refusal)
}

fn decoded<const STRIDE: usize>(stream: &[u8], count: usize) -> Result<Vec<u8>>
where
    [u8; STRIDE]: Clone + Default,
{
    Ok(decode_vertex_buffer::<[u8; STRIDE]>(stream, count).map_err(refusal)?.into_flattened())
}

fn check_length(stream: &[u8], count: usize, stride: usize) -> PyResult<()> {
    let most = stream.len().saturating_mul(MOST_BYTES);
    if count.checked_mul(stride).is_some_and(|bytes| bytes <= most) {
        return Ok(());
    }
    Err(refuse(format!(
        "the stream has {} bytes; {count} rows of {stride} bytes need more: export it again",
        stream.len()
    )))
}

fn refusal(error: meshopt::Error) -> Error {
    Error::invalid(format!("the stream is no mesh of meshoptimizer ({error}): export it again"))
}
