//! Ranges of the numbers that a caller may set. Every check reads its range here, and the Python module shows the same ranges to
//! interfaces, so each range stands once.

use std::fmt::{self, Display, Formatter};

use crate::error::{Error, Result, number};

/// Range of a number. Both ends are included; `above` excludes `low`, and `below` excludes `high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Lower end.
    pub low: f64,
    /// Upper end; may be infinite.
    pub high: f64,
    /// Excludes `low`.
    pub above: bool,
    /// Excludes `high`.
    pub below: bool,
}

impl Limits {
    /// All finite numbers above 0.
    pub const POSITIVE: Self = Self { above: true, below: true, ..Self::between(0.0, f64::INFINITY) };

    /// A share of something.
    pub const SHARE: Self = Self::between(0.0, 1.0);

    /// Returns the range from `low` to `high`, with both ends.
    #[must_use]
    pub const fn between(low: f64, high: f64) -> Self {
        Self { low, high, above: false, below: false }
    }

    /// Returns whether the range contains `value`. It never contains NaN.
    #[must_use]
    pub fn hold(&self, value: f64) -> bool {
        let over = if self.above { value > self.low } else { value >= self.low };
        let under = if self.below { value < self.high } else { value <= self.high };
        over && under
    }

    /// Checks `value`, named `name` in the message.
    ///
    /// # Errors
    /// A value outside the range.
    pub fn check(&self, name: &str, value: f64) -> Result<()> {
        if self.hold(value) {
            return Ok(());
        }
        Err(Error::invalid(format!("`{name}` is {}; it must be {self}", number(value))))
    }
}

impl Display for Limits {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (low, high) = (number(self.low), number(self.high));
        if !self.above && !self.below {
            return write!(f, "between {low} and {high}");
        }
        write!(f, "{} {low}", if self.above { "greater than" } else { "at least" })?;
        match self.below {
            _ if self.high.is_infinite() => write!(f, " and finite"),
            true => write!(f, " and less than {high}"),
            false => write!(f, " and at most {high}"),
        }
    }
}

/// ε as a share of R. Below 1e-9, f64 cannot decide whether a triangle lies on its own plane.
pub const EPSILON: Limits = Limits::between(1e-9, 1.0);

/// Planes tried per billboard.
pub const CANDIDATES: Limits = Limits::between(1.0, 1e6);

/// Weight of the angle when a leaf chooses its plane. Costs in f32 must stay finite.
pub const FACING: Limits = Limits::between(0.0, 1e6);

/// Weight of the distance when a leaf chooses its plane.
pub const GATHER: Limits = FACING;

/// Budget of billboards.
pub const MAX_BILLBOARDS: Limits = Limits::between(1.0, 1e7);

/// Extra error allowance, as a share of ε.
pub const EXTRA_ERROR: Limits = Limits::SHARE;

/// Budget of texels.
pub const MAX_TEXELS: Limits = Limits::between(256.0, 1e12);

/// Size limit of billboards, as a share of R. The check of the settings raises the lower end to their ε.
pub const MAX_SIZE: Limits = Limits::between(EPSILON.low, 2.0);

/// Least gap that splits a billboard, as a share of R.
pub const COMPACT: Limits = Limits::between(1e-6, 2.0);

/// Corners of a polygon.
pub const MAX_CORNERS: Limits = Limits::between(4.0, 16.0);

/// Visible share of a leaf below which it is left out of the levels.
pub const MIN_VISIBILITY: Limits = Limits::between(0.0, 0.1);

/// Budget of triangles.
pub const TRIANGLES: Limits = Limits::between(8.0, 1e7);

/// Penalty of the density method.
pub const PENALTY: Limits = Limits::between(0.0, 100.0);

/// Number of preferred directions.
pub const VIEWS: Limits = Limits::between(0.0, 64.0);

/// Score penalty for planes that face none of the preferred directions.
pub const FACING_VIEWS: Limits = Limits::SHARE;

/// Score penalty for horizontal planes.
pub const VERTICAL: Limits = Limits::SHARE;

/// Angular error in radians.
pub const IMAGE_EPSILON: Limits = EPSILON;

/// Distance of the viewer as a share of R: outside the bounding sphere.
pub const VIEWING_DISTANCE: Limits = Limits::between(1.0 + EPSILON.low, 1e6);

/// Seed of the random numbers: every u64.
pub const SEED: Limits = Limits::between(0.0, u64::MAX as f64);

/// Number of clouds. With 0, the cross impostor is the only level.
pub const LEVELS: Limits = Limits::between(0.0, 8.0);

/// Upright planes of the cross impostor.
pub const UPRIGHT_PLANES: Limits = Limits::between(2.0, 5.0);

/// Side of an atlas page in texels.
pub const ATLAS_SIDE: Limits = Limits::between(16.0, 16_384.0);

/// Side of the atlas page of level 1 in texels. No later level has a smaller page.
pub const TEXTURE_SIZE: Limits = Limits::between(64.0, ATLAS_SIDE.high);

/// Samples along each side of a texel or pixel.
pub const SAMPLES: Limits = Limits::between(1.0, 16.0);

/// Share by which normals bend toward the hull.
pub const NORMALS: Limits = Limits::SHARE;

/// Deviation in pixels where a level takes over.
pub const PIXELS: Limits = Limits::POSITIVE;

/// λ where level 1 takes over.
pub const KEEP: Limits = Limits { above: true, ..Limits::SHARE };

/// Length of a leaf in pixels where pruning begins.
pub const LEAF_PIXELS: Limits = Limits::POSITIVE;

/// h of the law of λ.
pub const PRUNE_HALF: Limits = Limits { above: true, ..Limits::between(0.0, 0.5) };

/// Number of view directions of a measurement.
pub const VIEW_COUNT: Limits = Limits::between(1.0, 64.0);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_included_unless_they_are_excluded() {
        assert!(CANDIDATES.hold(1.0) && CANDIDATES.hold(1e6) && !CANDIDATES.hold(0.0) && !CANDIDATES.hold(1e6 + 1.0));
        assert!(!KEEP.hold(0.0) && KEEP.hold(1.0) && !KEEP.hold(f64::NAN));
        assert!(!PIXELS.hold(0.0) && PIXELS.hold(f64::MAX) && !PIXELS.hold(f64::INFINITY));
    }

    #[test]
    fn messages_name_the_setting_its_value_and_its_limit() {
        let said = |limits: Limits, value| limits.check("x", value).unwrap_err().to_string();
        assert_eq!(said(SAMPLES, 17.0), "`x` is 17; it must be between 1 and 16");
        assert_eq!(said(PIXELS, f64::NAN), "`x` is NaN; it must be greater than 0 and finite");
        assert_eq!(said(PRUNE_HALF, 0.6), "`x` is 0.6; it must be greater than 0 and at most 0.5");
        let open = Limits { below: true, ..KEEP };
        assert_eq!(said(open, 1.0), "`x` is 1; it must be greater than 0 and less than 1");
    }
}
