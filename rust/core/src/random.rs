//! Counter-based random numbers: each candidate has its own stream, so results do not depend on the thread that
//! tries it.

use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;

/// Applies the finalizer of `SplitMix64` (Steele, Lea, Flood 2014): without it, PCG streams with similar seeds and numbers begin alike.
const fn mixed(x: u64) -> u64 {
    let x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

/// A stream of uniform random numbers.
pub struct Stream(Pcg32);

impl Stream {
    /// Returns the stream of `candidate` in `round`.
    pub fn new(seed: u64, round: usize, candidate: usize) -> Self {
        let stream = ((round as u64) << 32) | candidate as u64;
        Self(Pcg32::new(mixed(seed ^ mixed(stream)), stream))
    }

    /// Returns a uniform number in [−1, 1), with 32 bits.
    pub fn signed(&mut self) -> f64 {
        f64::from(self.0.next_u32()) / f64::from(1u32 << 31) - 1.0
    }

    /// Returns a uniform number in [0, 1), with 32 bits.
    pub fn unit(&mut self) -> f64 {
        f64::from(self.0.next_u32()) / f64::from(1u32 << 16) / f64::from(1u32 << 16)
    }

    /// Returns a uniform integer below `count` (at most 2³²; bias below count/2³²).
    pub fn below(&mut self, count: usize) -> usize {
        ((u64::from(self.0.next_u32()) * count as u64) >> 32) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_independent() {
        // The first numbers of neighboring seeds and candidates must differ.
        let first = |seed: u64, candidate: usize| Stream::new(seed, 0, candidate).signed();
        for candidate in 1..1000 {
            for other in 1..4 {
                assert!((first(other, candidate - 1) - first(0, candidate)).abs() > 1e-7);
            }
        }
    }
}
