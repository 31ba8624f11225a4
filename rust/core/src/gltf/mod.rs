//! glTF without Blender: foliage for benches, tests and programs that have none.

mod accessors;
mod read;
mod source;

pub use read::{DEFAULT_NAMES, parse, read};
