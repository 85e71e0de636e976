//! All tiles on one machine: processes of this program, as many at a time as memory and cores allow.

use std::collections::VecDeque;
use std::fs::File;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use super::manifest::{Layout, Tile};
use super::run::write_log;
use super::{TilesError, Trust};
use sizeup_geo::files::FileError;

/// Between two checks of the processes.
const POLL: Duration = Duration::from_millis(50);
/// Memory that is left to the system and everybody else, as a share of what is free.
const LEFT_FREE: f64 = 0.1;

/// How tiles are run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PoolSettings {
    /// Path of the program itself, which is started once per tile.
    pub program: PathBuf,
    /// Processes at a time, at most.
    pub n_jobs: usize,
    /// Number of threads of each process.
    pub n_threads: usize,
    /// Memory that the running tiles' estimates may add up to, megabytes.
    pub memory_mb: u64,
    /// How often a tile that failed is tried again.
    pub n_retries: usize,
    /// How much of what is known of files is believed.
    pub trust: Trust,
}

/// How a tile ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TileOutcome {
    /// Id of the tile.
    pub id: String,
    /// Exit code of its last process; `None` where a signal ended it.
    pub exit_code: Option<i32>,
}

impl TileOutcome {
    /// Whether the tile is done.
    #[must_use]
    pub fn is_done(&self) -> bool {
        matches!(self.exit_code, Some(0 | 5))
    }

    /// Returns the exit code of a failure: 2 settings, 3 input, 4 for what may pass by itself.
    #[must_use]
    pub fn failure_code(&self) -> u8 {
        match self.exit_code {
            Some(2) => 2,
            Some(3) => 3,
            _ => 4,
        }
    }
}

struct Running<'a> {
    tile: &'a Tile,
    child: Child,
    n_tries: usize,
}

/// Runs all tiles of a plan; those that are done say so at once. A tile that fails does not stop the others. `progress`
/// takes how many are finished, and how many there are.
///
/// # Errors
/// [`TilesError::TooLarge`] before anything is started, where a tile does not fit into the memory at all;
/// [`TilesError::Start`] where the program cannot be started.
pub fn run_all(
    layout: &Layout,
    tiles: &[Tile],
    settings: &PoolSettings,
    progress: &dyn Fn(usize, usize),
) -> Result<Vec<TileOutcome>, TilesError> {
    if let Some(tile) = tiles.iter().find(|tile| tile.memory_mb > settings.memory_mb) {
        let (id, needs_mb, has_mb) = (tile.id.clone(), tile.memory_mb, settings.memory_mb);
        return Err(TilesError::TooLarge { id, needs_mb, has_mb });
    }
    let mut waiting: VecDeque<(&Tile, usize)> = tiles.iter().map(|tile| (tile, 0)).collect();
    let mut running: Vec<Running<'_>> = Vec::new();
    let mut outcomes = Vec::new();
    while !(waiting.is_empty() && running.is_empty()) {
        progress(outcomes.len(), tiles.len());
        while let Some(next) = next_that_fits(&waiting, &running, settings) {
            let Some((tile, n_tries)) = waiting.remove(next) else { break };
            match start(layout, tile, settings) {
                Ok(child) => running.push(Running { tile, child, n_tries }),
                Err(error) => {
                    stop(running);
                    return Err(error);
                }
            }
        }
        std::thread::sleep(POLL);
        let mut still = Vec::new();
        for mut one in running {
            // A child whose state is unknown counts as ended by a signal.
            match one.child.try_wait().map_or(Some(None), |ended| ended.map(|status| status.code())) {
                None => still.push(one),
                Some(Some(code @ (0 | 5))) => {
                    outcomes.push(TileOutcome { id: one.tile.id.clone(), exit_code: Some(code) });
                }
                // Settings and input stay what they are.
                Some(Some(2 | 3)) => {
                    let exit_code = one.child.wait().ok().and_then(|status| status.code());
                    outcomes.push(TileOutcome { id: one.tile.id.clone(), exit_code });
                }
                Some(_) if one.n_tries < settings.n_retries => waiting.push_back((one.tile, one.n_tries + 1)),
                Some(exit_code) => outcomes.push(TileOutcome { id: one.tile.id.clone(), exit_code }),
            }
        }
        running = still;
    }
    progress(tiles.len(), tiles.len());
    outcomes.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(outcomes)
}

/// The first waiting tile that fits beside those that run.
fn next_that_fits(
    waiting: &VecDeque<(&Tile, usize)>,
    running: &[Running<'_>],
    settings: &PoolSettings,
) -> Option<usize> {
    if running.len() >= settings.n_jobs.max(1) {
        return None;
    }
    let used_mb: u64 = running.iter().map(|one| one.tile.memory_mb).sum();
    waiting.iter().position(|(tile, _)| used_mb + tile.memory_mb <= settings.memory_mb)
}

fn start(layout: &Layout, tile: &Tile, settings: &PoolSettings) -> Result<Child, TilesError> {
    write_log(layout, &tile.id, b"")?;
    let path = layout.tile(&tile.id).join("log.txt");
    let log = File::create(&path).map_err(FileError::on("cannot write", &path))?;
    Command::new(&settings.program)
        .args(["tiles", "run"])
        .arg(layout.folder())
        .args(["--tile", &tile.id, "--threads", &settings.n_threads.to_string()])
        .args((settings.trust == Trust::Nothing).then_some("--rehash"))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(log)
        .spawn()
        .map_err(|source| TilesError::Start { program: settings.program.clone(), source })
}

fn stop(running: Vec<Running<'_>>) {
    for mut one in running {
        // It may have ended by itself.
        let _ = one.child.kill();
        let _ = one.child.wait();
    }
}

/// Memory that tiles may use, megabytes: what is free now, less some for others; `None` where the system does not report it.
#[must_use]
pub fn available_memory_mb() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kilobytes: f64 = line.split_whitespace().next()?.parse().ok()?;
    Some(((1.0 - LEFT_FREE) * kilobytes / 1000.0) as u64)
}
