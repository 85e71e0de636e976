//! What people see while they wait: bars on a terminal, log lines elsewhere.

use std::io::IsTerminal as _;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::{Global, talk};
use crate::pipeline::Event;
use sizeup_heights::optimise::Solving;

/// Between two log lines about the same work.
const LOG_EVERY: Duration = Duration::from_secs(10);

/// Sends log events to stderr: warnings, or what `RUST_LOG` asks for.
pub(super) fn start_logging(global: &Global) {
    use tracing_subscriber::EnvFilter;
    let level = if global.quiet { "error" } else { "warn" };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    // A second start, as in tests that call the library twice, keeps the first.
    let _ = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).without_time().try_init();
}

/// Warns of results that are not of one run, because their writer was killed between two files.
pub(super) fn warn_of_unfinished(path: &std::path::Path, global: &Global) {
    if sizeup_geo::unfinished::is_marked(path) {
        let name = sizeup_geo::unfinished::NAME;
        Ui::new(global).say(format!(
            "warning: {} is among results that were being replaced when their writer ended: its files may be of two \
             runs, see {name} beside it",
            path.display()
        ));
    }
}

/// Talk on stderr.
pub struct Ui {
    is_quiet: bool,
    bar: Option<ProgressBar>,
    last: Mutex<Option<(String, Instant)>>,
}

impl Ui {
    /// A bar where stderr is a terminal, log lines elsewhere, nothing if asked for quiet.
    #[must_use]
    pub fn new(global: &Global) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        let bar = (!global.quiet && is_terminal).then(|| {
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
            let style = ProgressStyle::with_template("{msg:>20} {wide_bar:.cyan/black} {pos}/{len} {elapsed}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        Self { is_quiet: global.quiet, bar, last: Mutex::new(None) }
    }

    /// One line of talk.
    pub fn say(&self, text: impl std::fmt::Display) {
        if self.is_quiet {
            return;
        }
        match &self.bar {
            Some(bar) => bar.suspend(|| talk(&text)),
            None => talk(&text),
        }
    }

    /// So much of some work is done.
    pub fn advance(&self, what: &str, done: usize, total: usize) {
        if self.is_quiet {
            return;
        }
        if let Some(bar) = &self.bar {
            bar.set_length(total as u64);
            bar.set_position(done as u64);
            bar.set_message(what.to_owned());
            return;
        }
        let Ok(mut last) = self.last.lock() else { return };
        let is_due = match &*last {
            Some((name, at)) if name == what => at.elapsed() >= LOG_EVERY,
            _ => total > 0,
        };
        if is_due {
            talk(&format_args!("{what}: {done} of {total}"));
            *last = Some((what.to_owned(), Instant::now()));
        }
    }

    /// What a run tells.
    pub fn tell(&self, event: Event) {
        match event {
            Event::Stage(stage) => self.advance(stage.name(), 0, 0),
            Event::Ground { done, total } => self.advance("looking at the ground", done, total),
            Event::Advance { what, done, total } => {
                let what = match what {
                    Solving::Tracing => "tracing rays",
                    Solving::Priors => "loading priors",
                    Solving::Epochs => "finding heights",
                };
                self.advance(what, done, total);
            }
        }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
