//! The file's list of distinct vertices.

use std::io::{self, Write};

use indexmap::IndexSet;

/// Distinct grid points in the order of their first use: some 30 bytes each.
#[derive(Debug, Default)]
pub struct VertexPool(IndexSet<[i32; 3]>);

impl VertexPool {
    /// The index of a vertex, added if it is new.
    ///
    /// # Panics
    /// Beyond 2³² vertices, or for a point off the output grid, which [`super::OutputGrid::over`] excludes.
    pub fn index_of(&mut self, point: [i64; 3]) -> u32 {
        let point = point.map(|v| i32::try_from(v).expect("the grid reaches to 10^9"));
        u32::try_from(self.0.insert_full(point).0).expect("fewer than 2^32 vertices")
    }

    /// Writes the vertices as the content of a JSON array, a line each.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        self.write_separated(out, "\n", ",\n")
    }

    /// Writes the vertices as the content of a JSON array on one line.
    pub fn write_inline(&self, out: &mut dyn Write) -> io::Result<()> {
        self.write_separated(out, "", ",")
    }

    fn write_separated(&self, out: &mut dyn Write, first: &str, between: &str) -> io::Result<()> {
        self.0
            .iter()
            .enumerate()
            .try_for_each(|(i, [x, y, z])| write!(out, "{}[{x},{y},{z}]", if i == 0 { first } else { between }))
    }

    /// Forgets everything, for the next feature of a sequence.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}
