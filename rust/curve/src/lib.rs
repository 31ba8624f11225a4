//! Cost curves: accuracy of the levels against the time to build them.
//!
//! ```text
//! Foliage ──sweep──▶ Curve ──▶ chart
//!                      └─model──▶ offers ──within──▶ Chain
//! ```
//!
//! A *sweep* builds chains with many settings and measures each: seconds by stage, memory, size of the result, error against the leaves.
//! The *front* is the Pareto front of seconds and error. A *model* predicts both for settings that were not measured. *Offers* are the
//! Pareto front of its predictions. *Within* builds a chain that meets a limit on time or error, or a preset, by building and measuring
//! repeatedly.

pub mod chart;
mod choice;
mod front;
mod memory;
mod model;
mod sweep;
mod text;
mod within;

pub use choice::Choice;
pub use front::front;
pub use model::{Model, Prediction};
pub use sweep::{Curve, Point, Refused, Rest, Stages, Sweep, measure, sweep};
pub use text::{TextPicture, text_picture};
pub use within::{Built, IMAGE_ERROR, Offer, Preset, SECONDS, Wish, build_within, offers};
