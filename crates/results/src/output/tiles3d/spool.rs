//! The blocks of a city on disk: written one after the other, read back in any order, so that a city is never in
//! memory. The file has no name, so nothing is left of it whatever happens.

use std::fs::File;
use std::io::{self, BufWriter, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::Path;

use super::super::OutputError;
use super::mesh::TileBuilding;
use sizeup_geo::files::FileError;

/// Blocks that can still be added.
pub struct SpoolWriter {
    file: BufWriter<File>,
    /// Start of each block.
    starts: Vec<u64>,
    end: u64,
}

/// Blocks that can be read.
pub struct Spool {
    file: File,
    starts: Vec<u64>,
}

impl SpoolWriter {
    /// In a folder that takes as much as the city has.
    ///
    /// # Errors
    /// [`OutputError::File`].
    pub fn new(folder: &Path) -> Result<Self, OutputError> {
        let file = tempfile::tempfile_in(folder).map_err(FileError::on("cannot write", folder))?;
        Ok(Self { file: BufWriter::with_capacity(1 << 20, file), starts: Vec::new(), end: 0 })
    }

    /// Adds a block; its position is the number of those before it.
    ///
    /// # Errors
    /// [`io::Error`]: above all a full disk.
    pub fn push(&mut self, block: &TileBuilding) -> io::Result<()> {
        let bytes = serde_json::to_vec(block)?;
        self.starts.push(self.end);
        self.end += bytes.len() as u64;
        self.file.write_all(&bytes)
    }

    /// All blocks are there.
    ///
    /// # Errors
    /// [`io::Error`].
    pub fn finish(mut self) -> io::Result<Spool> {
        self.starts.push(self.end);
        self.file.flush()?;
        let file = self.file.into_inner().map_err(io::IntoInnerError::into_error)?;
        Ok(Spool { file, starts: self.starts })
    }
}

impl Spool {
    /// The blocks at some positions.
    ///
    /// # Errors
    /// [`io::Error`].
    pub fn read(&self, positions: &[usize]) -> io::Result<Vec<TileBuilding>> {
        let mut file = &self.file;
        let mut bytes = Vec::new();
        let mut block = |&at: &usize| -> io::Result<TileBuilding> {
            bytes.resize((self.starts[at + 1] - self.starts[at]) as usize, 0);
            file.seek(SeekFrom::Start(self.starts[at]))?;
            file.read_exact(&mut bytes)?;
            Ok(serde_json::from_slice(&bytes)?)
        };
        positions.iter().map(&mut block).collect()
    }
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;
    use serde_json::Value;

    use super::*;
    use crate::output::grid::OutputGrid;
    use crate::output::prism::SnappedPrism;
    use crate::output::record::tests::record;

    #[test]
    fn blocks_come_back_in_any_order_to_the_last_bit() {
        let grid = OutputGrid { scale_m: 0.001, origin_m: [0.0; 3] };
        let block = |i: usize| {
            let x = 20.0 * i as f64;
            let footprint = polygon![(x: x, y: 0.0), (x: x + 9.7, y: 0.0), (x: x + 3.3, y: 7.1)];
            let prism = SnappedPrism::of(&record("a", footprint, 1.0, 1.0, 5.0 + i as f64), &grid, 0.1).unwrap();
            TileBuilding {
                roofed: None,
                paints: Vec::new(),
                prism,
                values: vec![Value::from(0.1 + i as f64), Value::from("Ä\n")],
                height_m: 1.0 / (i + 3) as f64,
            }
        };
        let blocks: Vec<TileBuilding> = (0..30).map(block).collect();
        let folder = tempfile::tempdir().unwrap();
        let mut writer = SpoolWriter::new(folder.path()).unwrap();
        for block in &blocks {
            writer.push(block).unwrap();
        }
        let spool = writer.finish().unwrap();
        assert_eq!((spool.starts.len() - 1, std::fs::read_dir(folder.path()).unwrap().count()), (30, 0));
        let positions = [29, 3, 0, 17, 3];
        let expected: Vec<TileBuilding> = positions.iter().map(|&at| blocks[at].clone()).collect();
        assert_eq!(spool.read(&positions).unwrap(), expected);
    }
}
