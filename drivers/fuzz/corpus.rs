//! Walks a fuzzer's corpus, so that ordinary tests repeat its inputs, of `drivers/fuzz` and of
//! `tests/fuzz`.

use std::fs;
use std::path::Path;

use rustix::process::{Resource, Rlimit, setrlimit};

use super::targets::Target;

/// Limit on the process's mapped memory, including program and stacks. An input that causes
/// allocation of a merely claimed size ends the process.
const MOST_BYTES: u64 = 1 << 30;

/// Passes each input of each target's corpus, with the target, to `again`. Every fuzz program
/// must be among the targets, and have a corpus.
pub(crate) fn each(fuzz: &Path, targets: &[(&str, Target)], again: impl Fn(Target, &[u8])) {
    setrlimit(Resource::As, Rlimit { current: Some(MOST_BYTES), maximum: None }).unwrap();
    for (name, target) in targets {
        assert!(fuzz.join(format!("fuzz_targets/{name}.rs")).is_file(), "{name} is no target of the fuzzer");
        let mut tried = 0;
        for entry in fs::read_dir(fuzz.join("corpus").join(name)).unwrap() {
            again(*target, &fs::read(entry.unwrap().path()).unwrap());
            tried += 1;
        }
        assert!(tried > 0, "{name} has no corpus");
    }
    assert_eq!(fs::read_dir(fuzz.join("fuzz_targets")).unwrap().count(), targets.len());
}
