//! Conversion between numpy arrays and the core's vectors.

use glam::{DVec3, Vec2, Vec3, Vec4};
use leafcloud::Image;
use leafcloud::geometry::Placement;
use leafcloud::limits;
use leafcloud::textures::Samples;
use numpy::ndarray::ArrayView2;
use numpy::{
    AllowTypeChange, IntoPyArray, PyArray1, PyArray3, PyArrayDescrMethods, PyArrayLike2, PyArrayLikeDyn,
    PyArrayMethods, PyReadonlyArray1, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::errors::{Failure, read, refuse};

/// Reads a (rows, 3) array of floats.
pub fn points(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<DVec3>> {
    let array = value
        .extract::<PyArrayLike2<f64, AllowTypeChange>>()
        .map_err(|_| refuse(format!("{name} must be an array of floats of shape (rows, 3)")))?;
    let view = array.as_array();
    expect_columns(&view, 3, name)?;
    let points = view.outer_iter().map(|row| DVec3::new(row[0], row[1], row[2])).collect();
    answer_signals(value, points)
}

/// Reads the (4, 4) matrix from the tree's coordinates to the world.
pub fn placement(value: &Bound<'_, PyAny>) -> PyResult<Placement> {
    let array = value
        .extract::<PyArrayLike2<f64, AllowTypeChange>>()
        .map_err(|_| refuse("matrix must be an array of floats of shape (4, 4)"))?;
    let view = array.as_array();
    if view.shape() != [4, 4] {
        return Err(refuse(format!("matrix has the shape {:?}; it must be (4, 4)", view.shape())));
    }
    let rows = std::array::from_fn(|row| std::array::from_fn(|column| view[[row, column]]));
    Ok(Placement::new(rows).map_err(Failure::from)?)
}

/// Reads a (rows, 3) array of indices.
pub fn triangles(value: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 3]>> {
    let array = integers(value, "triangles")?;
    let view = array.as_array();
    let shape = view.shape().to_vec();
    if shape.len() != 2 || (shape[1] != 3 && shape[0] != 0) {
        return Err(refuse(format!("triangles has the shape {shape:?}; it must be (rows, 3)")));
    }
    let index = |&i: &i64| {
        u32::try_from(i).map_err(|_| {
            refuse(format!("triangle index {i} is out of range; indices count vertices from 0, below 2^32"))
        })
    };
    let flat = view.iter().map(index).collect::<PyResult<Vec<u32>>>()?;
    answer_signals(value, flat.as_chunks::<3>().0.to_vec())
}

/// Reads a (rows,) array of integers.
pub fn identifiers(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<i64>> {
    let array = integers(value, name)?;
    let view = array.as_array();
    if view.ndim() != 1 {
        return Err(refuse(format!("{name} has the shape {:?}; it must be (rows,)", view.shape())));
    }
    answer_signals(value, view.iter().copied().collect())
}

/// Reads a (rows,) array of bool.
pub fn truths(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<bool>> {
    let array: PyReadonlyArray1<'_, bool> =
        value.extract().map_err(|_| refuse(format!("{name} must be a one-dimensional array of bool")))?;
    Ok(array.as_array().iter().copied().collect())
}

fn integers<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<PyArrayLikeDyn<'py, i64, AllowTypeChange>> {
    let wrong = || refuse(format!("{name} must be an array of integers"));
    // NumPy would truncate floats to integers without an error.
    let array = value.py().import("numpy")?.call_method1("asarray", (value,)).map_err(|_| wrong())?;
    let array = array.cast::<PyUntypedArray>().map_err(|_| wrong())?;
    if !array.is_empty() && !matches!(array.dtype().kind(), b'i' | b'u') {
        return Err(refuse(format!("{name} must be integers, not {}", array.dtype())));
    }
    array.extract().map_err(|_| wrong())
}

/// Reads floats per vertex (v, N) or per corner (t, 3, N). Returns them per corner.
pub fn corner_values<const N: usize>(
    value: &Bound<'_, PyAny>,
    name: &str,
    triangles: &[[u32; 3]],
) -> PyResult<Vec<[[f32; N]; 3]>> {
    let array = value
        .extract::<PyArrayLikeDyn<f32, AllowTypeChange>>()
        .map_err(|_| refuse(format!("{name} must be an array of floats")))?;
    let view = array.as_array();
    let shape = view.shape().to_vec();
    let flat: Vec<f32> = answer_signals(value, view.iter().copied().collect())?;
    let rows = flat.as_chunks::<N>().0;
    match shape[..] {
        [count, 3, n] if n == N && count == triangles.len() => Ok(rows.as_chunks::<3>().0.to_vec()),
        [count, n] if n == N => {
            let corner = |&v: &u32| {
                rows.get(v as usize)
                    .copied()
                    .ok_or_else(|| refuse(format!("{name} has {count} rows, but a triangle uses vertex {v}")))
            };
            triangles.iter().map(|t| Ok([corner(&t[0])?, corner(&t[1])?, corner(&t[2])?])).collect()
        }
        _ => Err(refuse(format!(
            "{name} has the shape {shape:?}; it must be (vertices, {N}) or ({}, 3, {N})",
            triangles.len()
        ))),
    }
}

/// Reads an image from an (h, w, 4) array of bytes.
pub fn image(value: &Bound<'_, PyAny>) -> PyResult<Image> {
    let array =
        value.cast::<PyArray3<u8>>().map_err(|_| refuse("an image must be a uint8 array of shape (h, w, 4)"))?;
    let array = array.try_readonly().map_err(|_| refuse("the image is being written to"))?;
    let view = array.as_array();
    let &[height, width, channels] = view.shape() else { return Err(refuse("an image has three axes")) };
    if channels != 4 {
        return Err(refuse(format!("an image has {channels} channels; it must have 4 (RGBA)")));
    }
    let flat: Vec<u8> = answer_signals(value, view.iter().copied().collect())?;
    Image::new(width, height, flat.as_chunks::<4>().0.to_vec()).map_err(|e| refuse(e.to_string()))
}

/// Returns an image as an (h, w, 4) array.
pub fn image_array<'py>(py: Python<'py>, image: &Image) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let flat: Bound<'py, PyArray1<u8>> = image.pixels().as_flattened().to_vec().into_pyarray(py);
    flat.reshape([image.height(), image.width(), 4])
}

/// Returns an image as an (h, w, 4) array, or None if the page lacks this channel.
pub fn image_or_none<'py>(py: Python<'py>, image: Option<&Image>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
    image.map(|image| image_array(py, image)).transpose()
}

/// Returns points as a (rows, 3) array.
pub fn vector_rows(py: Python<'_>, points: impl Iterator<Item = DVec3>) -> PyResult<Bound<'_, numpy::PyArray2<f64>>> {
    let flat: Vec<f64> = points.flat_map(|p| p.to_array()).collect();
    let rows = flat.len() / 3;
    flat.into_pyarray(py).reshape([rows, 3])
}

/// Returns groups of `M` points as a (rows, M, 3) array.
pub fn point_groups<const M: usize>(
    py: Python<'_>,
    groups: impl Iterator<Item = [DVec3; M]>,
) -> PyResult<Bound<'_, PyArray3<f64>>> {
    let flat: Vec<f64> = groups.flatten().flat_map(|p| p.to_array()).collect();
    let rows = flat.len() / (3 * M);
    flat.into_pyarray(py).reshape([rows, M, 3])
}

/// Reads the number of samples along each side of a texel or pixel.
pub fn samples(value: &Bound<'_, PyAny>) -> PyResult<Samples> {
    let count = read(value, "samples", &format!("a whole number {}", limits::SAMPLES))?;
    Ok(Samples::new(count).map_err(Failure::from)?)
}

/// Reads a, the share of a transition.
pub fn transition(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    let a: f64 = read(value, "a", "a number in [0, 1]")?;
    if (0.0..=1.0).contains(&a) { Ok(a) } else { Err(refuse(format!("a is {a:?}; it must lie in [0, 1]"))) }
}

/// Reads a vector of three floats.
pub fn vector(value: &Bound<'_, PyAny>, name: &str) -> PyResult<DVec3> {
    let values: Vec<f64> = read(value, name, "three floats")?;
    match values[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(refuse(format!("{name} has {} values; it must have three", values.len()))),
    }
}

/// Returns `read`, or `KeyboardInterrupt` after a Ctrl-C. Called after each array, because reading a large one takes long.
fn answer_signals<T>(value: &Bound<'_, PyAny>, read: T) -> PyResult<T> {
    value.py().check_signals()?;
    Ok(read)
}

fn expect_columns(view: &ArrayView2<'_, f64>, columns: usize, name: &str) -> PyResult<()> {
    if view.ncols() == columns {
        return Ok(());
    }
    Err(refuse(format!("{name} has the shape {:?}; it must be (rows, {columns})", view.shape())))
}

/// Converts arrays of two floats to vectors.
pub fn to_vec2(corners: Vec<[[f32; 2]; 3]>) -> Vec<[Vec2; 3]> {
    corners.into_iter().map(|c| c.map(Vec2::from_array)).collect()
}

/// Converts arrays of three floats to vectors.
pub fn to_vec3(corners: Vec<[[f32; 3]; 3]>) -> Vec<[Vec3; 3]> {
    corners.into_iter().map(|c| c.map(Vec3::from_array)).collect()
}

/// Converts arrays of four floats to vectors.
pub fn to_vec4(corners: Vec<[[f32; 4]; 3]>) -> Vec<[Vec4; 3]> {
    corners.into_iter().map(|c| c.map(Vec4::from_array)).collect()
}
