//! What accuracy costs in time.
//!
//! ```text
//! Foliage ──sweep──▶ Curve ──▶ chart
//!                      └─model──▶ offers ──within──▶ Chain
//! ```
//!
//! A *sweep* builds chains with many settings and measures each: seconds by stage, memory, what came out, how far it is from the leaves. The
//! *front* is what nothing beats in both seconds and error. A *model* predicts both for settings that were not measured;
//! *offers* are the front of what it predicts, and *within* builds a chain that keeps a wish, by building and looking again.

pub mod chart;
mod choice;
mod front;
mod memory;
mod model;
mod sweep;
mod within;

pub use choice::Choice;
pub use front::front;
pub use model::{Model, Prediction};
pub use sweep::{Curve, Point, Refused, Rest, Stages, Sweep, measure, sweep};
pub use within::{Built, Offer, Preset, Wish, build_within, offers};
