//! Search for the smallest ε within a budget.
//!
//! Counts fall with ε roughly as a power (billboards as ε^−1.6 on trees). The next ε follows from that power, and stays between the ε that
//! were too small and those that were enough; the interval closes geometrically. Counts are not quite monotone, by a few per cent, so
//! the result keeps the budget and is the smallest ε among those tried, not the smallest possible.

use crate::error::{Error, Result};

/// Greatest number of fits.
pub const TRIES: usize = 9;

/// Growth of the step for each fit that leaves the count unchanged.
const LONGER: f64 = 8.0;

/// The search ends if ε is within this ratio of an ε that is too small.
const CLOSE: f64 = 1.005;

/// Finds the smallest ε in [`least`, 1] that needs at most `limit`. `fit` receives ε and the number of the attempt; it returns its result
/// and the need. Returns the result at the smallest ε found, or `None` if none is enough. The need falls as ε to the power −`power`.
pub fn smallest<T>(
    limit: f64,
    power: f64,
    start: f64,
    least: f64,
    mut fit: impl FnMut(f64, usize) -> Result<(T, f64)>,
) -> Result<Option<T>> {
    let (mut too_small, mut best): (f64, Option<(f64, T)>) = (0.0, None);
    // Number of fits with an unchanged need although ε fell. The power gives no step there, so the next step is longer.
    let (mut before, mut stalled) = (f64::NAN, 0);
    let mut epsilon = start.clamp(least, 1.0);
    for attempt in 0..TRIES {
        let (found, need) = fit(epsilon, attempt)?;
        stalled = if need == before { stalled + 1 } else { 0 };
        before = need;
        let farther = libm::pow(LONGER, f64::from(stalled));
        let step = libm::pow(need.max(1e-9) / limit, 1.0 / power);
        let guess = epsilon * if need > limit { step * farther } else { step / farther };
        if need <= limit {
            let enough = epsilon <= least || epsilon / too_small < CLOSE;
            best = Some((epsilon, found));
            if enough {
                break;
            }
        } else {
            too_small = too_small.max(epsilon);
            if epsilon >= 1.0 {
                break;
            }
        }
        epsilon = match &best {
            // Stay within the known interval, and away from its ends.
            Some((enough, _)) if too_small > 0.0 => {
                let ratio = enough / too_small;
                if ratio < CLOSE {
                    break;
                }
                guess.clamp(too_small * libm::pow(ratio, 0.2), enough / libm::pow(ratio, 0.2))
            }
            Some((enough, _)) => guess.clamp(enough / (4.0 * farther), enough / 1.05).max(least),
            None => guess.clamp(too_small * 1.05, too_small * 8.0 * farther).min(1.0),
        };
    }
    Ok(best.map(|(_, found)| found))
}

/// Makes the error for a budget that no ε reaches.
pub fn out_of_reach(name: &str, limit: usize) -> Error {
    Error::invalid(format!("`{name}` is {limit}, which no `epsilon` up to 1 was found to reach; raise it"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_that_is_enough() {
        // 1/ε² steps: 100 at 0.1.
        let found = smallest(100.0, 1.6, 0.04, 1e-6, |e, _| Ok((e, (1.0 / (e * e)).floor()))).unwrap().unwrap();
        assert!((0.0995..=0.102).contains(&found), "{found}");
    }

    #[test]
    fn a_need_that_never_grows_leads_to_the_least() {
        assert_eq!(smallest(3.0, 1.6, 0.04, 1e-9, |e, _| Ok((e, 1.0))).unwrap(), Some(1e-9));
    }

    #[test]
    fn a_need_that_is_long_the_same_is_left_behind() {
        let found =
            smallest(100.0, 1.6, 1e-5, 1e-9, |e, _| Ok((e, if e < 0.01 { 5000.0 } else { 1.0 / e }))).unwrap().unwrap();
        assert!((0.01..=0.02).contains(&found), "{found}");
    }

    #[test]
    fn nothing_is_enough() {
        assert!(smallest(0.5, 1.6, 0.04, 1e-6, |e, _| Ok((e, 1.0))).unwrap().is_none());
    }

    #[test]
    fn not_below_the_least() {
        assert_eq!(smallest(10.0, 1.0, 0.04, 0.04, |e, _| Ok((e, 1.0))).unwrap(), Some(0.04));
    }
}
