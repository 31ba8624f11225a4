//! Rectangle packing with maximal free rectangles, in an order that a local search improves.
//!
//! J. Jylänki, *A thousand ways to pack the bin* (2010): the packer keeps all maximal free rectangles and puts each box, rotated or not,
//! into the one where it leaves the least of the shorter side. This greedy choice is not optimal overall. So the search changes the order
//! and the rotations at random in small steps, and keeps a change unless it leaves more area unplaced. An order takes O(n · f), with f free
//! rectangles: about as many as boxes. Known limit: a local search does not find the optimum. docs/bench/packing.md lists the occupancy of
//! pages. (The crate `crunch` does this in one order; it fills less in more time.)

use super::{PageSize, Region};
use crate::random::Stream;

/// Width and height.
pub type BoxSize = (usize, usize);

/// Rotation of a box.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Turn {
    /// Rotated if that fits better.
    Free,
    /// Not rotated.
    No,
    /// Rotated by 90°.
    Yes,
}

/// A box in an order.
#[derive(Clone, Copy)]
struct Next {
    index: usize,
    turn: Turn,
}

/// Returns the place of each box; a rotated box has width and height exchanged. `None` if none of `orders` orders places all boxes.
#[must_use]
pub fn pack(boxes: &[BoxSize], page: PageSize, turning: bool, orders: usize) -> Option<Vec<Region>> {
    let turn = if turning { Turn::Free } else { Turn::No };
    let mut order: Vec<Next> = (0..boxes.len()).map(|index| Next { index, turn }).collect();
    let largest_first = |&Next { index, .. }: &Next| {
        let (width, height) = boxes[index];
        std::cmp::Reverse((width.max(height), width * height))
    };
    order.sort_by_key(largest_first);
    let mut tried = Tried::new(boxes, page);
    let mut left = tried.place(&order);
    let mut stream = Stream::new(0, 0, 0);
    for _ in 1..orders {
        if left == 0 {
            break;
        }
        let mut changed = order.clone();
        change(&mut changed, turning, &mut stream);
        let over = tried.place(&changed);
        if over <= left {
            (order, left) = (changed, over);
        }
    }
    (left == 0).then_some(tried.places)
}

/// Changes an order at random: rotates a box, swaps two boxes, near or far, or moves one.
fn change(order: &mut Vec<Next>, turning: bool, stream: &mut Stream) {
    const NEAR: usize = 8;
    let count = order.len();
    let (one, other) = (stream.below(count), stream.below(count));
    match stream.below(4) {
        0 if turning => order[one].turn = [Turn::Free, Turn::No, Turn::Yes][stream.below(3)],
        1 => order.swap(one, (one + 1 + stream.below(NEAR)).min(count - 1)),
        2 => order.swap(one, other),
        _ => {
            let next = order.remove(one);
            order.insert(other, next);
        }
    }
}

/// The boxes, and the result of the order placed last.
struct Tried<'a> {
    boxes: &'a [BoxSize],
    page: PageSize,
    /// Shortest side of any box: a narrower free rectangle holds none.
    least: usize,
    places: Vec<Region>,
    free: Vec<Region>,
    parts: Vec<Region>,
}

impl<'a> Tried<'a> {
    fn new(boxes: &'a [BoxSize], page: PageSize) -> Self {
        let nowhere = Region { x: 0, y: 0, width: 0, height: 0 };
        let least = boxes.iter().map(|&(width, height)| width.min(height)).min().unwrap_or(0);
        Self { boxes, page, least, places: vec![nowhere; boxes.len()], free: Vec::new(), parts: Vec::new() }
    }

    /// Places all boxes that fit, in this order; returns the area of the others.
    fn place(&mut self, order: &[Next]) -> usize {
        self.free.clear();
        self.free.push(Region { x: 0, y: 0, width: self.page.width, height: self.page.height });
        let mut left = 0;
        for &Next { index, turn } in order {
            let (width, height) = self.boxes[index];
            match self.best(width, height, turn) {
                Some(place) => {
                    self.take(place);
                    self.places[index] = place;
                }
                None => left += width * height,
            }
        }
        left
    }

    /// Returns the place that leaves the least of a free rectangle's shorter side.
    fn best(&self, width: usize, height: usize, turn: Turn) -> Option<Region> {
        let ways = [(turn != Turn::Yes).then_some((width, height)), (turn != Turn::No).then_some((height, width))];
        let mut best: Option<((usize, usize), Region)> = None;
        for (width, height) in ways.into_iter().flatten() {
            for free in &self.free {
                if free.width < width || free.height < height {
                    continue;
                }
                let (across, down) = (free.width - width, free.height - height);
                let over = (across.min(down), across.max(down));
                if best.is_none_or(|(least, _)| over < least) {
                    best = Some((over, Region { width, height, ..*free }));
                }
            }
        }
        best.map(|(_, place)| place)
    }

    /// Cuts the place out of all free rectangles; keeps their remains unless they lie in another free rectangle.
    fn take(&mut self, place: Region) {
        let (right, bottom) = (place.x + place.width, place.y + place.height);
        self.parts.clear();
        let mut number = 0;
        while number < self.free.len() {
            let free = self.free[number];
            let (end, foot) = (free.x + free.width, free.y + free.height);
            if place.x >= end || right <= free.x || place.y >= foot || bottom <= free.y {
                number += 1;
                continue;
            }
            self.free.swap_remove(number);
            if place.x > free.x {
                self.parts.push(Region { width: place.x - free.x, ..free });
            }
            if right < end {
                self.parts.push(Region { x: right, width: end - right, ..free });
            }
            if place.y > free.y {
                self.parts.push(Region { height: place.y - free.y, ..free });
            }
            if bottom < foot {
                self.parts.push(Region { y: bottom, height: foot - bottom, ..free });
            }
        }
        for (number, part) in self.parts.iter().enumerate() {
            let within_other = |(other, whole): (usize, &Region)| {
                other != number && lies_in(part, whole) && (part != whole || other < number)
            };
            let holds_some = part.width.min(part.height) >= self.least;
            if holds_some
                && !self.parts.iter().enumerate().any(within_other)
                && !self.free.iter().any(|whole| lies_in(part, whole))
            {
                self.free.push(*part);
            }
        }
    }
}

fn lies_in(part: &Region, whole: &Region) -> bool {
    part.x >= whole.x
        && part.y >= whole.y
        && part.x + part.width <= whole.x + whole.width
        && part.y + part.height <= whole.y + whole.height
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn page(width: usize, height: usize) -> PageSize {
        PageSize { width, height }
    }

    #[test]
    fn boxes_that_fill_a_page_fit() {
        let places = pack(&[(4, 4), (4, 2), (4, 2)], page(8, 4), false, 1).unwrap();
        assert_eq!(places.iter().map(|p| p.width * p.height).sum::<usize>(), 32);
    }

    #[test]
    fn boxes_are_rotated_only_if_allowed() {
        assert!(pack(&[(8, 2)], page(2, 8), false, 100).is_none());
        let [place] = pack(&[(8, 2)], page(2, 8), true, 1).unwrap()[..] else { panic!("one box") };
        assert_eq!((place.width, place.height), (2, 8));
    }

    #[test]
    fn the_search_packs_what_the_first_order_does_not() {
        // Cut from the page without waste; placing the largest first does not find this packing.
        let parts = [(7, 5), (5, 3), (5, 2), (3, 7), (4, 4), (4, 3), (5, 6), (3, 1), (2, 1)];
        assert_eq!(parts.iter().map(|(width, height)| width * height).sum::<usize>(), 144);
        assert!(pack(&parts, page(12, 12), true, 1).is_none());
        assert!(pack(&parts, page(12, 12), true, 10_000).is_some());
    }

    proptest! {
        #[test]
        fn places_lie_on_the_page_and_apart(
            boxes in prop::collection::vec((1usize..12, 1usize..12), 1..40),
            turning in any::<bool>(),
            orders in 1usize..30,
        ) {
            let side = page(40, 36);
            if let Some(places) = pack(&boxes, side, turning, orders) {
                let mut owners = vec![0u8; side.texels()];
                for (place, &(width, height)) in places.iter().zip(&boxes) {
                    let same = (place.width, place.height) == (width, height);
                    prop_assert!(same || turning && (place.width, place.height) == (height, width));
                    prop_assert!(place.x + place.width <= 40 && place.y + place.height <= 36);
                    for row in place.y..place.y + place.height {
                        for column in place.x..place.x + place.width {
                            owners[row * 40 + column] += 1;
                        }
                    }
                }
                prop_assert!(owners.iter().all(|&count| count <= 1));
            } else {
                let area: usize = boxes.iter().map(|(w, h)| w * h).sum();
                prop_assert!(area > 40 * 36 / 3, "boxes that fill a third always fit: {area}");
            }
        }
    }
}
