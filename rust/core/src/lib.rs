//! Leafcloud: levels of detail for foliage that do not pop.
//!
//! The crate is a pipeline of values; each stage depends only on the stages before it:
//!
//! ```text
//! Foliage ──fit──▶ Cloud ──project──▶ Projection ──pack──▶ Atlas ──bake──▶ Textures
//!    ▲                                                        │               │
//!    └──────────────── lod: the billboards as foliage again, coarser ◀────────┘
//! ```
//!
//! Results are deterministic: the same input, settings and seed give the same bytes with any number of
//! threads and on any machine. Random numbers are counter-based (one stream per candidate), reductions have a fixed
//! order, and transcendental functions come from `libm`, not from the platform.

pub mod atlas;
pub mod blend_order;
pub mod cloud;
mod color;
pub mod error;
pub mod fit;
pub mod foliage;
pub mod geometry;
pub mod gltf;
pub mod groups;
pub mod limits;
pub mod lod;
pub mod metrics;
pub mod outlines;
pub mod polygons;
pub mod progress;
pub mod prune;
mod random;
pub mod sums;
pub mod textures;
pub mod transition;

pub use cloud::Cloud;
pub use error::{Error, Result};
pub use foliage::{AlphaMode, Attributes, Foliage, Image, Material};
pub use progress::Progress;

/// Helpers that unit tests share with the integration tests.
#[cfg(test)]
#[path = "../tests/common"]
#[allow(dead_code)] // no test binary uses all of it
mod common {
    pub mod exact;
    pub mod random;
    pub mod stability;
}
