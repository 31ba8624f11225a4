//! Numbers in the form of glTF's `EXT_meshopt_compression`, by the library meshoptimizer. Its decoder reads any stream
//! safely, but allocates as many rows as it is told: a stream that is far too short for them is refused before.

use leafcloud::{Error, Result};
use meshopt::{
    decode_filter_color, decode_filter_exp, decode_filter_oct, decode_filter_quat, decode_index_buffer,
    decode_index_sequence, decode_vertex_buffer, encode_index_buffer, encode_vertex_buffer_level,
};
use numpy::{AllowTypeChange, PyArrayLike2};
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

/// Calls a function that is generic over the bytes of a row. glTF asks for multiples of 4; rows of up to eight floats.
macro_rules! with_stride {
    ($stride:expr, $function:ident($($argument:expr),*)) => {
        match $stride {
            4 => $function::<4>($($argument),*),
            8 => $function::<8>($($argument),*),
            12 => $function::<12>($($argument),*),
            16 => $function::<16>($($argument),*),
            20 => $function::<20>($($argument),*),
            24 => $function::<24>($($argument),*),
            28 => $function::<28>($($argument),*),
            32 => $function::<32>($($argument),*),
            other => Err(Error::invalid(format!("rows have {other} bytes; they must have a multiple of 4, up to 32"))),
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
pub fn compress_triangles<'py>(py: Python<'py>, triangles: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyBytes>> {
    let corners = arrays::triangles(triangles)?.into_flattened();
    let vertices = corners.iter().max().map_or(0, |&last| last as usize + 1);
    let stream = interruptible(py, move |_| encode_index_buffer(&corners, vertices).map_err(refusal))?;
    Ok(PyBytes::new(py, &stream))
}

#[pyfunction]
#[pyo3(signature = (stream, count, stride, mode=None, filter=None))]
pub fn decompress<'py>(
    py: Python<'py>,
    stream: Vec<u8>,
    count: &Bound<'py, PyAny>,
    stride: &Bound<'py, PyAny>,
    mode: Option<String>,
    filter: Option<String>,
) -> PyResult<Bound<'py, PyBytes>> {
    let count: usize = read(count, "count", "a number of elements")?;
    let stride: usize = read(stride, "stride", "a number of bytes")?;
    let (mode, filter) = (mode.as_deref().unwrap_or("ATTRIBUTES"), filter.as_deref().unwrap_or("NONE"));
    check_length(&stream, count, stride)?;
    let work = match (mode, filter, stride) {
        ("ATTRIBUTES", filter, _) => match filter_of(filter, stride) {
            Some(filter) => Work::Rows(filter),
            None => return Err(refuse(format!("the filter {filter:?} is unknown, or not for rows of {stride} bytes"))),
        },
        ("TRIANGLES", "NONE", 2 | 4) if count.is_multiple_of(3) => Work::Triangles,
        ("INDICES", "NONE", 2 | 4) => Work::Indices,
        _ => {
            return Err(refuse(format!(
                "the mode {mode:?} is unknown, or not for {count} elements of {stride} bytes with the filter {filter:?}"
            )));
        }
    };
    let bytes = interruptible(py, move |_| work.done(&stream, count, stride))?;
    Ok(PyBytes::new(py, &bytes))
}

/// What a stream holds.
enum Work {
    Rows(fn(Vec<u8>) -> Vec<u8>),
    Triangles,
    Indices,
}

impl Work {
    fn done(self, stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>> {
        match (self, stride) {
            (Self::Rows(filter), _) => with_stride!(stride, decoded(stream, count)).map(filter),
            (Self::Triangles, 2) => decode_index_buffer::<u16>(stream, count).map(|all| little(&all)).map_err(refusal),
            (Self::Triangles, _) => decode_index_buffer::<u32>(stream, count).map(|all| little(&all)).map_err(refusal),
            (Self::Indices, 2) => decode_index_sequence::<u16>(stream, count).map(|all| little(&all)).map_err(refusal),
            (Self::Indices, _) => decode_index_sequence::<u32>(stream, count).map(|all| little(&all)).map_err(refusal),
        }
    }
}

/// Returns the function that undoes a filter of glTF on rows; none for one that is unknown or for other strides.
fn filter_of(name: &str, stride: usize) -> Option<fn(Vec<u8>) -> Vec<u8>> {
    match (name, stride) {
        ("NONE", _) => Some(|bytes| bytes),
        ("OCTAHEDRAL", 4) => Some(|bytes| filtered::<i8, 4, 1>(&bytes, decode_filter_oct)),
        ("OCTAHEDRAL", 8) => Some(|bytes| filtered::<i16, 4, 2>(&bytes, decode_filter_oct)),
        ("COLOR", 4) => Some(|bytes| filtered::<u8, 4, 1>(&bytes, decode_filter_color)),
        ("COLOR", 8) => Some(|bytes| filtered::<u16, 4, 2>(&bytes, decode_filter_color)),
        ("QUATERNION", 8) => Some(|bytes| filtered::<i16, 4, 2>(&bytes, decode_filter_quat)),
        ("EXPONENTIAL", _) => Some(|bytes| filtered::<u32, 1, 4>(&bytes, decode_filter_exp)),
        _ => None,
    }
}

/// Returns rows of N numbers of B bytes after a filter.
fn filtered<T: Code<B>, const N: usize, const B: usize>(bytes: &[u8], filter: fn(&mut [[T; N]])) -> Vec<u8> {
    let numbers: Vec<T> = bytes.as_chunks::<B>().0.iter().map(|&each| T::from_bytes(each)).collect();
    let mut rows = numbers.as_chunks::<N>().0.to_vec();
    filter(&mut rows);
    little(rows.as_flattened())
}

/// Returns the bytes of numbers, the least first, as glTF stores them.
fn little<T: Code<B>, const B: usize>(numbers: &[T]) -> Vec<u8> {
    numbers.iter().flat_map(|&number| number.bytes()).collect()
}

/// A whole number of B bytes.
trait Code<const B: usize>: Copy {
    fn from_bytes(bytes: [u8; B]) -> Self;
    fn bytes(self) -> [u8; B];
}

macro_rules! code {
    ($($kind:ty, $bytes:literal);*) => {$(
        impl Code<$bytes> for $kind {
            fn from_bytes(bytes: [u8; $bytes]) -> Self {
                Self::from_le_bytes(bytes)
            }

            fn bytes(self) -> [u8; $bytes] {
                self.to_le_bytes()
            }
        }
    )*};
}

code!(i8, 1; u8, 1; i16, 2; u16, 2; u32, 4);

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
