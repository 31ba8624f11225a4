//! The Python module `leafcloud`: converts arrays and settings for the core and makes no decisions. Its stub file
//! `leafcloud/__init__.pyi` documents it.

// PyO3 passes arguments by value.
#![allow(clippy::needless_pass_by_value)]

mod allocator;
mod arrays;
mod blend;
mod chain;
mod cloud;
mod compression;
mod curve;
mod errors;
mod foliage;
mod image_errors;
mod job;
mod ktx2;
mod leaf_level;
mod level;
mod octahedral_level;
mod options;
mod pictures;
mod settings;
mod tools;
mod trunk;
mod work;
mod yardstick;

use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    allocator::return_freed_memory();
    work::own_threads();
    drop(numpy::PyArray1::<f64>::zeros(module.py(), 0, false)); // Loads numpy's C functions, for the same reason.
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    errors::register(module)?;
    settings::register(module)?;
    module.add_class::<foliage::PyMaterial>()?;
    module.add_class::<foliage::PyFoliage>()?;
    module.add_class::<cloud::PyCloud>()?;
    module.add_class::<leaf_level::PyLeafLevel>()?;
    module.add_class::<level::PyLevel>()?;
    module.add_class::<octahedral_level::PyOctahedralLevel>()?;
    module.add_class::<chain::PyChain>()?;
    module.add_class::<image_errors::PyImageErrors>()?;
    module.add_class::<yardstick::PyYardstick>()?;
    module.add_class::<curve::PyCurve>()?;
    module.add_class::<job::PyJob>()?;
    module.add_class::<trunk::PySimplified>()?;
    module.add_class::<blend::PyBlendOrder>()?;
    module.add_function(wrap_pyfunction!(job::fit, module)?)?;
    module.add_function(wrap_pyfunction!(job::start_fit, module)?)?;
    module.add_function(wrap_pyfunction!(job::build_chain, module)?)?;
    module.add_function(wrap_pyfunction!(job::start_chain, module)?)?;
    module.add_function(wrap_pyfunction!(job::cost_curve, module)?)?;
    module.add_function(wrap_pyfunction!(job::start_cost_curve, module)?)?;
    module.add_function(wrap_pyfunction!(chain::share_pages, module)?)?;
    module.add_function(wrap_pyfunction!(trunk::simplify, module)?)?;
    module.add_function(wrap_pyfunction!(trunk::unrolled_uvs, module)?)?;
    module.add_function(wrap_pyfunction!(blend::blend_order, module)?)?;
    module.add_function(wrap_pyfunction!(tools::render, module)?)?;
    module.add_function(wrap_pyfunction!(tools::drawing_cost, module)?)?;
    module.add_function(wrap_pyfunction!(tools::write_png, module)?)?;
    module.add_function(wrap_pyfunction!(tools::fill_below, module)?)?;
    module.add_function(wrap_pyfunction!(tools::read_gltf, module)?)?;
    module.add_function(wrap_pyfunction!(tools::leaf_ids, module)?)?;
    module.add_function(wrap_pyfunction!(yardstick::allowed_difference, module)?)?;
    module.add_function(wrap_pyfunction!(yardstick::page_side, module)?)?;
    module.add_function(wrap_pyfunction!(tools::keep, module)?)?;
    module.add_function(wrap_pyfunction!(tools::leaf_scale, module)?)?;
    module.add_function(wrap_pyfunction!(pictures::flip_map, module)?)?;
    module.add_function(wrap_pyfunction!(pictures::encode_png, module)?)?;
    module.add_function(wrap_pyfunction!(pictures::decode_image, module)?)?;
    module.add_function(wrap_pyfunction!(pictures::draw_text, module)?)?;
    module.add_function(wrap_pyfunction!(compression::compress_rows, module)?)?;
    module.add_function(wrap_pyfunction!(compression::compress_triangles, module)?)?;
    module.add_function(wrap_pyfunction!(compression::decompress, module)?)?;
    module.add_function(wrap_pyfunction!(tools::area_scale, module)?)?;
    module.add_function(wrap_pyfunction!(tools::transition, module)?)?;
    module.add_function(wrap_pyfunction!(tools::switch_distance, module)?)
}
