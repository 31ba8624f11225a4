//! A factor as a function of λ.

/// exp(c₁ L + c₂ L²) with L = ln λ: 1 at λ = 1, and everywhere if both coefficients are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trend {
    /// c₁, the linear term.
    pub first: f64,
    /// c₂, the quadratic term.
    pub second: f64,
}

impl Trend {
    /// Returns the trend through the given logarithms of the factor at two different λ in (0, 1).
    #[must_use]
    pub fn through(keeps: [f64; 2], logarithms: [f64; 2]) -> Self {
        let [a, b] = keeps.map(libm::log);
        let [at_a, at_b] = [logarithms[0] / a, logarithms[1] / b];
        let second = (at_b - at_a) / (b - a);
        Self { first: at_a - second * a, second }
    }

    /// Returns the factor at λ = `keep` > 0.
    #[must_use]
    pub fn factor(&self, keep: f64) -> f64 {
        let logarithm = libm::log(keep);
        libm::exp(logarithm * (self.first + self.second * logarithm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_through_the_given_points() {
        let trend = Trend::through([0.3, 0.03], [-0.05, -0.2]);
        assert!((trend.factor(0.3) - (-0.05f64).exp()).abs() < 1e-12);
        assert!((trend.factor(0.03) - (-0.2f64).exp()).abs() < 1e-12);
        assert_eq!(trend.factor(1.0), 1.0);
        assert_eq!(Trend::default().factor(0.01), 1.0);
    }
}
