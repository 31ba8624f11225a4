//! Decides: whether a level looks like its leaves, where levels take over, and which levels a scene needs.

pub mod looks;
pub mod sway;
pub mod yardstick;

pub use looks::Looks;
pub use yardstick::{Judgement, Yardstick};
