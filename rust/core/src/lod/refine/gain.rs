//! The gain of a refinement: errors of pictures in test views, which no step uses, at several sizes. Sizes count alike: the gain is the mean of the
//! ratios.

/// Errors by the side of the pictures in pixels, or by the number of the mip level.
pub type Errors = Vec<(usize, f64)>;

/// Errors relative to those before the refinement.
pub struct Gain {
    pub errors: Errors,
}

impl Gain {
    /// Returns the gain of no change.
    pub fn none(first: &Errors) -> Self {
        Self { errors: first.iter().map(|(size, _)| (*size, 1.0)).collect() }
    }

    pub fn over(first: &Errors, now: &Errors) -> Self {
        let ratio = |(&(size, before), &(_, after)): (&(usize, f64), &(usize, f64))| {
            (size, if before > 0.0 { after / before } else { 1.0 + after })
        };
        Self { errors: first.iter().zip(now).map(ratio).collect() }
    }

    /// Returns whether no size is worse than before the refinement, and all together are better than in another try.
    pub fn is_better_than(&self, other: &Self) -> bool {
        self.errors.iter().all(|(_, ratio)| *ratio <= 1.0) && self.mean() < other.mean()
    }

    /// Returns the mean over the sizes.
    pub fn mean(&self) -> f64 {
        self.errors.iter().map(|(_, ratio)| ratio).sum::<f64>() / self.errors.len() as f64
    }
}
