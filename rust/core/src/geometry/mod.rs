//! Local frame, planes and outlines.

pub mod frame;
pub mod outline;
pub mod plane;

pub use frame::Frame;
pub use outline::{Outline, convex_hull, convex_outline, minimum_rectangle};
pub use plane::{Plane, least_direction};
