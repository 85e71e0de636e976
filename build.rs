//! Names the commit that the program is built from.

#![allow(clippy::print_stdout, reason = "that is how a build script speaks")]

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rustc-env=SIZEUP_COMMIT={}", commit());
}

/// The commit, with a `+` where tracked files differ from it; what the environment says where a package is built without
/// its history (`SIZEUP_COMMIT`); empty where nobody knows.
fn commit() -> String {
    println!("cargo::rerun-if-env-changed=SIZEUP_COMMIT");
    for path in ["build.rs", "src", "crates", "Cargo.toml", "Cargo.lock"] {
        println!("cargo::rerun-if-changed={path}");
    }
    // Whoever develops is not made to wait for every commit: a name with `+` is right all the same. HEAD names a branch,
    // whose own file changes with every commit.
    let is_release = std::env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let branch = git(&["symbolic-ref", "-q", "HEAD"]);
    for name in ["HEAD", "packed-refs"].into_iter().chain(branch.as_deref()).filter(|_| is_release) {
        if let Some(path) = git(&["rev-parse", "--git-path", name]).filter(|path| Path::new(path).exists()) {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    if let Ok(named) = std::env::var("SIZEUP_COMMIT") {
        return named;
    }
    // A package unpacked inside somebody else's repository is not of that repository's commit.
    let is_ours = git(&["ls-files", "--error-unmatch", "build.rs"]).is_some();
    let Some(commit) = git(&["rev-parse", "--short=12", "HEAD"]).filter(|_| is_ours) else { return String::new() };
    let is_changed =
        git(&["status", "--porcelain", "--untracked-files=no", "--", "src", "crates", "Cargo.toml", "Cargo.lock"]);
    if is_changed.is_some_and(|changes| !changes.is_empty()) { format!("{commit}+") } else { commit }
}

/// What git says, without the line's end; `None` where it is not there or fails.
fn git(args: &[&str]) -> Option<String> {
    let told = Command::new("git").args(args).output().ok().filter(|told| told.status.success())?;
    Some(String::from_utf8(told.stdout).ok()?.trim().to_owned())
}
