//! glTF reading without Blender: foliage for benchmarks, tests and programs.

mod accessors;
mod read;
mod source;

pub use read::{DEFAULT_NAMES, parse, read};
