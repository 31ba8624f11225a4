//! Counter-based randomness: a stream of its own for every candidate, so that the result does not depend on which thread
//! tries it.

use glam::DVec3;
use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;

/// Uniform numbers from one stream.
pub struct Stream(Pcg32);

impl Stream {
    /// The stream of `candidate` in `round`.
    pub fn new(seed: u64, round: usize, candidate: usize) -> Self {
        Self(Pcg32::new(seed, ((round as u64) << 32) | candidate as u64))
    }

    /// Uniform in [−1, 1), 32 bits.
    pub fn signed(&mut self) -> f64 {
        f64::from(self.0.next_u32()) / f64::from(1u32 << 31) - 1.0
    }

    /// Uniform in the cube [−1, 1)³.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.signed(), self.signed(), self.signed())
    }

    /// Uniform below `count` (at most 2³²; bias below count/2³²).
    pub fn below(&mut self, count: usize) -> usize {
        ((u64::from(self.0.next_u32()) * count as u64) >> 32) as usize
    }
}
