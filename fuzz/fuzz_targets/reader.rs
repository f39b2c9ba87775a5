//! One reader, that of the target's name, against whatever libFuzzer finds. A typed error is an answer; a panic, a hang or memory without
//! bound is not.
#![no_main]

use std::sync::LazyLock;

use grimace::internal::fuzzing::{Target, target};

static READER: LazyLock<&Target> = LazyLock::new(|| target(env!("CARGO_BIN_NAME")).expect("a reader of the target's name"));

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = READER.read(bytes);
});
