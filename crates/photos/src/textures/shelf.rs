//! Colours that wait to be painted, in an unnamed file: those of all photos together are most of what a textured town holds. The file is gone
//! when the process ends, however that happens.

use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use sizeup_geo::files::FileError;

/// An unnamed file of colours.
#[derive(Debug)]
pub(super) struct Shelf<'a> {
    folder: &'a Path,
    file: Mutex<File>,
}

/// Place of some colours in the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shelved {
    first_byte: u64,
    n_texels: usize,
}

impl<'a> Shelf<'a> {
    /// An empty file in a folder, which is made where there is none.
    pub fn new(folder: &'a Path) -> Result<Self, FileError> {
        let file = fs::create_dir_all(folder).and_then(|()| tempfile::tempfile_in(folder));
        Ok(Self { folder, file: Mutex::new(file.map_err(FileError::on("cannot write into", folder))?) })
    }

    /// Writes colours at the end.
    pub fn put(&self, texels: &[[u8; 3]]) -> Result<Shelved, FileError> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let written = file.seek(SeekFrom::End(0)).and_then(|first_byte| {
            file.write_all(texels.as_flattened())?;
            Ok(Shelved { first_byte, n_texels: texels.len() })
        });
        written.map_err(FileError::on("cannot write into", self.folder))
    }

    /// Reads colours back.
    pub fn get(&self, at: Shelved) -> Result<Vec<[u8; 3]>, FileError> {
        let mut texels = vec![[0; 3]; at.n_texels];
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let read = file.seek(SeekFrom::Start(at.first_byte)).and_then(|_| file.read_exact(texels.as_flattened_mut()));
        read.map_err(FileError::on("lost a temporary file in", self.folder))?;
        Ok(texels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_come_back_in_any_order_and_no_file_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("new");
        let shelf = Shelf::new(&inside).unwrap();
        let colours = [vec![[1, 2, 3], [4, 5, 6]], vec![], vec![[7, 8, 9]]];
        let places: Vec<Shelved> = colours.iter().map(|of| shelf.put(of).unwrap()).collect();
        for k in [2, 0, 1, 0] {
            assert_eq!(shelf.get(places[k]).unwrap(), colours[k]);
        }
        assert_eq!(fs::read_dir(&inside).unwrap().count(), 0);
        let file = inside.join("file");
        fs::write(&file, "").unwrap();
        let message = Shelf::new(&file).unwrap_err().to_string();
        assert!(message.contains("cannot write into") && message.contains("file"), "{message}");
    }
}
