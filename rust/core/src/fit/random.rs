//! Counter-based randomness: a stream of its own for every candidate, so that the result does not depend on which thread
//! tries it.

use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;

/// The finaliser of `SplitMix64` (Steele, Lea, Flood 2014): PCG streams whose seeds and numbers differ by little begin alike without it.
const fn mixed(x: u64) -> u64 {
    let x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// Uniform numbers from one stream.
pub struct Stream(Pcg32);

impl Stream {
    /// The stream of `candidate` in `round`.
    pub fn new(seed: u64, round: usize, candidate: usize) -> Self {
        let stream = ((round as u64) << 32) | candidate as u64;
        Self(Pcg32::new(mixed(seed ^ mixed(stream)), stream))
    }

    /// Uniform in [−1, 1), 32 bits.
    pub fn signed(&mut self) -> f64 {
        f64::from(self.0.next_u32()) / f64::from(1u32 << 31) - 1.0
    }

    /// Uniform in [0, 1), 32 bits.
    pub fn unit(&mut self) -> f64 {
        f64::from(self.0.next_u32()) / f64::from(1u32 << 16) / f64::from(1u32 << 16)
    }

    /// Uniform below `count` (at most 2³²; bias below count/2³²).
    pub fn below(&mut self, count: usize) -> usize {
        ((u64::from(self.0.next_u32()) * count as u64) >> 32) as usize
    }
}
