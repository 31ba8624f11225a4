//! What nothing beats.

/// Which of the points nothing beats: there is no other with as little or less of both, and less of one. O(n log n).
#[must_use]
pub fn front(points: &[(f64, f64)]) -> Vec<bool> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(points[a].1.total_cmp(&points[b].1)));
    let mut on = vec![false; points.len()];
    let mut last: Option<(f64, f64)> = None;
    for index in order {
        // Ascending in the first: only what falls in the second is on the front, and what is equal in both.
        on[index] = last.is_none_or(|last| points[index].1 < last.1 || points[index] == last);
        if on[index] {
            last = Some(points[index]);
        }
    }
    on
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_pcg::Pcg32;
    use rand_pcg::rand_core::Rng;

    fn beats(a: (f64, f64), b: (f64, f64)) -> bool {
        a.0 <= b.0 && a.1 <= b.1 && a != b
    }

    #[test]
    fn as_by_comparing_all_pairs() {
        let mut random = Pcg32::new(7, 1);
        for count in [0, 1, 2, 3, 17, 100, 400] {
            // Few values, so that many coincide in one or both.
            let mut value = || f64::from(random.next_u32() % 23);
            let points: Vec<(f64, f64)> = (0..count).map(|_| (value(), value())).collect();
            let expected: Vec<bool> = points.iter().map(|&p| !points.iter().any(|&q| beats(q, p))).collect();
            assert_eq!(front(&points), expected);
        }
    }
}
