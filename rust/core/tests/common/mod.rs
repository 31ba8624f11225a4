//! What tests and benches share.
#![allow(dead_code)] // none of them uses everything

pub mod exact;
pub mod literal;
pub mod promise;
pub mod random;
pub mod soups;
pub mod stability;
pub mod targets;

use std::path::PathBuf;

/// A file or folder of the repository.
pub fn in_repository(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

/// The measured trees beside the repository, as far as they are there; (name, path).
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
