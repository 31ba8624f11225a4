//! The random number generator xorshift64*, for tests.

use glam::DVec3;

/// A stream of random numbers; the field is its seed.
pub struct Random(pub u64);

impl Random {
    /// Returns the next 64 bits.
    pub fn next(&mut self) -> u64 {
        // A seed of 0 would stay 0.
        self.0 ^= 0x9E37_79B9_7F4A_7C15 * u64::from(self.0 == 0);
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// Returns an integer below `count`.
    pub fn below(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }

    /// Returns a number in [−1, 1).
    pub fn signed(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Returns a point in the unit ball.
    pub fn in_ball(&mut self) -> DVec3 {
        loop {
            let p = DVec3::new(self.signed(), self.signed(), self.signed());
            if p.length() <= 1.0 {
                return p;
            }
        }
    }
}
