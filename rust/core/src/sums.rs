//! Compensated sums (Neumaier 1974): the rounding error of each addition is summed separately and added at the end.
//!
//! Error bound: |found − exact| ≤ u |exact| + 4 n² u² Σ|x|, u = 2⁻⁵³. For numbers of one sign and n up to 10⁷, the second term is 10⁻¹⁷ of
//! the sum, so the result is the exact sum, rounded. Plain addition loses up to n·u: seven digits of sixteen.

/// A running sum.
#[derive(Clone, Copy, Debug, Default)]
pub struct Total {
    sum: f64,
    rounded_away: f64,
}

impl Total {
    /// Adds a number.
    pub fn add(&mut self, x: f64) {
        let sum = self.sum + x;
        self.rounded_away += if self.sum.abs() >= x.abs() { (self.sum - sum) + x } else { (x - sum) + self.sum };
        self.sum = sum;
    }

    /// Returns the sum so far.
    #[must_use]
    pub fn get(self) -> f64 {
        self.sum + self.rounded_away
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_plain_addition_loses() {
        let mut total = Total::default();
        for x in [1.0, 1e100, 1.0, -1e100] {
            total.add(x);
        }
        assert_eq!(total.get(), 2.0);
        let (mut tenths, mut plain) = (Total::default(), 0.0);
        for _ in 0..1_000_000 {
            tenths.add(0.1);
            plain += 0.1;
        }
        // The f64 nearest to 0.1, times a million, is 100 000.000 000 000 005 6; the nearest f64 is 100 000.
        assert_eq!(tenths.get(), 100_000.0);
        assert_ne!(plain, 100_000.0);
    }
}
