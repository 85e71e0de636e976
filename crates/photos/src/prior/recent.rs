//! What was read last and will be asked for again soon: photos are neighbours of several views.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, PoisonError};

use super::PriorError;

/// Room for one thing.
type Slot<T> = Arc<Mutex<Option<Arc<T>>>>;

/// The things used last, a limited number of them.
#[derive(Debug)]
pub(super) struct Recent<K, T> {
    limit: usize,
    kept: Mutex<Kept<K, T>>,
}

#[derive(Debug)]
struct Kept<K, T> {
    slots: HashMap<K, (u64, Slot<T>)>,
    clock: u64,
}

impl<K: Clone + Eq + Hash, T> Recent<K, T> {
    /// Keeps up to `limit` things.
    pub(super) fn new(limit: usize) -> Self {
        Self { limit, kept: Mutex::new(Kept { slots: HashMap::new(), clock: 0 }) }
    }

    /// The thing, read now if it is not kept; what several threads ask for at once is read by one of them.
    pub(super) fn get(&self, key: &K, read: impl FnOnce() -> Result<T, PriorError>) -> Result<Arc<T>, PriorError> {
        // Things are whole or absent, so a panic elsewhere leaves nothing half-done here.
        let slot = self.kept.lock().unwrap_or_else(PoisonError::into_inner).slot(key, self.limit);
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(thing) = &*slot {
            return Ok(Arc::clone(thing));
        }
        let thing = Arc::new(read()?);
        *slot = Some(Arc::clone(&thing));
        Ok(thing)
    }
}

impl<K: Clone + Eq + Hash, T> Kept<K, T> {
    fn slot(&mut self, key: &K, limit: usize) -> Slot<T> {
        self.clock += 1;
        if self.slots.len() >= limit && !self.slots.contains_key(key) {
            let oldest = self.slots.iter().min_by_key(|(_, (used, _))| *used).map(|(key, _)| key.clone());
            oldest.map(|key| self.slots.remove(&key));
        }
        let (used, slot) = self.slots.entry(key.clone()).or_insert_with(|| (0, Slot::default()));
        *used = self.clock;
        Arc::clone(slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_used_last_is_read_once_and_what_was_not_makes_room() {
        let recent = Recent::new(2);
        let n_read = std::cell::Cell::new(0);
        let read = |name: &'static str| {
            let found = recent.get(&name, || {
                n_read.set(n_read.get() + 1);
                Ok(name.len())
            });
            assert_eq!(*found.unwrap(), name.len());
            n_read.get()
        };
        assert_eq!(["a", "bb", "a", "bb"].map(read), [1, 2, 2, 2]);
        // "a" was used before "bb", so it goes.
        assert_eq!(["ccc", "bb", "a"].map(read), [3, 3, 4]);
    }

    #[test]
    fn what_could_not_be_read_is_tried_again() {
        let recent = Recent::new(2);
        let fail = || Err(PriorError::Config { problem: String::new(), hint: String::new() });
        assert!(recent.get(&1, fail).is_err());
        assert_eq!(*recent.get(&1, || Ok(7)).unwrap(), 7);
    }
}
