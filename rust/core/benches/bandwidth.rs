//! Measurement of memory bandwidth, as a reference for the benches.

use std::hint::black_box;
use std::time::Instant;

/// Returns the bytes per second that a copy of 128 MiB reads and writes on one core, the best of three.
pub fn bandwidth() -> f64 {
    const WORDS: usize = 1 << 24;
    let source = vec![1u64; WORDS];
    let mut target = vec![0u64; WORDS];
    let copy = |_| {
        let started = Instant::now();
        target.copy_from_slice(black_box(&source));
        started.elapsed().as_secs_f64()
    };
    let seconds = (0..3).map(copy).fold(f64::INFINITY, f64::min);
    black_box(&target);
    16.0 * WORDS as f64 / seconds
}
