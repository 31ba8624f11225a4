//! Files of the encoder, read back by the crate `basisu`, and our reader on whole and broken files.

use basisu::{DecodeFlags, Supercompression, TargetFormat, Transcoder};
use leafcloud_ktx2::{Codes, Error, MipLevel, decode, encode};

/// A leaf-like picture: green discs of several shades on a transparent background.
fn picture(side: usize) -> Vec<[u8; 4]> {
    let pixel = |i: usize| {
        let (x, y) = ((i % side) as f32 / side as f32, (i / side) as f32 / side as f32);
        let (u, v) = ((x * 4.0).fract() - 0.5, (y * 4.0).fract() - 0.5);
        let alpha = ((0.4 - (u * u + v * v).sqrt()) * side as f32 / 4.0 + 0.5).clamp(0.0, 1.0);
        [(40.0 + 60.0 * x) as u8, (110.0 + 60.0 * y) as u8, 30, (alpha * 255.0) as u8]
    };
    (0..side * side).map(pixel).collect()
}

fn chain(side: usize) -> Vec<(usize, Vec<[u8; 4]>)> {
    std::iter::successors(Some(side), |s| (*s > 1).then_some(s / 2)).map(|s| (s, picture(s))).collect()
}

fn levels(chain: &[(usize, Vec<[u8; 4]>)]) -> Vec<MipLevel<'_>> {
    chain.iter().map(|(side, pixels)| MipLevel { width: *side, height: *side, pixels }).collect()
}

#[test]
fn every_level_comes_back() {
    let chain = chain(128);
    for codes in [Codes::Srgb, Codes::Linear] {
        let file = encode(&levels(&chain), codes, &|| true).unwrap();
        let read = Transcoder::new(&file).unwrap();
        assert_eq!((read.level_count(), read.base_dimensions()), (8, (128, 128)));
        assert_eq!(read.supercompression(), Supercompression::Zstandard);
        assert!(read.has_alpha());
        for (number, (side, pixels)) in chain.iter().enumerate() {
            let back = read.transcode(number as u32, TargetFormat::Rgba32, DecodeFlags::NONE).unwrap();
            let back: &[[u8; 4]] = back.as_chunks().0;
            assert_eq!(back.len(), side * side);
            let off: u64 = back.iter().zip(pixels).map(|(a, b)| u64::from(a[3].abs_diff(b[3]))).sum();
            // The smallest levels consist of edges only.
            let most = if *side >= 32 { 2.0 } else { 8.0 };
            assert!((off as f64) < most * (side * side) as f64, "alpha of level {number}: {off} over {side}²");
            let seen = back.iter().zip(pixels).filter(|(_, b)| b[3] == 255);
            let worst = seen.flat_map(|(a, b)| (0..3).map(|i| a[i].abs_diff(b[i]))).max().unwrap_or(0);
            assert!(worst <= 24, "color of level {number} is off by {worst}");
        }
    }
}

#[test]
fn the_header_is_that_of_the_specification() {
    let chain = chain(8);
    let file = encode(&levels(&chain), Codes::Srgb, &|| true).unwrap();
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    assert_eq!(&file[..12], b"\xABKTX 20\xBB\r\n\x1A\n");
    assert_eq!([12, 16, 20, 24, 28, 32, 36, 40, 44].map(word), [0, 1, 8, 8, 0, 0, 1, 4, 2]);
    // The descriptor follows the index of four levels; its color model is UASTC, its primaries BT.709, its transfer sRGB.
    assert_eq!([48, 52].map(word), [80 + 4 * 24, 44]);
    assert_eq!(file[176 + 12..176 + 16], [166, 1, 2, 0]);
    // KHR_texture_basisu: data are linear, and their primaries are unspecified.
    let data = encode(&levels(&chain), Codes::Linear, &|| true).unwrap();
    assert_eq!(data[176 + 12..176 + 16], [166, 0, 1, 0]);
    // Levels lie from the smallest to the largest, without gaps, up to the end of the file.
    let long = |at: usize| u64::from_le_bytes(file[at..at + 8].try_into().unwrap());
    let index: Vec<[u64; 3]> = (0..4).map(|i| [0, 8, 16].map(|field| long(80 + 24 * i + field))).collect();
    for pair in index.windows(2) {
        assert_eq!(pair[1][0] + pair[1][1], pair[0][0]);
    }
    assert_eq!(index[0][0] + index[0][1], file.len() as u64);
    assert_eq!(index.iter().map(|entry| entry[2]).collect::<Vec<_>>(), [4 * 16, 16, 16, 16]);
}

#[test]
fn the_same_pictures_give_the_same_bytes() {
    let chain = chain(64);
    let file = encode(&levels(&chain), Codes::Srgb, &|| true).unwrap();
    assert_eq!(encode(&levels(&chain), Codes::Srgb, &|| true).unwrap(), file);
}

#[test]
fn anything_but_a_mip_chain_is_refused() {
    let (four, two) = (picture(4), picture(2));
    let level = |width: usize, height: usize, pixels| MipLevel { width, height, pixels };
    let message = |levels: &[MipLevel]| match encode(levels, Codes::Srgb, &|| true) {
        Err(Error::Levels(message)) => message,
        other => panic!("{other:?}"),
    };
    assert!(message(&[]).starts_with("there are no levels"));
    assert!(message(&[level(2, 2, &two)]).contains("2 × 2 pixels; both sides must be multiples of 4"));
    assert!(message(&[level(4, 4, &two)]).contains("4 × 4 pixels with data for 4"));
    assert!(message(&[level(4, 4, &four), level(1, 1, &two[..1])]).contains("level 1 has 1 × 1"));
    let one = &two[..1];
    let long = [level(4, 4, &four), level(2, 2, &two), level(1, 1, one), level(1, 1, one)];
    assert!(message(&long).contains("there are 4 levels; the limit for this size is 3"));
}

#[test]
fn the_largest_level_is_decoded() {
    let chain = chain(64);
    let file = encode(&levels(&chain), Codes::Srgb, &|| true).unwrap();
    let read = decode(&file).unwrap();
    assert_eq!((read.width, read.height), (64, 64));
    let (_, pixels) = &chain[0];
    let worst = read.pixels.iter().zip(pixels).filter(|(_, b)| b[3] == 255).map(|(a, b)| a[1].abs_diff(b[1])).max();
    assert!(worst.unwrap() <= 24, "green is off by {worst:?}");
}

#[test]
fn broken_files_are_refused() {
    let file = encode(&levels(&chain(16)), Codes::Srgb, &|| true).unwrap();
    let shorter = (0..file.len()).step_by(7).map(|end| file[..end].to_vec());
    let changed = (0..file.len()).step_by(5).map(|at| {
        let mut other = file.clone();
        other[at] ^= 0x81;
        other
    });
    let refused = |content: &Vec<u8>| matches!(decode(content), Err(Error::File(_)));
    assert!(shorter.into_iter().all(|content| refused(&content)), "a file that ends early");
    let refusals = changed.filter(refused).count();
    assert!(refusals > 10, "only {refusals} changed files are refused");
    let mut wide = file.clone();
    wide[20..24].copy_from_slice(&(1_u32 << 20).to_le_bytes());
    assert!(refused(&wide), "a file wider than the limit");
}
