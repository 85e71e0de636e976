//! What packages bring beside the program: completions that shells take, and manual pages that `man` shows.

use std::fs;
use std::process::Command;

use crate::tiny_scene::{Outcome, sizeup};
use crate::tools;

fn outcome(args: &[&str]) -> Outcome {
    sizeup().args(args).output().unwrap().into()
}

#[test]
fn completions_of_every_shell_name_commands_and_options() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = outcome(&["completions", shell]);
        assert_eq!((script.code, &*script.stderr), (0, ""), "{shell}");
        for word in ["footprints", "inspect", "until"] {
            assert!(script.stdout.contains(word), "{shell}: no {word}");
        }
    }
    assert_eq!(outcome(&["completions", "tcsh"]).code, 2);
}

#[test]
fn bash_completes_a_command_with_the_script() {
    let Some(bash) = tools::program("bash", "deps-test") else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("sizeup");
    fs::write(&script, outcome(&["completions", "bash"]).stdout).unwrap();
    let ask = format!(
        "source {}; COMP_WORDS=(sizeup eval) COMP_CWORD=1; _sizeup sizeup eval sizeup; echo \"${{COMPREPLY[@]}}\"",
        script.display()
    );
    assert_eq!(tools::run(Command::new(bash).args(["--norc", "-c", &ask])).trim(), "evaluate");
}

#[test]
fn every_command_has_a_manual_page_with_its_options() {
    let folder = tempfile::tempdir().unwrap();
    let written = outcome(&["man", "--output", folder.path().to_str().unwrap()]);
    assert_eq!((written.code, &*written.stderr), (0, ""));
    let mut pages: Vec<String> =
        fs::read_dir(folder.path()).unwrap().map(|page| page.unwrap().file_name().into_string().unwrap()).collect();
    pages.sort();
    for page in ["sizeup.1", "sizeup-run.1", "sizeup-survey-inspect.1", "sizeup-tiles-plan.1", "sizeup-completions.1"] {
        assert!(pages.iter().any(|found| found == page), "no {page} among {pages:?}");
    }
    assert!(!pages.iter().any(|page| page.contains("help") || page == "sizeup-man.1"), "{pages:?}");
    let page = fs::read_to_string(folder.path().join("sizeup-run.1")).unwrap();
    assert!(page.starts_with(".ie") || page.contains(".TH sizeup-run 1"), "{}", &page[..200.min(page.len())]);
    for word in ["\\-\\-until", "SYNOPSIS", "Configuration file"] {
        assert!(page.contains(word), "no {word}");
    }
}

#[test]
fn a_configuration_comes_through_standard_input_with_paths_of_the_working_folder() {
    let scene = crate::tiny_scene::Scene::new();
    let text = fs::read(scene.path("sizeup.toml")).unwrap();
    let piped = sizeup()
        .current_dir(scene.path(""))
        .args(["run", "-", "--quiet", "--json"])
        .write_stdin(text)
        .output()
        .unwrap();
    assert!([0, 5].contains(&piped.status.code().unwrap()), "{}", String::from_utf8_lossy(&piped.stderr));
    let summary: serde_json::Value = serde_json::from_slice(&piped.stdout).unwrap();
    assert_eq!(summary["n_buildings"], crate::tiny_scene::N_BUILDINGS);
    let tiled = outcome(&["run", "-", "--tiled"]);
    assert_eq!(tiled.code, 2);
    assert!(tiled.stderr.contains("hint: save the configuration as a file"), "{}", tiled.stderr);
}
