//! What took time to find and will be asked for again: kept in memory, as much as there is room for.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Room for one thing.
type Slot<T> = Arc<Mutex<Option<Arc<T>>>>;

/// Things by their keys, within a limit.
#[derive(Debug)]
pub struct Kept<K, T> {
    limit: usize,
    inside: Mutex<Inside<K, T>>,
}

#[derive(Debug)]
struct Inside<K, T> {
    slots: HashMap<K, KeptEntry<T>>,
    weight: usize,
    clock: u64,
}

#[derive(Debug)]
struct KeptEntry<T> {
    used: u64,
    weight: usize,
    slot: Slot<T>,
}

impl<K: Clone + Eq + Hash, T> Kept<K, T> {
    /// Keeps up to a number of things, or as much as they weigh together where they are given with a weight.
    #[must_use]
    pub fn up_to(limit: usize) -> Self {
        Self { limit, inside: Mutex::new(Inside { slots: HashMap::new(), weight: 0, clock: 0 }) }
    }

    /// The thing, made now if it is not kept; what several threads ask for at once is made by one of them. The one that was
    /// used least lately makes room; a failure is not kept.
    ///
    /// # Errors
    /// Whatever making it fails with.
    pub fn get<E>(&self, key: &K, make: impl FnOnce() -> Result<T, E>) -> Result<Arc<T>, E> {
        // Things are whole or absent, so a panic elsewhere leaves nothing half-done here.
        let slot = self.inside().slot(key, self.limit);
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(thing) = &*slot {
            return Ok(Arc::clone(thing));
        }
        let thing = Arc::new(make()?);
        *slot = Some(Arc::clone(&thing));
        Ok(thing)
    }

    /// The thing, if it is kept.
    #[must_use]
    pub fn find(&self, key: &K) -> Option<Arc<T>> {
        let slot = Arc::clone(&self.inside().slots.get(key)?.slot);
        let slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        slot.clone()
    }

    /// Keeps a thing of some weight if there is room for it; nothing makes room. Where everything is asked for in turn, what
    /// came first serves better than what came last.
    pub fn add(&self, key: K, thing: T, weight: usize) {
        let mut inside = self.inside();
        if inside.weight + weight <= self.limit && !inside.slots.contains_key(&key) {
            inside.weight += weight;
            let slot = Arc::new(Mutex::new(Some(Arc::new(thing))));
            inside.slots.insert(key, KeptEntry { used: 0, weight, slot });
        }
    }

    fn inside(&self) -> MutexGuard<'_, Inside<K, T>> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<K: Clone + Eq + Hash, T> Inside<K, T> {
    fn slot(&mut self, key: &K, limit: usize) -> Slot<T> {
        self.clock += 1;
        if !self.slots.contains_key(key) {
            if self.weight >= limit {
                let oldest = self.slots.iter().min_by_key(|(_, place)| place.used).map(|(key, _)| key.clone());
                let gone = oldest.and_then(|key| self.slots.remove(&key));
                self.weight -= gone.map_or(0, |place| place.weight);
            }
            self.slots.insert(key.clone(), KeptEntry { used: 0, weight: 1, slot: Slot::default() });
            self.weight += 1;
        }
        let place = self.slots.get_mut(key).expect("it is there by now");
        place.used = self.clock;
        Arc::clone(&place.slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_used_last_is_made_once_and_what_was_not_makes_room() {
        let kept = Kept::up_to(2);
        let n_made = std::cell::Cell::new(0);
        let make = |name: &'static str| {
            let found = kept.get(&name, || {
                n_made.set(n_made.get() + 1);
                Ok::<_, ()>(name.len())
            });
            assert_eq!(*found.unwrap(), name.len());
            n_made.get()
        };
        assert_eq!(["a", "bb", "a", "bb"].map(make), [1, 2, 2, 2]);
        // "a" was used before "bb", so it goes.
        assert_eq!(["ccc", "bb", "a"].map(make), [3, 3, 4]);
    }

    #[test]
    fn what_could_not_be_made_is_tried_again() {
        let kept = Kept::up_to(2);
        assert_eq!(kept.get(&1, || Err::<i32, _>("not yet")), Err("not yet"));
        assert!(kept.find(&1).is_none());
        assert_eq!(*kept.get(&1, || Ok::<_, ()>(7)).unwrap(), 7);
        assert_eq!(kept.find(&1).as_deref(), Some(&7));
    }

    #[test]
    fn what_is_added_stays_and_what_there_is_no_room_for_is_not_kept() {
        let kept = Kept::up_to(100);
        [(1, 60), (2, 60), (3, 40), (4, 1)].into_iter().for_each(|(key, weight)| kept.add(key, key, weight));
        assert_eq!([1, 2, 3, 4].map(|key| kept.find(&key).is_some()), [true, false, true, false]);
        let none = Kept::up_to(0);
        none.add(1, 1, 1);
        assert!(none.find(&1).is_none());
    }
}
