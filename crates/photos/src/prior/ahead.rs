//! Many priors into the cache, one after the other.
//!
//! A network's views pass through three stages that overlap: while one lot is in the network, the next is decoded and
//! prepared on all cores, and the one before is stored.
//!
//! ```text
//! prepare   lot 1 | lot 2 | lot 3 | …
//! infer           | lot 1 | lot 2 | lot 3 …
//! store               | lot 1 | lot 2 | …
//! ```
//!
//! Two lots are in memory at a time, whatever the number of views.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use rayon::prelude::*;

use super::network::{NetworkPriors, Ready};
use super::{CacheKey, CachedPriors, PriorError, PriorSource as _};
use crate::onnx::Tensor;
use sizeup_survey::View;

/// Whether a view's prior was there already, or why there is none.
pub(super) type PriorOutcome = Result<bool, String>;

/// For sources that use all cores best with a view on each.
pub(super) fn one_by_one<S: CacheKey + Sync>(
    priors: &CachedPriors<S>,
    views: &[&View],
    done: &(dyn Fn() + Sync),
) -> Vec<PriorOutcome> {
    // Looked for one by one, just before: another process may have been there meanwhile.
    let compute = |view: &&View| {
        let is_kept = priors.is_kept(view)?;
        if !is_kept {
            priors.load(view)?;
        }
        Ok(is_kept)
    };
    let outcome = |view: &&View| {
        let outcome = compute(view).map_err(|e: PriorError| e.to_string());
        done();
        outcome
    };
    views.par_iter().with_max_len(1).map(outcome).collect()
}

/// A view on its way; nothing where its prior is kept already.
type PreparedPrior = Result<Option<Ready>, PriorError>;

/// Output of the network for a view, and its place in the list.
struct Inferred {
    place: usize,
    result: Result<(Ready, Vec<Tensor>), String>,
}

/// For networks: decoding, inference and storing overlap.
pub(super) fn in_stages(
    priors: &CachedPriors<NetworkPriors>,
    views: &[&View],
    done: &(dyn Fn() + Sync),
) -> Vec<PriorOutcome> {
    let lot = 2 * rayon::current_num_threads();
    let mut outcomes: Vec<PriorOutcome> = vec![Ok(true); views.len()];
    std::thread::scope(|scope| {
        let (to_network, prepared) = sync_channel::<(usize, Vec<PreparedPrior>)>(0);
        let (to_store, inferred) = sync_channel::<Inferred>(1);
        scope.spawn(move || infer(priors.source(), &prepared, &to_store));
        let storing = scope.spawn(|| store(priors, views, inferred, done));
        for (i, lot_of_views) in views.chunks(lot).enumerate() {
            let prepare = |view: &&View| prepare(priors, view, done);
            let ready: Vec<PreparedPrior> = lot_of_views.par_iter().with_max_len(1).map(prepare).collect();
            // Fails only where the network has panicked, which comes up at the end of the scope.
            if to_network.send((i * lot, ready)).is_err() {
                break;
            }
        }
        drop(to_network);
        outcomes = storing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    });
    outcomes
}

fn prepare(priors: &CachedPriors<NetworkPriors>, view: &View, done: &(dyn Fn() + Sync)) -> PreparedPrior {
    if priors.is_kept(view)? {
        done();
        return Ok(None);
    }
    priors.source().prepare(view).map(Some)
}

/// The second stage: one view after the other.
fn infer(network: &NetworkPriors, lots: &Receiver<(usize, Vec<PreparedPrior>)>, to_store: &SyncSender<Inferred>) {
    let inferred = |ready: Ready| Ok((network.infer(&ready)?, ready));
    for (first, lot) in lots {
        for (i, prepared) in lot.into_iter().enumerate() {
            let Some(ready) = prepared.transpose() else { continue };
            let result = ready.and_then(inferred).map(|(outputs, ready)| (ready, outputs));
            send(to_store, first + i, result.map_err(|error: PriorError| error.to_string()));
        }
    }
}

fn send(to_store: &SyncSender<Inferred>, place: usize, result: Result<(Ready, Vec<Tensor>), String>) {
    // Fails only where storing has panicked, which comes up when it is joined.
    let _ = to_store.send(Inferred { place, result });
}

/// The third stage; what never arrives was kept already.
fn store(
    priors: &CachedPriors<NetworkPriors>,
    views: &[&View],
    inferred: Receiver<Inferred>,
    done: &(dyn Fn() + Sync),
) -> Vec<PriorOutcome> {
    let mut outcomes: Vec<PriorOutcome> = vec![Ok(true); views.len()];
    for Inferred { place, result } in inferred {
        let view = views[place];
        outcomes[place] = result.and_then(|(ready, outputs)| {
            let prior = priors.source().finish(view, &ready.frame(), outputs).map_err(|e| e.to_string())?;
            let key = priors.key(view).map_err(|e| e.to_string())?;
            priors.keep(&key, &prior);
            Ok(false)
        });
        done();
    }
    outcomes
}
