//! The local frame, planes and outlines.

pub mod frame;
pub mod outline;
pub mod plane;

pub use frame::Frame;
pub use outline::{Outline, minimum_rectangle};
pub use plane::Plane;
