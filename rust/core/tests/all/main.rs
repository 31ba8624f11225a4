//! The core's integration tests, in one binary: each binary takes half a minute to link.

#[path = "../common/mod.rs"]
mod common;

mod blend_order;
mod corpus;
mod fit;
mod hard;
mod leaf_map;
mod trees;
