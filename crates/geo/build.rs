//! Finds the system's PROJ, the one GDAL loads too: `proj-sys` is told not to build or bundle its own.

fn main() {
    pkg_config::Config::new()
        .atleast_version("9.1")
        .probe("proj")
        .expect("PROJ >= 9.1 with headers is needed: run `make deps`, or install libproj-dev");
}
