//! How far a run is as a whole: one share from its events, which never goes back.

use std::time::Instant;

use crate::pipeline::{Event, Stage};
use sizeup_heights::optimise::Solving;

/// Where each stage begins and ends, shares of a run: the demo on two busy cores took 9, 2, 61 and 39 s.
const STAGES: [(Stage, [f64; 2]); 4] = [
    (Stage::Survey, [0.0, 0.08]),
    (Stage::Footprints, [0.08, 0.10]),
    (Stage::Heights, [0.10, 0.65]),
    (Stage::Output, [0.65, 1.0]),
];

/// Progress of a run.
#[derive(Debug, Default)]
pub(super) struct Overall {
    stage: Option<(Stage, Instant)>,
    share: f64,
}

impl Overall {
    /// Takes an event in; the stage that ended with it, in words, if one did.
    pub fn take(&mut self, event: &Event) -> Option<String> {
        if let Event::Stage(stage) = *event {
            let ended = self.stage.replace((stage, Instant::now()));
            self.reach(Self::range(stage)[0]);
            return ended
                .map(|(stage, began)| format!("{} done in {:.0} s", words(stage), began.elapsed().as_secs_f64()));
        }
        let (done, total) = match *event {
            Event::Align { done, total }
            | Event::Photos { done, total }
            | Event::Ground { done, total }
            | Event::Advance { done, total, .. } => (done, total),
            Event::Stage(_) | Event::PriorsDoubted { .. } => return None,
        };
        if let (Some((stage, _)), true) = (self.stage, total > 0) {
            // Work within a stage begins anew, round by round: each counts for a part of what is left of the stage.
            let [begin, end] = Self::range(stage);
            let [from, to] = match event {
                Event::Advance { what: Solving::Tracing, .. } => [0.0, 0.1],
                Event::Advance { what: Solving::Priors, .. } => [0.1, 0.5],
                Event::Advance { what: Solving::Epochs, .. } => [0.5, 1.0],
                _ => [0.0, 1.0],
            };
            let part = from + (to - from) * done.min(total) as f64 / total as f64;
            self.reach(begin + (end - begin) * part);
        }
        None
    }

    /// Share of the run that is done, 0 to 1; `None` before a stage began, as where only a part of a run is done.
    pub fn share(&self) -> Option<f64> {
        self.stage.map(|_| self.share)
    }

    /// The stage that is under way, in words.
    pub fn stage_in_words(&self) -> &'static str {
        self.stage.map_or("", |(stage, _)| words(stage))
    }

    fn range(stage: Stage) -> [f64; 2] {
        STAGES.into_iter().find(|(one, _)| *one == stage).map_or([0.0, 1.0], |(_, range)| range)
    }

    fn reach(&mut self, share: f64) {
        self.share = self.share.max(share);
    }
}

fn words(stage: Stage) -> &'static str {
    match stage {
        Stage::Survey => "survey",
        Stage::Footprints => "footprints",
        Stage::Heights => "heights",
        Stage::Output => "output",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_never_goes_back_and_tells_each_stage_that_ended() {
        let work = |what, done| Event::Advance { what, done, total: 4 };
        let events = [
            Event::Stage(Stage::Survey),
            Event::Photos { done: 2, total: 4 },
            Event::Stage(Stage::Footprints),
            Event::Stage(Stage::Heights),
            work(Solving::Tracing, 4),
            work(Solving::Epochs, 4),
            work(Solving::Tracing, 0),
            Event::Stage(Stage::Output),
        ];
        let mut overall = Overall::default();
        assert_eq!(overall.share(), None);
        let told: Vec<Option<String>> = events.iter().map(|event| overall.take(event)).collect();
        let ended: Vec<&str> = told.iter().flatten().filter_map(|words| words.split(' ').next()).collect();
        assert_eq!(ended, ["survey", "footprints", "heights"]);
        let mut overall = Overall::default();
        let shares: Vec<f64> = events
            .iter()
            .filter_map(|event| {
                overall.take(event);
                overall.share()
            })
            .collect();
        assert!(shares.is_sorted(), "{shares:?}");
        assert_eq!((shares[0], shares[1], shares[7]), (0.0, 0.04, 0.65));
    }
}
