//! What people see while they wait: bars on a terminal, log lines elsewhere; for programs see `progress`.

use std::io::IsTerminal as _;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::overall::Overall;
use super::progress::{LogLines, MessageLevel, Pace, ProgressEvent, ProgressForm};
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
    let log = tracing_subscriber::fmt().with_env_filter(filter).without_time();
    // A second start, as in tests that call the library twice, keeps the first.
    let _ = match global.progress {
        ProgressForm::Text => log.with_writer(std::io::stderr).try_init(),
        ProgressForm::Json => log.with_writer(LogLines).with_ansi(false).with_level(false).try_init(),
    };
}

/// Warns of results whose writer was killed before its end, or is still at it.
pub(super) fn warn_of_unfinished(path: &std::path::Path, global: &Global) {
    if let Some(told) = sizeup_geo::unfinished::told_of(path) {
        let name = sizeup_geo::unfinished::NAME;
        Ui::new(global).warn(format!("{} is not finished: {told}; see {name} beside it", path.display()));
    }
}

/// Whatever the program says on stderr: progress, remarks, summaries.
pub struct Ui {
    is_quiet: bool,
    voice: Voice,
    overall: Mutex<Overall>,
}

/// How it is talked.
enum Voice {
    /// A bar on a terminal, and lines above it.
    Bar(ProgressBar),
    /// Lines of text, where stderr is no terminal.
    Lines(Mutex<Option<(String, Instant)>>),
    /// JSON objects a line, for programs.
    Events(Pace),
}

impl Ui {
    /// Events if programs ask for them; else a bar where stderr is a terminal, log lines elsewhere. Nothing if asked for
    /// quiet.
    #[must_use]
    pub fn new(global: &Global) -> Self {
        let voice = match global.progress {
            ProgressForm::Json => Voice::Events(Pace::default()),
            ProgressForm::Text if !global.quiet && std::io::stderr().is_terminal() => Voice::Bar(new_bar()),
            ProgressForm::Text => Voice::Lines(Mutex::new(None)),
        };
        Self { is_quiet: global.quiet, voice, overall: Mutex::default() }
    }

    /// One line of talk.
    pub fn say(&self, text: impl std::fmt::Display) {
        self.message(MessageLevel::Info, "", &text);
    }

    /// A warning: in lines it begins with that word, in events it has that level.
    pub fn warn(&self, text: impl std::fmt::Display) {
        self.message(MessageLevel::Warning, "warning: ", &text);
    }

    fn message(&self, level: MessageLevel, mark: &str, text: &dyn std::fmt::Display) {
        if self.is_quiet {
            return;
        }
        match &self.voice {
            Voice::Bar(bar) => bar.suspend(|| talk(&format_args!("{mark}{text}"))),
            Voice::Lines(_) => talk(&format_args!("{mark}{text}")),
            Voice::Events(_) => ProgressEvent::Message { level, message: text.to_string() }.emit(),
        }
    }

    /// So much of some work is done; `what` is for people and for programs.
    pub fn advance(&self, what: &str, done: usize, total: usize) {
        self.advance_of_run(what, done, total, None);
    }

    fn advance_of_run(&self, what: &str, done: usize, total: usize, share: Option<f64>) {
        if self.is_quiet {
            return;
        }
        match &self.voice {
            Voice::Bar(bar) => {
                bar.set_length(total as u64);
                bar.set_position(done as u64);
                bar.set_message(what.to_owned());
            }
            Voice::Lines(last) => advance_in_lines(last, what, done, total),
            Voice::Events(pace) if pace.is_due(what, done, total) => {
                ProgressEvent::Advance { what: what.to_owned(), done, total, share }.emit();
            }
            Voice::Events(_) => {}
        }
    }

    /// Event of a run.
    pub fn tell(&self, event: Event) {
        // Held to the end: threads that overtake each other here would tell a lower share after a higher one.
        let Ok(mut overall) = self.overall.lock() else { return };
        let (ended, share) = (overall.take(&event), overall.share());
        if let (Voice::Events(_), Event::Stage(stage), false) = (&self.voice, event, self.is_quiet) {
            ProgressEvent::Stage { stage, share: share.unwrap_or(0.0) }.emit();
            return;
        }
        if let (Voice::Bar(bar), false) = (&self.voice, self.is_quiet) {
            if let Some(ended) = ended {
                bar.suspend(|| talk(&ended));
            }
            // Before the first stage, as where only priors are computed, the bar is that of the work.
            let of_the_whole = share.filter(|_| !matches!(event, Event::PriorsDoubted { .. }));
            if let Some(share) = of_the_whole {
                bar.set_style(style_of(BAR_OF_A_RUN));
                bar.set_length(STEPS_OF_A_RUN);
                bar.set_position((share * STEPS_OF_A_RUN as f64) as u64);
                bar.set_message(overall.stage_in_words());
                return;
            }
        }
        let (work, done, total) = match event {
            Event::Stage(stage) => return self.advance(stage.name(), 0, 0),
            Event::PriorsDoubted { n_views } => {
                return self.warn(format!(
                    "the depth priors of {n_views} photos looked at do not follow the ground: is `prior.kind` \
                     right, and do the files belong to these photos?"
                ));
            }
            Event::Align { done, total } => (ALIGNING, done, total),
            Event::Ground { done, total } => (GROUND, done, total),
            Event::Photos { done, total } => (PHOTOS, done, total),
            Event::Advance { what: Solving::Tracing, done, total } => (("tracing", "tracing rays"), done, total),
            Event::Advance { what: Solving::Priors, done, total } => (("priors", "loading priors"), done, total),
            Event::Advance { what: Solving::Epochs, done, total } => (("epochs", "finding heights"), done, total),
        };
        self.advance_of_run(self.called(work), done, total, share);
    }

    /// So much of some work is done that has a name for programs and words for people.
    pub(super) fn advance_named(&self, work: Work, done: usize, total: usize) {
        self.advance(self.called(work), done, total);
    }

    fn called(&self, (name, words): Work) -> &'static str {
        if matches!(self.voice, Voice::Events(_)) { name } else { words }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Voice::Bar(bar) = &self.voice {
            bar.finish_and_clear();
        }
    }
}

/// Some work: its name for programs, and words for people.
pub(super) type Work = (&'static str, &'static str);

/// Looking for blur and exposure.
pub(super) const PHOTOS: Work = ("photos", "looking at the photos");
/// Work of aligning a survey.
pub(super) const ALIGNING: Work = ("align", "matching and adjusting, sizes of the photos");
/// Looking for the ground in the photos.
pub(super) const GROUND: Work = ("ground", "looking at the ground");
/// Computing priors ahead of a run.
pub(super) const PRIORS: Work = ("priors", "computing priors");

/// Bar of some work: how much of it is done.
const BAR_OF_WORK: &str = "{msg:>20} {wide_bar:.cyan/black} {pos}/{len} {elapsed}";
/// Bar of a whole run: the stage, the share that is done, and the time left if it goes on as so far.
const BAR_OF_A_RUN: &str = "{msg:>20} {wide_bar:.cyan/black} {percent} % {elapsed}, {eta} left";
/// Steps of the bar of a run: finer than a terminal shows.
const STEPS_OF_A_RUN: u64 = 1000;

fn new_bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
    bar.set_style(style_of(BAR_OF_WORK));
    bar
}

fn style_of(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

fn advance_in_lines(last: &Mutex<Option<(String, Instant)>>, what: &str, done: usize, total: usize) {
    let Ok(mut last) = last.lock() else { return };
    let is_due = match &*last {
        Some((name, at)) if name == what => at.elapsed() >= LOG_EVERY,
        _ => total > 0,
    };
    if is_due {
        talk(&format_args!("{what}: {done} of {total}"));
        *last = Some((what.to_owned(), Instant::now()));
    }
}
