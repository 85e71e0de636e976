//! Finds the system's PROJ, the one GDAL loads too: `proj-sys` is told not to build or bundle its own. With
//! `bundled-libraries` there is nothing to find: `proj-sys` builds PROJ, and `gdal-src` a GDAL that uses it.

#![allow(clippy::print_stdout, reason = "that is how a build script speaks")]

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let has = |feature: &str| std::env::var_os(format!("CARGO_FEATURE_{feature}")).is_some();
    match (has("SYSTEM_LIBRARIES"), has("BUNDLED_LIBRARIES")) {
        (true, false) => find_proj(),
        (false, true) => {}
        (true, true) => panic!("system-libraries and bundled-libraries exclude each other: add --no-default-features"),
        (false, false) => panic!("one of the features system-libraries and bundled-libraries is needed"),
    }
}

fn find_proj() {
    pkg_config::Config::new()
        .atleast_version("9.1")
        .probe("proj")
        .expect("PROJ >= 9.1 with headers is needed: run `make deps`, or install libproj-dev");
}
