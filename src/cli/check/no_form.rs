//! What stands for [`super::form`] where the program is built without cjval.

use std::path::Path;

use serde::Serialize;

use super::super::Failure;

/// The findings that this program cannot have.
#[derive(Serialize)]
pub(super) enum Form {}

impl Form {
    /// Refuses the check and says how to build a program that has it.
    pub(super) fn check(_: &Path, _: bool) -> Result<Self, Failure> {
        let text = "this program was built without the check of a file's form (cjval)\nhint: --no-schema checks the solids alone; `cargo build --release --features full` builds all in";
        Err(Failure::from_text(2, text))
    }

    pub(super) fn is_sound(&self) -> bool {
        match *self {}
    }

    pub(super) fn lines(&self, _: usize) -> String {
        match *self {}
    }
}
