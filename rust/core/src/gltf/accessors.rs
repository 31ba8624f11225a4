//! Validation of accessors: allowed types, and values inside their buffers.
//!
//! The crate `gltf` checks that indices refer to existing entries. It trusts types, counts and offsets; wrong ones make it panic
//! or read wrong bytes. So they are checked here first.

use gltf::accessor::{DataType, Dimensions};
use gltf::{Accessor, Semantic};

use super::source::Source;

/// Checks that the attributes of all primitives refer to existing accessors, and that all images have a location. The crate `gltf` reads
/// positions before it checks that they exist, and expects an image's URI or type.
///
/// # Errors
/// Describes the first missing reference.
pub fn check_references(root: &gltf::json::Root) -> Result<(), String> {
    let count = root.accessors.len();
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let missing = primitives.flat_map(|p| p.attributes.values()).find(|accessor| accessor.value() >= count);
    if let Some(accessor) = missing {
        return Err(format!("an attribute refers to accessor {}; there are {count}", accessor.value()));
    }
    let lost =
        root.images.iter().position(|i| if i.buffer_view.is_some() { i.mime_type.is_none() } else { i.uri.is_none() });
    lost.map_or(Ok(()), |image| Err(format!("image {image} has neither a URI nor a buffer view with its type")))
}

/// Checks all accessors that will be read of a primitive, with the UV set `set`.
///
/// # Errors
/// Describes the first accessor that cannot be read.
pub fn check(primitive: &gltf::Primitive, set: u32, source: &Source) -> Result<(), String> {
    use DataType::{F32, U8, U16, U32};
    use Dimensions::{Scalar, Vec2, Vec3, Vec4};
    let indices = primitive.indices().map(|a| ("the indices".to_owned(), a, &[Scalar][..], &[U8, U16, U32][..]));
    let attributes = primitive.attributes().filter_map(|(semantic, accessor)| {
        let (dimensions, types): (&[Dimensions], &[DataType]) = match semantic {
            Semantic::Positions | Semantic::Normals => (&[Vec3], &[F32]),
            Semantic::TexCoords(number) if number == set => (&[Vec2], &[F32, U8, U16]),
            Semantic::Colors(0) => (&[Vec3, Vec4], &[F32, U8, U16]),
            _ => return None,
        };
        Some((semantic.to_string(), accessor, dimensions, types))
    });
    for (what, accessor, dimensions, types) in indices.into_iter().chain(attributes) {
        if !dimensions.contains(&accessor.dimensions()) || !types.contains(&accessor.data_type()) {
            let (dimensions, data_type) = (accessor.dimensions(), accessor.data_type());
            return Err(format!("{what} is {dimensions:?} of {data_type:?}, which glTF does not allow"));
        }
        fits(&accessor, source).map_err(|reason| format!("{what}, accessor {}: {reason}", accessor.index()))?;
    }
    Ok(())
}

/// Checks that all values of an accessor lie inside their buffer views.
fn fits(accessor: &Accessor, source: &Source) -> Result<(), String> {
    let count = accessor.count();
    if u32::try_from(count).is_err() || count == 0 {
        return Err(format!("{count} values; there must be from 1 to 2³² − 1"));
    }
    match accessor.view() {
        Some(view) => inside(&view, accessor.offset(), count, accessor.size(), source)?,
        // The specification reads these as zeros. No exporter writes such geometry, and a bare count could request any amount of memory.
        None => return Err("no buffer view; store its values".to_owned()),
    }
    let Some(sparse) = accessor.sparse() else { return Ok(()) };
    if sparse.count() == 0 || sparse.count() > count {
        return Err(format!("{} sparse values of {count}", sparse.count()));
    }
    let (indices, values) = (sparse.indices(), sparse.values());
    let size = indices.index_type().size();
    inside(&indices.view(), indices.offset(), sparse.count(), size, source)?;
    let (view, stride) = (source.view(&indices.view())?, indices.view().stride().unwrap_or(size));
    let index = |i: usize| {
        let bytes = &view[indices.offset() + i * stride..][..size];
        bytes.iter().rev().fold(0usize, |number, &byte| number << 8 | usize::from(byte))
    };
    let rising = (1..sparse.count()).all(|i| index(i - 1) < index(i));
    if !rising || index(sparse.count() - 1) >= count {
        return Err(format!("sparse indices do not rise, or reach {count}; they must rise and stay below it"));
    }
    inside(&values.view(), values.offset(), sparse.count(), accessor.size(), source)
}

/// Checks that `count` values of `size` bytes from `offset` lie inside a view, and the view inside its buffer.
fn inside(view: &gltf::buffer::View, offset: usize, count: usize, size: usize, source: &Source) -> Result<(), String> {
    let bytes = source.view(view)?.len();
    let stride = view.stride().unwrap_or(size);
    let end = stride.checked_mul(count - 1).and_then(|last| last.checked_add(offset)?.checked_add(size));
    if stride >= size && end.is_some_and(|end| end <= bytes) {
        return Ok(());
    }
    Err(format!(
        "{count} values of {size} bytes, {stride} apart, from {offset} do not fit into a view of {bytes} bytes"
    ))
}
