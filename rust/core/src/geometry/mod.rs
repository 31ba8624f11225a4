//! Local frame, the tree's placement in the world, planes and outlines.

pub mod frame;
pub mod outline;
pub mod placement;
pub mod plane;

pub use frame::Frame;
pub use outline::{Outline, convex_hull, minimum_rectangle};
pub use placement::Placement;
pub use plane::{Plane, least_direction};
