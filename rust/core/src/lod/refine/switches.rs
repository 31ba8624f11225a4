//! Switches of leaves between planes that can hold them.
//!
//! In each pair of pictures most leaves with a choice take part, each with one other plane. A random half of them is drawn there in the first
//! picture, the rest of them in the second. A leaf switches once its credits over several pairs say so clearly.

use glam::DVec2;
use rayon::prelude::*;

use super::parts::{Parts, Places};
use crate::foliage::Opacity;
use crate::geometry::{Outline, Plane};
use crate::outlines::outlines;
use crate::random::Stream;

/// Most other planes of a part: the nearest ones. More planes have fewer pairs each, and are farther.
const OTHERS: usize = 2;

/// Share of the parts that take part in a pair.
const ACTIVE: f64 = 0.9;

/// Sum of credits over the root of the sum of their squares from which a switch is clear: about standard deviations.
const CLEAR: f64 = 1.5;

/// Least number of credits of a switch.
const LEAST: u32 = 3;

/// Credits of a part on another plane: errors there, less errors at its place.
#[derive(Clone, Copy, Default)]
struct Tally {
    sum: f64,
    squares: f64,
    count: u32,
}

impl Tally {
    fn add(&mut self, worse: f64) {
        *self = Self { sum: self.sum + worse, squares: self.squares + worse * worse, count: self.count + 1 };
    }

    /// Returns how clearly the pictures become worse; negative if they become better.
    fn clearness(&self) -> f64 {
        if self.count < LEAST || self.squares == 0.0 { 0.0 } else { self.sum / self.squares.sqrt() }
    }
}

/// What a part does in a pair of pictures.
#[derive(Clone, Copy, PartialEq)]
pub enum Trial {
    Stays,
    /// It is drawn on another plane (an index into its list), in the first picture or in the second.
    Tries {
        other: usize,
        first: bool,
    },
}

/// The other planes of each part, with what the pictures say of them.
pub struct Switches {
    others: Vec<Vec<u32>>,
    tallies: Vec<[Tally; OTHERS]>,
    seed: u64,
}

impl Switches {
    /// Finds the planes that hold each part within its bounds and within their rectangles, so that no billboard grows.
    pub fn new(parts: &Parts, places: &Places, opacity: &Opacity, seed: u64) -> Self {
        let on_planes = parts.collapsed(&places.planes, &places.parents);
        let outlines = outlines(&places.planes, &parts.spread(&places.parents), |t| on_planes[t], opacity);
        let others = |part: usize| {
            let numbered = (0u32..).zip(places.planes.iter().zip(&outlines));
            let held = numbered.filter(|(number, (plane, outline))| {
                *number != places.parents[part] && parts.hold(plane, part) && covers(plane, outline, parts, part)
            });
            let mut held: Vec<(f64, u32)> =
                held.map(|(number, (plane, _))| (nearness(plane, parts, part), number)).collect();
            held.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            held.into_iter().take(OTHERS).map(|(_, number)| number).collect()
        };
        let others: Vec<Vec<u32>> = (0..parts.len()).into_par_iter().map(others).collect();
        Self { tallies: vec![[Tally::default(); OTHERS]; others.len()], others, seed }
    }

    /// Returns what each part does in a pair.
    pub fn trials(&self, pair: usize) -> Vec<Trial> {
        let trial = |(part, others): (usize, &Vec<u32>)| {
            let mut random = Stream::new(self.seed, pair, part);
            if others.is_empty() || random.unit() >= ACTIVE {
                return Trial::Stays;
            }
            Trial::Tries { other: random.below(others.len()), first: random.unit() < 0.5 }
        };
        self.others.iter().enumerate().map(trial).collect()
    }

    /// Returns the plane of each part in one picture of a pair.
    pub fn parents(&self, places: &Places, trials: &[Trial], in_first: bool) -> Vec<u32> {
        let parent = |(part, trial): (usize, &Trial)| match *trial {
            Trial::Tries { other, first } if first == in_first => self.others[part][other],
            _ => places.parents[part],
        };
        trials.iter().enumerate().map(parent).collect()
    }

    /// Adds the credits of a pair: errors of the first picture, less those of the second.
    pub fn add(&mut self, trials: &[Trial], credits: &[f64]) {
        for ((trial, &credit), tallies) in trials.iter().zip(credits).zip(&mut self.tallies) {
            if let Trial::Tries { other, first } = *trial
                && credit != 0.0
            {
                tallies[other].add(if first { credit } else { -credit });
            }
        }
    }

    /// Moves the parts that clearly look better on another plane. The plane that they leave takes its place in their list.
    pub fn switch(&mut self, places: &mut Places) {
        let parts = self.others.iter_mut().zip(&mut self.tallies).zip(&mut places.parents);
        for ((others, tallies), parent) in parts {
            let clearness = |other: usize| (tallies[other].clearness(), other);
            let best = (0..others.len()).map(clearness).min_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((_, other)) = best.filter(|(clearness, _)| *clearness < -CLEAR) {
                std::mem::swap(parent, &mut others[other]);
                *tallies = [Tally::default(); OTHERS];
            }
        }
    }
}

/// Returns whether a plane's rectangle covers a part.
fn covers(plane: &Plane, outline: &Outline, parts: &Parts, part: usize) -> bool {
    let (x, y) = plane.axes();
    parts.on(*plane, part).into_iter().all(|corner| {
        let place = DVec2::new(x.dot(corner), y.dot(corner));
        let place = DVec2::new(outline.x.dot(place), outline.x.perp().dot(place));
        place.cmpge(outline.low).all() && place.cmple(outline.high).all()
    })
}

/// Returns the sum of squared heights over the plane, relative to the bounds.
fn nearness(plane: &Plane, parts: &Parts, part: usize) -> f64 {
    parts.bounded(part).map(|(corner, bound)| (plane.height(corner) / bound).powi(2)).sum()
}
