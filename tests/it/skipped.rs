//! Tests that cannot run on this machine: said where they are, and counted at the end of `make test`.

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;
use std::thread;

/// Says that the running test is skipped, and why; `tools/skipped.sh` lists what was.
pub fn skip(reason: &str) {
    println!("skipped: {reason}");
    let list = Path::new(env!("CARGO_TARGET_TMPDIR")).join("skipped.txt");
    let mut file = OpenOptions::new().create(true).append(true).open(list).unwrap();
    let current = thread::current();
    // One write: tests run side by side.
    file.write_all(format!("{reason}\t{}\n", current.name().unwrap_or("a test")).as_bytes()).unwrap();
}
