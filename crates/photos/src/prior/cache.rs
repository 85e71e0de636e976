//! Computed priors on disk, so that each is computed once: content-addressed, safe with several processes.
//!
//! An entry's name is the SHA-256 of everything its content depends on ([`CacheKey`]): change a photo, a pose or a
//! setting and there is no entry. Entries are written whole under a temporary name and renamed, so a killed process
//! leaves none half-done; two processes that compute the same entry write the same bytes. An entry is
//!
//! ```text
//! {"version":1,"kind":…,"geometry":…,"width":…,"height":…,"sha256":…}\n   one line of JSON
//! f32 little-endian, H × W row-major, NaN = no value
//! ```

use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use super::array::{MOST, MapShape};
use super::{DepthPrior, PriorError, PriorGeometry, PriorKind, PriorSource};
use sizeup_geo::files::{FileError, is_virtual, write_whole};
use sizeup_geo::hashes::{Hashes, hex, sha256_hex};
use sizeup_survey::View;

/// Changes whenever the same key would no longer mean the same content.
const VERSION: u32 = 1;
/// Share of the limit that is left after making room, so that room is not made at every entry.
const KEEP: f64 = 0.9;
/// Age at which another process's unfinished file counts as abandoned.
const ABANDONED: Duration = Duration::from_hours(1);
/// Longest first line of an entry, bytes.
const MAX_HEADER: u64 = 1024;

/// Where computed priors are kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CacheConfig {
    /// Folder, made when it is needed. Several runs and processes can share it.
    pub folder: PathBuf,
    /// Size at which what was used least lately goes, gigabytes (10⁹ bytes). 0 keeps nothing.
    pub limit_gb: f64,
}

impl Default for CacheConfig {
    fn default() -> Self {
        Self { folder: PathBuf::from("prior-cache"), limit_gb: 20.0 }
    }
}

impl CacheConfig {
    /// The cache; `None`, with a warning, where its folder cannot be used: it then costs time, not results.
    ///
    /// # Errors
    /// [`PriorError::Config`] for a limit that is no size.
    pub fn open(&self) -> Result<Option<PriorCache>, PriorError> {
        const PER_GB: f64 = 1e9;
        if !(self.limit_gb.is_finite() && self.limit_gb >= 0.0) {
            return Err(PriorError::Config {
                problem: "cache: `limit_gb` is out of range".to_owned(),
                hint: "gigabytes, 0 for no cache".to_owned(),
            });
        }
        if self.limit_gb == 0.0 {
            return Ok(None);
        }
        let cache = PriorCache::open(&self.folder, (self.limit_gb * PER_GB) as u64);
        Ok(cache.map_err(|error| warn("priors are computed anew each time", &error)).ok())
    }
}

fn warn(what: &str, error: &FileError) {
    let cause = std::error::Error::source(error).map(ToString::to_string).unwrap_or_default();
    tracing::warn!("{what}: {error}: {cause}");
}

/// A source whose result is a function of what its key names.
pub trait CacheKey: PriorSource {
    /// Feeds everything that the prior of a view depends on: photos, poses, settings, model.
    ///
    /// # Errors
    /// [`PriorError`] where a file it depends on cannot be read.
    fn feed(&self, view: &View, key: &mut KeyHasher) -> Result<(), PriorError>;
}

/// Collects what a prior depends on.
#[derive(Debug, Clone)]
pub struct KeyHasher(Sha256);

impl KeyHasher {
    /// For one kind of source, such as "stereo 1": the number changes when its algorithm does.
    #[must_use]
    pub fn new(source: &str) -> Self {
        let mut hasher = Self(Sha256::new());
        hasher.bytes(&VERSION.to_le_bytes());
        hasher.bytes(source.as_bytes());
        hasher
    }

    /// Bytes, with their length: "ab", "c" is not "a", "bc".
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.0.update((bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
    }

    /// Anything with a JSON form: settings, cameras, poses.
    pub fn json(&mut self, value: &impl Serialize) {
        // What has no JSON (a NaN among settings) has been refused long before; its text stands in for it.
        let text = serde_json::to_string(value).unwrap_or_else(|e| e.to_string());
        self.bytes(text.as_bytes());
    }

    /// The content of a file; of one in an archive or on a server its name, which has to stand for it.
    ///
    /// # Errors
    /// [`PriorError::Cache`] if it cannot be read.
    pub fn file(&mut self, path: &Path) -> Result<(), PriorError> {
        if is_virtual(path) {
            self.bytes(path.to_string_lossy().as_bytes());
            return Ok(());
        }
        let content = CONTENTS.of(path).map_err(FileError::on("cannot read", path))?;
        self.bytes(&content.digest());
        Ok(())
    }

    fn finish(self) -> String {
        hex(&self.0.finalize())
    }
}

/// Files already read by this process: photos are neighbours of many, and a network belongs to every key.
static CONTENTS: LazyLock<Hashes> = LazyLock::new(Hashes::new);

/// First line of an entry.
#[derive(Debug, Serialize, Deserialize)]
struct EntryHeader {
    version: u32,
    kind: PriorKind,
    geometry: PriorGeometry,
    width: usize,
    height: usize,
    /// Hash of the data, to notice a damaged disk.
    sha256: String,
}

/// A folder of entries.
#[derive(Debug)]
pub struct PriorCache {
    folder: PathBuf,
    limit_bytes: u64,
    /// Ours and, since the last look, roughly everybody's.
    n_bytes: AtomicU64,
}

impl PriorCache {
    /// Opens or makes a cache that stays below a size, give or take the entries of other processes.
    ///
    /// # Errors
    /// [`FileError`] if the folder cannot be made or read.
    pub fn open(folder: impl Into<PathBuf>, limit_bytes: u64) -> Result<Self, FileError> {
        let folder = folder.into();
        fs::create_dir_all(&folder).map_err(FileError::on("cannot make", &folder))?;
        let cache = Self { folder, limit_bytes, n_bytes: AtomicU64::new(0) };
        cache.make_room()?;
        Ok(cache)
    }

    fn path(&self, key: &str) -> PathBuf {
        self.folder.join(format!("{key}.prior"))
    }

    /// The entry, `None` if there is none or it is damaged (it is then removed).
    #[must_use]
    pub fn get(&self, key: &str) -> Option<DepthPrior> {
        let path = self.path(key);
        let file = File::open(&path).ok()?;
        // Entries used last go last; a cache on a read-only disk just does not know.
        let _ = file.set_modified(SystemTime::now());
        let entry = read_entry(file);
        if entry.is_none() {
            tracing::warn!("removing damaged cache entry {}", path.display());
            let _ = fs::remove_file(&path);
        }
        entry
    }

    /// Keeps an entry, and makes room where the limit is exceeded.
    ///
    /// # Errors
    /// [`FileError`] if it cannot be written: a full disk, most of the time.
    pub fn put(&self, key: &str, prior: &DepthPrior) -> Result<(), FileError> {
        let data: Vec<u8> = prior.values.data().iter().flat_map(|v| v.to_le_bytes()).collect();
        let header = EntryHeader {
            version: VERSION,
            kind: prior.kind,
            geometry: prior.geometry,
            width: prior.values.width(),
            height: prior.values.height(),
            sha256: sha256_hex(&data),
        };
        write_whole(&self.path(key), |writer| {
            serde_json::to_writer(&mut *writer, &header)?;
            writer.write_all(b"\n")?;
            writer.write_all(&data)
        })?;
        if self.n_bytes.fetch_add(data.len() as u64, Ordering::Relaxed) + data.len() as u64 > self.limit_bytes {
            self.make_room()?;
        }
        Ok(())
    }

    /// Removes what was used least lately, and files that killed processes left unfinished.
    fn make_room(&self) -> Result<(), FileError> {
        let mut entries: Vec<(SystemTime, PathBuf, u64)> = Vec::new();
        for item in fs::read_dir(&self.folder).map_err(FileError::on("cannot read", &self.folder))?.flatten() {
            let Ok(metadata) = item.metadata() else { continue }; // another process was faster
            let modified = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
            let path = item.path();
            if item.file_name().to_string_lossy().starts_with(".partial-") {
                if modified.elapsed().is_ok_and(|age| age > ABANDONED) {
                    let _ = fs::remove_file(&path);
                }
            } else if path.extension().is_some_and(|e| e == "prior") {
                entries.push((modified, path, metadata.len()));
            }
        }
        entries.sort_unstable();
        let mut n_bytes: u64 = entries.iter().map(|(_, _, n)| n).sum();
        if n_bytes > self.limit_bytes {
            let goal = (self.limit_bytes as f64 * KEEP) as u64;
            for (_, path, n) in entries {
                if n_bytes <= goal {
                    break;
                }
                let _ = fs::remove_file(path);
                n_bytes -= n;
            }
        }
        self.n_bytes.store(n_bytes, Ordering::Relaxed);
        Ok(())
    }
}

fn read_entry(file: File) -> Option<DepthPrior> {
    let mut reader = BufReader::new(file);
    let mut line = Vec::new();
    reader.by_ref().take(MAX_HEADER).read_until(b'\n', &mut line).ok()?;
    let header: EntryHeader = serde_json::from_slice(&line).ok()?;
    let shape = MapShape::of(&[1, header.height, header.width], MOST).ok().filter(|_| header.version == VERSION)?;
    let mut data = Vec::new();
    reader.take(shape.cells() as u64 * 4 + 1).read_to_end(&mut data).ok()?;
    if data.len() != shape.cells() * 4 || sha256_hex(&data) != header.sha256 {
        return None;
    }
    let values = data.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    let values = sizeup_heights::raster::Raster::from_vec(header.width, header.height, values)?;
    Some(DepthPrior { values, kind: header.kind, geometry: header.geometry })
}

/// A source with a cache before it.
#[derive(Debug)]
pub struct CachedPriors<S> {
    source: S,
    cache: Option<PriorCache>,
}

impl<S: CacheKey> CachedPriors<S> {
    /// Asks the cache first, where there is one.
    #[must_use]
    pub fn new(source: S, cache: Option<PriorCache>) -> Self {
        Self { source, cache }
    }

    /// Source that computes what is not kept yet.
    #[must_use]
    pub fn source(&self) -> &S {
        &self.source
    }

    /// Whether what is computed is kept.
    #[must_use]
    pub fn has_cache(&self) -> bool {
        self.cache.is_some()
    }

    /// Name of a view's entry.
    pub(super) fn key(&self, view: &View) -> Result<String, PriorError> {
        let mut hasher = KeyHasher::new(std::any::type_name::<S>());
        self.source.feed(view, &mut hasher)?;
        Ok(hasher.finish())
    }

    /// Whether a view's prior is there already.
    ///
    /// # Errors
    /// As loading it, as far as that can be told without computing.
    pub fn is_kept(&self, view: &View) -> Result<bool, PriorError> {
        match &self.cache {
            Some(cache) => Ok(cache.path(&self.key(view)?).exists()),
            None => Ok(false),
        }
    }

    /// Keeps a prior that was computed, where there is a cache.
    pub(super) fn keep(&self, key: &str, prior: &DepthPrior) {
        // A cache that cannot be written costs time, not results.
        if let Some(Err(error)) = self.cache.as_ref().map(|cache| cache.put(key, prior)) {
            warn("a prior is not kept", &error);
        }
    }
}

impl<S: CacheKey> PriorSource for CachedPriors<S> {
    fn load(&self, view: &View) -> Result<DepthPrior, PriorError> {
        let Some(cache) = &self.cache else { return self.source.load(view) };
        let key = self.key(view)?;
        if let Some(prior) = cache.get(&key) {
            return Ok(prior);
        }
        let prior = self.source.load(view)?;
        self.keep(&key, &prior);
        Ok(prior)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::AtomicUsize;

    use glam::{DMat3, DVec3};

    use super::*;
    use sizeup_heights::camera::Camera;
    use sizeup_heights::frames::Rigid;
    use sizeup_heights::raster::Raster;

    /// Counts how often it is asked.
    #[derive(Default)]
    struct Counting {
        setting: u32,
        n_computed: Arc<AtomicUsize>,
    }

    impl PriorSource for Counting {
        fn load(&self, _: &View) -> Result<DepthPrior, PriorError> {
            self.n_computed.fetch_add(1, Ordering::Relaxed);
            let values = Raster::from_vec(2, 1, vec![self.setting as f32, f32::NAN]).unwrap();
            Ok(DepthPrior { values, kind: PriorKind::InverseDepth, geometry: PriorGeometry::Range })
        }
    }

    impl CacheKey for Counting {
        fn feed(&self, view: &View, key: &mut KeyHasher) -> Result<(), PriorError> {
            key.json(&self.setting);
            key.json(&view.id);
            Ok(())
        }
    }

    fn view(name: &str) -> View {
        View {
            id: name.into(),
            camera: Arc::new(Camera::pinhole(4, 2, 4.0)),
            camera_from_map: Rigid::new(DMat3::IDENTITY, DVec3::ZERO),
            image: None,
        }
    }

    fn cached(folder: &Path, setting: u32, n_computed: &Arc<AtomicUsize>) -> CachedPriors<Counting> {
        let source = Counting { setting, n_computed: Arc::clone(n_computed) };
        CachedPriors::new(source, Some(PriorCache::open(folder, 1 << 20).unwrap()))
    }

    #[test]
    fn a_prior_is_computed_once_per_key_also_by_the_next_process() {
        let folder = tempfile::tempdir().unwrap();
        let n_computed = Arc::default();
        let first = cached(folder.path(), 7, &n_computed).load(&view("a")).unwrap();
        let second = cached(folder.path(), 7, &n_computed).load(&view("a")).unwrap();
        assert_eq!(n_computed.load(Ordering::Relaxed), 1);
        assert_eq!((second.kind, second.geometry), (first.kind, first.geometry));
        assert_eq!(second.values.data()[0], 7.0);
        assert!(second.values.data()[1].is_nan());
        cached(folder.path(), 7, &n_computed).load(&view("b")).unwrap();
        cached(folder.path(), 8, &n_computed).load(&view("a")).unwrap();
        assert_eq!(n_computed.load(Ordering::Relaxed), 3);
    }

    #[test]
    fn a_damaged_entry_is_computed_again() {
        let folder = tempfile::tempdir().unwrap();
        let n_computed = Arc::default();
        cached(folder.path(), 7, &n_computed).load(&view("a")).unwrap();
        let entry = fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        let mut bytes = fs::read(&entry).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        for damaged in [bytes.as_slice(), &bytes[..bytes.len() - 3], b"", b"{}\n"] {
            fs::write(&entry, damaged).unwrap();
            assert_eq!(cached(folder.path(), 7, &n_computed).load(&view("a")).unwrap().values.data()[0], 7.0);
        }
        assert_eq!(n_computed.load(Ordering::Relaxed), 5);
    }

    #[test]
    fn the_least_lately_used_make_room_and_unfinished_files_of_others_are_left() {
        let folder = tempfile::tempdir().unwrap();
        let unfinished = folder.path().join(".partial-x.prior");
        fs::write(&unfinished, b"half").unwrap();
        let prior = |value: f32| DepthPrior {
            values: Raster::from_vec(100, 1, (0..100).map(|i| value + i as f32).collect()).unwrap(),
            kind: PriorKind::Depth,
            geometry: PriorGeometry::ZDepth,
        };
        let cache = PriorCache::open(folder.path(), 3_000).unwrap();
        for i in 0..8_u64 {
            cache.put(&format!("{i}"), &prior(i as f32)).unwrap();
            let age = Duration::from_secs(100 - i);
            let Ok(file) = File::open(cache.path(&i.to_string())) else { continue };
            file.set_modified(SystemTime::now() - age).unwrap();
        }
        let cache = PriorCache::open(folder.path(), 2_000).unwrap();
        assert!(cache.get("0").is_none() && cache.get("7").is_some());
        assert!(unfinished.exists(), "another process may still be writing it");
    }
}
