//! Replays rust/fuzz/corpus: inputs that the fuzzer kept, and inputs that once broke something.

mod common;

use common::stability::case;

#[test]
fn the_corpus_of_every_target_passes() {
    for (name, run) in common::targets::TARGETS {
        let folder = common::in_repository("rust/fuzz/corpus").join(name);
        let mut files: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        assert!(!files.is_empty(), "{} is empty", folder.display());
        for file in files {
            println!("{}", file.display());
            run(&std::fs::read(file).unwrap());
        }
        // A panic ends the test, so a recorded case has passed.
        case("Fuzzing", name, "the corpus: no panic, no hang, every promise kept").holds(0.0, 0.0);
    }
}
