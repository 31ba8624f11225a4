//! Helpers for tests and benches.
#![allow(dead_code)] // no test or bench uses all of them

pub mod exact;
pub mod literal;
pub mod promise;
pub mod random;
pub mod soups;
pub mod stability;
pub mod targets;

use std::path::PathBuf;

/// Returns the path of a file or folder in the repository.
pub fn in_repository(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

/// Returns (name, path) of the measured trees found beside the repository.
pub fn trees() -> Vec<(String, PathBuf)> {
    let mut found: Vec<_> = std::fs::read_dir(in_repository("../shared/foliage"))
        .into_iter()
        .flatten()
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "glb"))
        .filter_map(|path| Some((path.file_stem()?.to_str()?.to_owned(), path)))
        .collect();
    found.sort();
    found
}
