//! glTF without Blender: foliage for benches, tests and programs that have none.

mod read;

pub use read::{DEFAULT_NAMES, read};
