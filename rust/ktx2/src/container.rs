//! The KTX 2.0 container (Khronos Group, "KTX File Format Specification", 2.0; data format descriptors: "Khronos Data Format
//! Specification", 1.3).

use crate::{Codes, Error, MipLevel};

const IDENTIFIER: [u8; 12] = [0xAB, b'K', b'T', b'X', b' ', b'2', b'0', 0xBB, b'\r', b'\n', 0x1A, b'\n'];
const HEADER: usize = 80;
const LEVEL_INDEX: usize = 24;

/// Code of the supercompression scheme Zstandard.
const ZSTANDARD: u32 = 2;

/// Compression level of Zstandard; higher levels gain little on UASTC blocks.
const EFFORT: i32 = 9;

/// Returns the file with the blocks of the levels.
///
/// # Errors
/// Zstandard fails, or the file would not fit its 32-bit offsets.
pub fn write(levels: &[MipLevel], blocks: &[Vec<u8>], codes: Codes) -> Result<Vec<u8>, Error> {
    let pack = |blocks: &Vec<u8>| zstd::bulk::compress(blocks, EFFORT).map_err(|e| Error::Encoder(e.to_string()));
    let packed: Vec<Vec<u8>> = blocks.iter().map(pack).collect::<Result<_, _>>()?;
    let descriptor = data_format_descriptor(codes);
    let values = key_values();
    let descriptor_at = HEADER + LEVEL_INDEX * levels.len();
    let values_at = descriptor_at + descriptor.len();
    let data_at = values_at + values.len();

    let mut file = IDENTIFIER.to_vec();
    let number = |value: usize| u32::try_from(value).map_err(|_| Error::Levels("the file is too large".to_owned()));
    // vkFormat undefined, typeSize 1, width, height, depth, layers, faces, levels, scheme; then offsets and sizes of descriptor and values.
    let [width, height] = [number(levels[0].width)?, number(levels[0].height)?];
    let [descriptor_size, values_size] = [number(descriptor.len())?, number(values.len())?];
    let header = [
        0,
        1,
        width,
        height,
        0,
        0,
        1,
        number(levels.len())?,
        ZSTANDARD,
        number(descriptor_at)?,
        descriptor_size,
        number(values_at)?,
        values_size,
    ];
    file.extend(header.iter().flat_map(|word| word.to_le_bytes()));
    // Offset and size of the global supercompression data: none.
    file.extend([0u8; 16]);
    // The smallest level lies first in the file, but the index begins with the largest.
    let place = |number: usize| data_at + packed[number + 1..].iter().map(Vec::len).sum::<usize>();
    for (number, (data, blocks)) in packed.iter().zip(blocks).enumerate() {
        let entry = [place(number), data.len(), blocks.len()];
        file.extend(entry.iter().flat_map(|&value| (value as u64).to_le_bytes()));
    }
    file.extend(descriptor);
    file.extend(values);
    file.extend(packed.into_iter().rev().flatten());
    Ok(file)
}

/// Returns the data format descriptor, one basic block: UASTC with RGBA, 4 × 4 pixels, straight alpha. The bytes per plane are 0, because
/// the levels are supercompressed.
fn data_format_descriptor(codes: Codes) -> Vec<u8> {
    const UASTC: u8 = 166;
    const RGBA: u8 = 3;
    // Data have no primaries; colors have the primaries of BT.709.
    let (primaries, transfer) = match codes {
        Codes::Linear => (0u8, 1u8),
        Codes::Srgb => (1, 2),
    };
    let mut bytes = Vec::with_capacity(44);
    bytes.extend(44u32.to_le_bytes());
    bytes.extend(0u32.to_le_bytes()); // vendor Khronos, type basic
    bytes.extend(2u16.to_le_bytes()); // version 1.3
    bytes.extend(40u16.to_le_bytes());
    bytes.extend([UASTC, primaries, transfer, 0]);
    bytes.extend([3, 3, 0, 0]); // sides of a block, minus 1
    bytes.extend([0u8; 8]);
    // One sample: bit offset 0, 128 bits long, full range.
    bytes.extend(0u16.to_le_bytes());
    bytes.extend([127, RGBA]);
    bytes.extend([0u8; 4]);
    bytes.extend(0u32.to_le_bytes());
    bytes.extend(u32::MAX.to_le_bytes());
    bytes
}

/// Returns the key/value data, sorted by key: orientation (rows from the top, columns from the left) and writer.
fn key_values() -> Vec<u8> {
    let writer = concat!("leafcloud ", env!("CARGO_PKG_VERSION"));
    let mut bytes = Vec::new();
    for (key, value) in [("KTXorientation", "rd"), ("KTXwriter", writer)] {
        let entry: Vec<u8> = [key.as_bytes(), &[0], value.as_bytes(), &[0]].concat();
        bytes.extend(u32::try_from(entry.len()).expect("a few bytes").to_le_bytes());
        bytes.extend(&entry);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    bytes
}
