//! Networks that sizeup knows by name: where their weights are published, under which licence, and how a file is recognised.
//!
//! None of the weights is part of sizeup. Of a checkpoint that holds nothing but weights, sizeup has the graph
//! (`graphs/`, written by `tools/`), and puts both together: a graph in ONNX beside a file of the checkpoint's tensors.

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use sizeup_geo::files::{self, FileError};
use sizeup_geo::hashes::sha256_hex;

/// Folder of networks on this machine.
static FOLDER: OnceLock<PathBuf> = OnceLock::new();

/// A network that sizeup knows.
#[derive(Debug, Clone, Serialize)]
pub struct KnownNetwork {
    /// Name, and that of its profile.
    pub name: &'static str,
    /// Purpose of the network, in words.
    pub about: &'static str,
    /// Licence of its weights.
    pub licence: &'static str,
    /// Address at which its authors publish the weights.
    pub source: &'static str,
    /// The published file's size, bytes.
    pub bytes: u64,
    /// The published file's SHA-256, hexadecimal.
    pub sha256: String,
    #[serde(skip)]
    assembly: Assembly,
}

/// Places of a graph's tensors in a checkpoint.
#[derive(Debug, Clone, Deserialize)]
struct Assembly {
    checkpoint_bytes: u64,
    checkpoint_sha256: String,
    weights_bytes: usize,
    tensors: Vec<Slice>,
}

#[derive(Debug, Clone, Deserialize)]
struct Slice {
    checkpoint_offset: usize,
    offset: usize,
    bytes: usize,
}

/// Why a network cannot be put in place.
#[derive(Debug, thiserror::Error)]
pub enum KnownNetworkError {
    /// There is none of that name.
    #[error("no network {name:?} is known\nhint: there are {}; `sizeup model list` says more", known.join(", "))]
    Name {
        /// Name that was asked for.
        name: String,
        /// Names of the networks that are known.
        known: Vec<&'static str>,
    },
    /// The file is not the published one.
    #[error(
        "{} is not the checkpoint of {name}: expected {expected_bytes} bytes with SHA-256 {expected}, found {found_bytes} bytes with {found}\n\
         hint: fetch it again from {source_url}",
        path.display()
    )]
    Checkpoint {
        /// Path of the file that was checked.
        path: PathBuf,
        /// Name of the network that it should be.
        name: &'static str,
        /// Size of the file, bytes.
        found_bytes: u64,
        /// SHA-256 of the file, in hexadecimal.
        found: String,
        /// Size of the published checkpoint, bytes.
        expected_bytes: u64,
        /// SHA-256 of the published checkpoint, in hexadecimal.
        expected: String,
        /// Address of the published one.
        source_url: &'static str,
    },
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Says, once, in which folder networks are put in place on this machine.
pub fn look_in(folder: PathBuf) {
    // A second call finds it set: the program says it when it starts.
    let _ = FOLDER.set(folder);
}

/// Path of a known network's graph on this machine, if `model` is nothing but its name and no file.
#[must_use]
pub fn in_place(model: &Path) -> Option<PathBuf> {
    let network = known_by_name(model.file_name()?.to_str()?).ok()?;
    let folder = FOLDER.get()?;
    (!model.exists() && network.is_in(folder)).then(|| network.graph_in(folder))
}

/// The command that puts a network in place which is named as sizeup knows it; `None` for other files.
#[must_use]
pub fn how_to_get(model: &Path) -> Option<String> {
    let network = known_by_name(model.file_name()?.to_str()?).ok()?;
    Some(format!("`sizeup model get {}` brings it", network.name))
}

/// The networks that sizeup knows.
///
/// # Panics
/// Never: the tables are part of the program and tested.
#[must_use]
pub fn known() -> Vec<KnownNetwork> {
    let itermvs: Assembly =
        serde_json::from_str(include_str!("graphs/itermvs.json")).expect("the table of IterMVS is valid");
    vec![KnownNetwork {
        name: "itermvs",
        about: "IterMVS, multi-view depth of posed photos (Wang et al., CVPR 2022), trained on BlendedMVS",
        licence: "MIT",
        source: "https://raw.githubusercontent.com/FangjinhuaWang/IterMVS/\
                 453e9c72a90cc2987c996aaf24d79e7d25e6489b/checkpoints/blendedmvs/model_000015.ckpt",
        bytes: itermvs.checkpoint_bytes,
        sha256: itermvs.checkpoint_sha256.clone(),
        assembly: itermvs,
    }]
}

/// A known network by name.
///
/// # Errors
/// [`KnownNetworkError::Name`] listing the names there are.
pub fn known_by_name(name: &str) -> Result<KnownNetwork, KnownNetworkError> {
    let all = known();
    let names = all.iter().map(|network| network.name).collect();
    let found = all.into_iter().find(|network| network.name == name);
    found.ok_or_else(|| KnownNetworkError::Name { name: name.to_owned(), known: names })
}

impl KnownNetwork {
    /// Path of its graph in a folder of networks.
    #[must_use]
    pub fn graph_in(&self, folder: &Path) -> PathBuf {
        folder.join(self.name).with_extension("onnx")
    }

    /// Whether it is in place in a folder of networks: graph and weights as [`Self::put_together`] writes them.
    #[must_use]
    pub fn is_in(&self, folder: &Path) -> bool {
        let weights = self.graph_in(folder).with_extension("onnx_data");
        let n_bytes = fs::metadata(weights).map(|file| file.len());
        self.graph_in(folder).is_file() && n_bytes.is_ok_and(|n| n == self.assembly.weights_bytes as u64)
    }

    /// Whether a file is its published checkpoint.
    ///
    /// # Errors
    /// [`KnownNetworkError::Checkpoint`] saying what it is instead; [`KnownNetworkError::File`].
    pub fn check(&self, checkpoint: &Path) -> Result<(), KnownNetworkError> {
        self.checked(checkpoint).map(drop)
    }

    /// Reads the published checkpoint, checks that it is the published one, and writes graph and weights into `folder`; the
    /// answer is the graph's path.
    ///
    /// # Errors
    /// [`KnownNetworkError::Checkpoint`] for any other file; [`KnownNetworkError::File`].
    pub fn put_together(&self, checkpoint: &Path, folder: &Path) -> Result<PathBuf, KnownNetworkError> {
        let content = self.checked(checkpoint)?;
        let mut weights = vec![0_u8; self.assembly.weights_bytes];
        for Slice { checkpoint_offset, offset, bytes } in &self.assembly.tensors {
            weights[*offset..offset + bytes].copy_from_slice(&content[*checkpoint_offset..checkpoint_offset + bytes]);
        }
        fs::create_dir_all(folder).map_err(FileError::on("cannot make", folder))?;
        let graph = self.graph_in(folder);
        // The graph last: where it is, its weights are.
        files::write_whole(&graph.with_extension("onnx_data"), |out| out.write_all(&weights))?;
        let content = unpacked(include_bytes!("graphs/itermvs.onnx.zip"));
        files::write_whole(&graph, |out| out.write_all(&content))?;
        Ok(graph)
    }

    /// The content of the checkpoint, if it is the published one.
    fn checked(&self, path: &Path) -> Result<Vec<u8>, KnownNetworkError> {
        let file = fs::File::open(path).map_err(FileError::on("cannot read", path))?;
        let found_bytes = file.metadata().map_err(FileError::on("cannot read", path))?.len();
        let mut content = Vec::new();
        // Never more than the published size, whatever lies there.
        file.take(self.bytes + 1).read_to_end(&mut content).map_err(FileError::on("cannot read", path))?;
        let found = sha256_hex(&content);
        if found_bytes == self.bytes && found == self.sha256 {
            return Ok(content);
        }
        Err(KnownNetworkError::Checkpoint {
            path: path.to_owned(),
            name: self.name,
            found_bytes,
            found,
            expected_bytes: self.bytes,
            expected: self.sha256.clone(),
            source_url: self.source,
        })
    }
}

/// The one file of an archive that is part of the program.
fn unpacked(archive: &[u8]) -> Vec<u8> {
    let mut content = Vec::new();
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(archive)).expect("the archive is part of the program");
    let mut file = archive.by_index(0).expect("the archive has one file");
    file.read_to_end(&mut content).expect("the archive is whole");
    content
}
