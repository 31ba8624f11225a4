//! Broken or hostile glTF: a named error, never a panic, never a byte from outside the document's folder.

use std::path::Path;

use glam::{DVec3, Vec2};
use leafcloud::foliage::Foliage;
use leafcloud::gltf::{DEFAULT_NAMES, parse};
use leafcloud::{Error, Result};

use crate::common::stability::{case, worse};

const GROUP: &str = "Files";

/// A document with one triangle: 36 bytes of positions and three indices of two bytes, in a data URI.
const GOOD: &str = r#"{
  "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
  "nodes": [{"mesh": 0, "name": "leaf"}],
  "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
  "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}}],
  "accessors": [
    {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
    {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}],
  "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
  "buffers": [{"byteLength": 42, "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAABAAIA"}]
}"#;

fn read(text: &str) -> Result<Foliage> {
    parse(text.as_bytes(), Some(Path::new("/nowhere")), &DEFAULT_NAMES)
}

/// Reads the good document with one part replaced.
fn broken(what: &str, by: &str) -> Result<Foliage> {
    assert!(GOOD.contains(what), "{what}");
    read(&GOOD.replacen(what, by, 1))
}

fn refused(name: &'static str, found: Result<Foliage>, naming: &str) {
    case(GROUP, name, "a named error").refuses(found, naming);
}

#[test]
fn the_good_document_is_read() {
    let foliage = read(GOOD).unwrap();
    assert_eq!(foliage.triangle_count(), 1);
}

#[test]
fn matrices_of_nodes() {
    // Column by column: x ↦ −2x, y ↦ 1000 y, z ↦ 0.001 z, sheared and moved. glTF is Y-up, the core Z-up: (x, y, z) ↦ (x, −z, y).
    let matrix = [-2.0, 0.0, 0.5, 0.0, 0.0, 1000.0, 0.0, 0.0, 0.0, 0.0, 0.001, 0.0, 3.0, 4.0, 5.0, 1.0];
    let moved = broken(r#"{"mesh": 0, "#, &format!(r#"{{"mesh": 0, "matrix": {matrix:?}, "#)).unwrap();
    let place = |[x, y, z]: [f64; 3]| {
        let at = |row: usize| matrix[row] * x + matrix[4 + row] * y + matrix[8 + row] * z + matrix[12 + row];
        DVec3::new(at(0), -at(2), at(1))
    };
    let expected = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(place);
    let found = moved.corners(0).map(|p| moved.frame().to_caller(p));
    // Mirroring reverses the winding so that fronts stay fronts; the order of the corners is free.
    let normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a);
    assert!(normal(found).dot(normal(expected)) < 0.0);
    let nearest = |p: DVec3| found.iter().map(|q| p.distance(*q)).fold(f64::INFINITY, f64::min);
    case(
        GROUP,
        "a node's matrix that mirrors, shears and scales by 1 : 10⁶",
        "closed form; entries are rounded to f32",
    )
    .holds(expected.map(nearest).into_iter().fold(0.0, worse), 1000.0 * 2f64.powi(-24));
}

/// The good document with three normals (0, 0, 1) of the glTF, Y up, in a buffer of their own.
fn with_normals() -> String {
    let normals = "AAAAAAAAAAAAAIA/AAAAAAAAAAAAAIA/AAAAAAAAAAAAAIA/";
    let text = GOOD
        .replacen(r#""attributes": {"POSITION": 0}"#, r#""attributes": {"POSITION": 0, "NORMAL": 2}"#, 1)
        .replacen(
            r#""type": "SCALAR"}]"#,
            r#""type": "SCALAR"}, {"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC3"}]"#,
            1,
        )
        .replacen(r#""byteLength": 6}]"#, r#""byteLength": 6}, {"buffer": 1, "byteLength": 36}]"#, 1);
    let end = text.rfind("}]").unwrap();
    format!(
        r#"{}}}, {{"byteLength": 36, "uri": "data:application/octet-stream;base64,{normals}"}}]{}"#,
        &text[..end],
        &text[end + 2..]
    )
}

#[test]
fn normals_and_orm() {
    // Mirrored and stretched nodes transform normals, too.
    let text = with_normals();
    let stretched = r#"{"mesh": 0, "matrix": [-1,0,1,0, 0,1,0,0, 0,0,1,0, 0,0,0,1], "#;
    let foliage = read(&text.replacen(r#"{"mesh": 0, "#, stretched, 1)).unwrap();
    // x ↦ −x + z along, z stays: the inverse transpose takes (0, 0, 1) to (1, 0, 1), Z up (1, −1, 0).
    let expected = DVec3::new(1.0, -1.0, 0.0).normalize();
    let off = foliage.attributes().normals[0].iter().map(|n| n.as_dvec3().distance(expected)).fold(0.0, worse);
    case(GROUP, "normals under a matrix that mirrors and shears", "closed form: the inverse transpose")
        .holds(off, 1e-6);
    let without = read(GOOD).unwrap();
    assert!(without.attributes().normals.is_empty());
    // The default metallic factor of glTF is 1.
    assert_eq!((without.material(0).metallic, without.material(0).roughness), (1.0, 1.0));
    let other_set = r#""metallicRoughnessTexture": {"index": 0, "texCoord": 1}, "baseColorFactor""#;
    let unread = read(&GOOD.replacen(r#""baseColorFactor""#, other_set, 1).replacen(
        r#""buffers""#,
        r#""textures": [{"source": 0}], "images": [{"uri": "a.png"}], "buffers""#,
        1,
    ));
    case(GROUP, "an unreadable metallic-roughness texture means no metal", "definition: a factor of 0")
        .equals(unread.unwrap().material(0).metallic, 0.0);
}

#[test]
fn normals_that_lie() {
    let accessor = r#"{"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC3"}"#;
    let with = |by: &str| {
        let text = with_normals();
        assert!(text.contains(accessor));
        read(&text.replacen(accessor, by, 1))
    };
    let sparse =
        r#""sparse": {"count": 1, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 0}}"#;
    let huge = format!(r#"{{"componentType": 5126, "count": 100000000000, "type": "VEC3", {sparse}}}"#);
    refused("normals without a view, 10¹¹ of them", with(&huge), "2³² − 1");
    let bytes = accessor.replace("5126", "5120");
    refused("normals of bytes", with(&bytes), "NORMAL is Vec3 of I8");
    let beyond = accessor.replace(r#""count""#, r#""byteOffset": 4, "count""#);
    refused("normals beyond their view", with(&beyond), "NORMAL, accessor 2");
}

/// Reads the second corner's texture coordinates if the base color texture uses this set. Set 0 reuses the positions, set 1 the normals.
fn second_uv(set: u32) -> Result<Vec2> {
    let uvs = |view: u32| format!(r#"{{"bufferView": {view}, "componentType": 5126, "count": 3, "type": "VEC2"}}"#);
    let text = with_normals()
        .replacen(r#""NORMAL": 2"#, r#""TEXCOORD_0": 2, "TEXCOORD_1": 3"#, 1)
        .replacen(
            r#"{"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC3"}"#,
            &format!("{}, {}", uvs(0), uvs(2)),
            1,
        )
        .replacen(
            r#""baseColorFactor""#,
            &format!(r#""baseColorTexture": {{"index": 0, "texCoord": {set}}}, "baseColorFactor""#),
            1,
        )
        .replacen(
            r#""buffers""#,
            &format!(r#""textures": [{{"source": 0}}], "images": [{{"uri": "{PIXEL}"}}], "buffers""#),
            1,
        );
    Ok(read(&text)?.attributes().uvs[0][1])
}

/// One opaque red pixel.
const PIXEL: &str = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4z8AAAAMBAQDJ/pLvAAAAAElFTkSuQmCC";

#[test]
fn texture_coordinates_are_those_of_base_colours() {
    // The second pair of the floats 0 0 | 0 1 | 0 0 and 0 0 | 1 0 | 0 1, with v flipped to point up.
    case(GROUP, "a base color with the first set", "literal").equals(second_uv(0).unwrap(), Vec2::new(0.0, 0.0));
    case(GROUP, "a base color with the second set", "literal").equals(second_uv(1).unwrap(), Vec2::new(1.0, 1.0));
}

#[test]
fn accessors_that_lie() {
    refused(
        "more values than bytes",
        broken(r#""count": 3, "type": "VEC3""#, r#""count": 4, "type": "VEC3""#),
        "do not fit",
    );
    refused(
        "a count of 2⁶²",
        broken(r#""count": 3, "type": "VEC3""#, r#""count": 4611686018427387904, "type": "VEC3""#),
        "2³² − 1",
    );
    refused(
        "a count of 2³² − 1",
        broken(r#""count": 3, "type": "VEC3""#, r#""count": 4294967295, "type": "VEC3""#),
        "do not fit",
    );
    refused("a count of 0", broken(r#""count": 3, "type": "VEC3""#, r#""count": 0, "type": "VEC3""#), "POSITION");
    refused("positions of another dimension", broken(r#""type": "VEC3""#, r#""type": "VEC2""#), "glTF does not allow");
    refused(
        "positions of bytes",
        broken(r#""componentType": 5126"#, r#""componentType": 5121"#),
        "glTF does not allow",
    );
    refused("indices of floats", broken(r#""componentType": 5123"#, r#""componentType": 5126"#), "glTF does not allow");
    refused(
        "an offset beyond the view",
        broken(r#"{"bufferView": 1, "#, r#"{"bufferView": 1, "byteOffset": 18446744073709551615, "#),
        "do not fit",
    );
    refused("a view beyond its buffer", broken(r#""byteLength": 36}"#, r#""byteLength": 99}"#), "has fewer");
    refused(
        "a view whose end overflows",
        broken(r#""byteOffset": 36, "byteLength": 6"#, r#""byteOffset": 18446744073709551615, "byteLength": 6"#),
        "has fewer",
    );
    refused(
        "a stride below the size of a value",
        broken(r#""byteOffset": 0, "byteLength": 36"#, r#""byteOffset": 0, "byteLength": 36, "byteStride": 4"#),
        "do not fit",
    );
    refused(
        "an accessor without a view, a count alone",
        broken(
            r#"{"bufferView": 0, "componentType": 5126, "count": 3"#,
            r#"{"componentType": 5126, "count": 4000000000"#,
        ),
        "Missing data",
    );
    refused("an index beyond the vertices", broken("AAABAAIA", "AAABAAcA"), "index 7 is out of range");
    let sparse =
        r#""sparse": {"count": 9, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 0}}, "#;
    refused(
        "more sparse values than values",
        broken(r#"{"bufferView": 0, "#, &format!(r#"{{"bufferView": 0, {sparse}"#)),
        "sparse",
    );
    let falling = sparse.replace(r#""count": 9"#, r#""count": 3"#);
    let mixed = GOOD.replacen("AAABAAIA", "AAACAAEA", 1);
    refused(
        "sparse indices that do not rise",
        read(&mixed.replacen(r#"{"bufferView": 0, "#, &format!(r#"{{"bufferView": 0, {falling}"#), 1)),
        "do not rise",
    );
    let sparse = sparse.replace('9', "2").replace(r#""values": {"bufferView": 0"#, r#""values": {"bufferView": 1"#);
    refused(
        "sparse values beyond their view",
        broken(r#"{"bufferView": 0, "#, &format!(r#"{{"bufferView": 0, {sparse}"#)),
        "do not fit",
    );
}

#[test]
fn documents_that_lie() {
    refused("no JSON", read("{"), "EOF");
    refused("nothing at all", read(""), "");
    refused(
        "a binary header with a length of 0",
        parse(b"glTF\x02\0\0\0\0\0\0\0\x14\0\0\0JSON{}", None, &DEFAULT_NAMES),
        "a length of 0 bytes",
    );
    refused("a cut binary header", parse(b"glTF\x02\0\0\0", None, &DEFAULT_NAMES), "");
    refused(
        "a binary chunk longer than the file",
        parse(b"glTF\x02\0\0\0\x14\0\0\0\xff\xff\xff\x7fJSON", None, &DEFAULT_NAMES),
        "",
    );
    refused("an index to no accessor", broken(r#""POSITION": 0"#, r#""POSITION": 7"#), "accessor");
    refused(
        "a node that is its own child",
        broken(r#"{"mesh": 0, "#, r#"{"mesh": 0, "children": [0], "#),
        "reached twice",
    );
    refused(
        "two nodes that are each other's children",
        broken(
            r#"[{"mesh": 0, "name": "leaf"}]"#,
            r#"[{"mesh": 0, "name": "leaf", "children": [1]}, {"children": [0]}]"#,
        ),
        "reached twice",
    );
    refused(
        "a matrix that flattens everything",
        broken(r#"{"mesh": 0, "#, r#"{"mesh": 0, "matrix": [0,0,0,0, 0,0,0,0, 0,0,0,0, 0,0,0,1], "#),
        "zero area",
    );
    refused("a scale of 10³⁹", broken(r#"{"mesh": 0, "#, r#"{"mesh": 0, "scale": [1e39, 1, 1], "#), "");
    refused("a base color above 1", broken("[0, 1, 0, 1]", "[0, 5, 0, 1]"), "base color");
    refused(
        "a cutoff above 1",
        broken(r#"{"pbrMetallicRoughness""#, r#"{"alphaMode": "MASK", "alphaCutoff": 7, "pbrMetallicRoughness""#),
        "alpha cutoff",
    );
    refused("no foliage by that name", broken("leaf", "rock"), "named like");
    let deep = "[".repeat(100_000);
    refused("JSON a hundred thousand levels deep", broken(r#""asset""#, &format!(r#""extras": {deep}, "asset""#)), "");
}

/// Reads the good document with a base color image at this URI.
fn with_image(uri: &str) -> Result<Foliage> {
    let text = GOOD.replacen(r#""baseColorFactor""#, r#""baseColorTexture": {"index": 0}, "baseColorFactor""#, 1);
    read(&text.replacen(
        r#""buffers""#,
        &format!(r#""textures": [{{"source": 0}}], "images": [{{"uri": "{uri}"}}], "buffers""#),
        1,
    ))
}

/// Returns only the header of a PNG of this size.
fn png_header(width: u32, height: u32) -> String {
    use base64::Engine;
    let mut chunk = b"IHDR".to_vec();
    chunk.extend(width.to_be_bytes());
    chunk.extend(height.to_be_bytes());
    chunk.extend([8, 6, 0, 0, 0]);
    let mut crc = !0u32;
    for byte in &chunk {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 * (crc & 1));
        }
    }
    let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\x0d".to_vec();
    bytes.extend(chunk);
    bytes.extend((!crc).to_be_bytes());
    bytes.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e");
    format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

#[test]
fn uris_that_leave_the_folder() {
    for (name, uri) in [
        ("an image beside the folder", "../secret.png"),
        ("an image by its absolute path", "/etc/passwd"),
        ("an image behind an escape", "%2e%2e/secret.png"),
        ("an image behind an escaped slash", "..%2Fsecret.png"),
        ("an image up and down again", "textures/../../secret.png"),
        ("an image of the file scheme", "file:///etc/passwd"),
        ("an image of a drive", "C:/secret.png"),
        ("an image behind backslashes", "..\\\\secret.png"),
        ("an image of the network", "https://example.com/leaf.png"),
        ("an image without a name", ""),
    ] {
        refused(name, with_image(uri), "leads out of");
    }
    let buffer = GOOD.replacen("data:application/octet-stream;base64,", "../", 1);
    refused("a buffer beside the folder", read(&buffer), "leads out of");
    let inside = with_image("textures/leaf.png");
    let reason = inside.as_ref().err().map(Error::to_string).unwrap_or_default();
    case(GROUP, "an image inside the folder that does not exist", "a named error")
        .refuses(inside, "/nowhere/textures/leaf.png");
    assert!(!reason.contains("leads out"));
    refused(
        "a file named by a document in memory",
        parse(GOOD.replacen("data:application/octet-stream;base64,AAAA", "a.bin", 1).as_bytes(), None, &DEFAULT_NAMES),
        "has no folder",
    );
}

#[test]
fn images_that_lie() {
    let text = GOOD.replacen(r#""baseColorFactor""#, r#""baseColorTexture": {"index": 0}, "baseColorFactor""#, 1);
    let declared = |image: &str| {
        read(&text.replacen(
            r#""buffers""#,
            &format!(r#""textures": [{{"source": 0}}], "images": [{image}], "buffers""#),
            1,
        ))
    };
    refused("an image without a URI or a view", declared("{}"), "image 0 has neither");
    refused("an image in a view, of no type", declared(r#"{"bufferView": 0}"#), "image 0 has neither");
    refused("an image of 2³¹ × 2³¹ pixels in 50 bytes", with_image(&png_header(1 << 31, 1 << 31)), "image 0");
    refused("an image of 60 000 × 60 000 pixels in 50 bytes", with_image(&png_header(60_000, 60_000)), "image 0");
    refused("an image without data", with_image(&png_header(16, 16)), "image 0");
    refused("an image of no size", with_image(&png_header(0, 0)), "image 0");
    refused("an image of unknown format", with_image("data:image/png;base64,AAAA"), "image 0");
    refused("an image that is not base64", with_image("data:image/png;base64,&&&"), "data URI");
}
