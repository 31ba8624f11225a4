//! Decides: whether a level looks like its leaves, where levels take over, and which levels a scene needs.
//!
//! ```text
//! leaves ──sway──▶ control ──yardstick──▶ q allows ε ──clouds──▶ chain ──yardstick──▶ sizes
//! ```

mod chain;
mod clouds;
mod costs;
mod fewer;
mod last;
mod leaves;
pub mod looks;
mod scene;
mod search;
mod settle;
pub mod sway;
mod twigs;
mod walk;
mod wishes;
pub mod yardstick;

pub use chain::{Chosen, Wanted};
pub use clouds::TriedEpsilon;
pub use last::{Last, check_last};
pub use leaves::{Form, LeafLevel, leaf_level};
pub use looks::Looks;
pub use scene::{HORIZON, PIXELS_BY_DISTANCE, Scene};
pub use wishes::{LARGEST_CROWN, LATER_CROWN, MEMORY, QUALITY, SIZE, Wishes};
pub use yardstick::{Judgement, Passed, Subject, Yardstick};
