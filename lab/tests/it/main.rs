//! Behaviour of the laboratory's program seen from outside.

mod benchmark;

use std::process::Output;

use assert_cmd::Command;

/// The binary with its own empty environment of settings.
fn lab() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sizeup-lab"));
    command.env_remove("RUST_LOG");
    command
}

/// What a command left behind.
struct Outcome {
    code: i32,
    stdout: String,
    stderr: String,
}

impl From<Output> for Outcome {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code().expect("no signal ended it"),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

#[test]
fn help_of_every_subcommand_reads_well() {
    let help = |args: &[&str]| -> Outcome { lab().args(args).output().unwrap().into() };
    let overview = help(&["--help"]);
    for command in ["simulate", "baseline", "benchmark", "schema"] {
        assert!(overview.stdout.lines().any(|line| line.trim_start().starts_with(command)), "{}", overview.stdout);
        let one = help(&[command, "--help"]);
        assert_eq!((one.code, &*one.stderr), (0, ""));
        assert!(one.stdout.contains(&format!("Usage: sizeup-lab {command}")), "{}", one.stdout);
        let long = one.stdout.lines().find(|line| line.chars().count() > 120);
        assert!(long.is_none(), "{command}: a line too long for a terminal: {long:?}");
    }
}

#[test]
fn a_file_of_real_buildings_that_cannot_be_read_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("broken.city.json");
    std::fs::write(&broken, b"{\"type\":\"CityJSON\xff\"}").unwrap();
    let missing = folder.path().join("missing.city.json");
    for path in [broken, missing] {
        let from = format!("cityjson.path={}", path.display());
        let mut simulate = lab();
        simulate.current_dir(folder.path()).args(["simulate", "--set", &from, "--output", "scene"]);
        let refused: Outcome = simulate.output().unwrap().into();
        assert_eq!(refused.code, 3, "{}", refused.stderr);
        assert!(refused.stderr.contains("city.json"), "{}", refused.stderr);
    }
}
