//! Simplification of leaves and trunks.
//!
//! [`simplify`] makes the trunks of levels with the crate `meshopt`, judged by their pictures; [`unrolled`] prepares their texture coordinates. [`simplified_leaves`] makes leaves of fewer triangles, each corner of
//! which stays within a bound.

mod choice;
mod collapse;
mod leaves;
mod nearest;
mod part;
mod picture;
mod trunk;
mod unroll;
mod vertices;

pub use leaves::{SimplifiedLeaves, simplified_leaves};
pub use trunk::{Sight, Simplified, simplify};
pub use unroll::unrolled;
