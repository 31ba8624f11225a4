//! Pareto front of points with two costs.

/// Returns, for each point, whether it is on the Pareto front: no other point is at most equal in both costs and less in one. O(n log n).
#[must_use]
pub fn front(points: &[(f64, f64)]) -> Vec<bool> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(points[a].1.total_cmp(&points[b].1)));
    let mut on = vec![false; points.len()];
    let mut last: Option<(f64, f64)> = None;
    for index in order {
        // The first cost ascends: a point is on the front if its second cost is the lowest so far, or if it equals the last one in both.
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
    fn the_front_is_that_of_comparing_all_pairs() {
        let mut random = Pcg32::new(7, 1);
        for count in [0, 1, 2, 3, 17, 100, 400] {
            // Few values, so that many points coincide in one cost or both.
            let mut value = || f64::from(random.next_u32() % 23);
            let points: Vec<(f64, f64)> = (0..count).map(|_| (value(), value())).collect();
            let expected: Vec<bool> = points.iter().map(|&p| !points.iter().any(|&q| beats(q, p))).collect();
            assert_eq!(front(&points), expected);
        }
    }
}
