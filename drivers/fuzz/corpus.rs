//! Walks a fuzzer's corpus: for the ordinary tests that try again what is in it, of `drivers/fuzz` and of `tests/fuzz`.

use std::fs;
use std::path::Path;

use rustix::process::{Resource, Rlimit, setrlimit};

use super::targets::Target;

/// What the process may have mapped meanwhile, its program and stacks among it: room that an input only claims to need ends it.
const MOST_BYTES: u64 = 1 << 30;

/// Gives each input of each target's corpus, with the target, to `again`. Every program of the fuzzer must be among the targets, and have a corpus.
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
