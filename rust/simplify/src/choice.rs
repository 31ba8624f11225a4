//! Choice of a step for every part: the pictures change little, the triangles are few.
//!
//! Each part has a ladder of steps: the fewer triangles, the larger the change of the pictures. The best steps for a price per triangle
//! lie on the lower convex hull of the ladder, and a higher price takes steps in the order of change per saved triangle (Shoham and Gersho,
//! "Efficient Bit Allocation for an Arbitrary Set of Quantizers", 1988).

use std::cmp::Ordering;

/// The steps of a part on the lower convex hull, from all triangles to none.
pub struct Ladder(Vec<Step>);

#[derive(Clone, Copy, Debug, PartialEq)]
struct Step {
    /// Index among the part's steps.
    index: usize,
    triangles: usize,
    change: u64,
}

/// A move of a part to its next step.
struct Move {
    part: usize,
    to: usize,
    saved: usize,
    change: u64,
}

impl Ladder {
    /// Takes steps as pairs of triangles and change. The first is the whole part, without change.
    pub fn new(steps: impl Iterator<Item = (usize, u64)>) -> Self {
        let mut steps: Vec<Step> =
            steps.enumerate().map(|(index, (triangles, change))| Step { index, triangles, change }).collect();
        steps.sort_by_key(|step| (std::cmp::Reverse(step.triangles), step.change));
        let mut hull: Vec<Step> = Vec::new();
        for step in steps {
            // Of equally many triangles only the first counts, and steps that change less with fewer triangles replace others.
            if hull.last().is_some_and(|last| last.triangles == step.triangles) {
                continue;
            }
            while hull.last().is_some_and(|last| step.change <= last.change)
                || hull.len() > 1 && steeper(&hull[hull.len() - 2..], &step)
            {
                hull.pop();
            }
            hull.push(step);
        }
        Self(hull)
    }

    fn moves(&self, part: usize) -> impl Iterator<Item = Move> + '_ {
        self.0.windows(2).map(move |pair| Move {
            part,
            to: pair[1].index,
            saved: pair[0].triangles - pair[1].triangles,
            change: pair[1].change - pair[0].change,
        })
    }
}

/// Returns whether the step from the first to the second of `last` changes at least as much per triangle as the step from the second to
/// `next`.
fn steeper(last: &[Step], next: &Step) -> bool {
    let gain =
        |a: &Step, b: &Step| Move { part: 0, to: 0, saved: a.triangles - b.triangles, change: b.change - a.change };
    gain(&last[0], &last[1]).cheaper(&gain(&last[1], next)) != Ordering::Less
}

impl Move {
    fn cheaper(&self, other: &Self) -> Ordering {
        let cross = |a: &Self, b: &Self| u128::from(a.change) * b.saved as u128;
        cross(self, other).cmp(&cross(other, self))
    }
}

/// A choice of steps.
pub struct Choice {
    /// Index of the step for each part.
    pub steps: Vec<usize>,
    /// Sum of their changes.
    pub change: u64,
}

/// Chooses a step for each part: the fewest triangles for an `allowed` sum of changes, and at most `most` triangles.
pub fn choose(ladders: &[Ladder], allowed: u64, most: usize) -> Choice {
    let mut moves: Vec<Move> = ladders.iter().enumerate().flat_map(|(part, ladder)| ladder.moves(part)).collect();
    moves.sort_by(Move::cheaper); // Stable: moves of a part stay in order.
    let first = || ladders.iter().map(|ladder| ladder.0[0]);
    let mut triangles: usize = first().map(|step| step.triangles).sum();
    let mut choice =
        Choice { steps: first().map(|step| step.index).collect(), change: first().map(|step| step.change).sum() };
    for next in moves {
        if triangles <= most && choice.change + next.change > allowed {
            break;
        }
        triangles -= next.saved;
        choice.change += next.change;
        choice.steps[next.part] = next.to;
    }
    choice
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(ladders: &[&[(usize, u64)]], allowed: u64, most: usize) -> (Vec<usize>, u64) {
        let ladders: Vec<Ladder> = ladders.iter().map(|steps| Ladder::new(steps.iter().copied())).collect();
        let choice = choose(&ladders, allowed, most);
        (choice.steps, choice.change)
    }

    /// The hull has steps 0, 2 and 3: step 1 changes more for each saved triangle than step 2.
    const ONE: &[(usize, u64)] = &[(10, 0), (8, 6), (4, 6), (0, 30)];

    #[test]
    fn steps_above_the_hull_are_left_out() {
        assert_eq!(chosen(&[ONE], 5, 100), (vec![0], 0));
        assert_eq!(chosen(&[ONE], 6, 100), (vec![2], 6));
        assert_eq!(chosen(&[ONE], 30, 100), (vec![3], 30));
    }

    #[test]
    fn the_cheapest_triangles_go_first() {
        let other: &[(usize, u64)] = &[(10, 0), (0, 11)];
        assert_eq!(chosen(&[ONE, other], 16, 100), (vec![2, 0], 6), "1 and 1.1 for each triangle");
        assert_eq!(chosen(&[ONE, other], 17, 100), (vec![2, 1], 17));
    }

    #[test]
    fn the_limit_of_triangles_comes_before_the_change() {
        assert_eq!(chosen(&[ONE, ONE], 0, 14), (vec![2, 0], 6));
        assert_eq!(chosen(&[ONE, ONE], 0, 0), (vec![3, 3], 60));
    }

    #[test]
    fn what_is_not_seen_costs_nothing() {
        assert_eq!(chosen(&[&[(10, 0), (5, 0), (0, 0)]], 0, 100), (vec![2], 0));
    }
}
