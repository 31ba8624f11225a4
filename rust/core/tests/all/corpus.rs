//! Replays rust/fuzz/corpus: inputs that the fuzzer kept, and inputs that once broke something.

use std::panic::catch_unwind;
use std::path::PathBuf;

use crate::common::stability::case;

#[test]
fn the_corpus_of_every_target_passes() {
    for (name, run) in crate::common::targets::TARGETS {
        let folder = crate::common::in_repository("rust/fuzz/corpus").join(name);
        let mut files: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        assert!(!files.is_empty(), "{} is empty", folder.display());
        let panics = |file: &PathBuf| {
            println!("{}", file.display());
            catch_unwind(|| run(&std::fs::read(file).unwrap())).is_err()
        };
        let failed = files.iter().filter(|file| panics(file)).count();
        case("Fuzzing", name, "the corpus: no panic, no hang, every promise kept").equals(failed, 0);
    }
}
