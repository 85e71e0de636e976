//! Answers that take PROJ and GDAL milliseconds, kept by their questions: a file's CRS, and the way from it to the project's, are
//! asked for once per file and thread.

use std::collections::HashMap;
use std::sync::{LazyLock, Mutex, PoisonError};

/// A run has to do with a handful of systems; of more answers than this all are forgotten.
const MOST: usize = 64;
/// Longer questions, bytes, are asked each time: PROJ's own descriptions have some kilobytes.
const LONGEST: usize = 1 << 16;

/// Answers by question.
pub(super) struct Kept<T>(LazyLock<Mutex<HashMap<String, T>>>);

impl<T: Clone> Kept<T> {
    pub(super) const fn new() -> Self {
        Self(LazyLock::new(Mutex::default))
    }

    /// The answer that is kept, or a new one; failures are not kept.
    pub(super) fn get<E>(&self, question: &str, ask: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(answer) = kept().get(question) {
            return Ok(answer.clone());
        }
        let answer = ask()?;
        if question.len() <= LONGEST {
            let mut kept = kept();
            if kept.len() >= MOST {
                kept.clear();
            }
            kept.insert(question.to_owned(), answer.clone());
        }
        Ok(answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_asked_for_once_and_a_failure_again() {
        static KEPT: Kept<usize> = Kept::new();
        assert_eq!(KEPT.get("a", || Err("not yet")), Err("not yet"));
        assert_eq!(KEPT.get("a", || Ok::<_, ()>(1)), Ok(1));
        assert_eq!(KEPT.get("a", || Ok::<_, ()>(2)), Ok(1));
        for i in 0..2 * MOST {
            assert_eq!(KEPT.get(&i.to_string(), || Ok::<_, ()>(i)), Ok(i));
        }
        assert!(KEPT.0.lock().unwrap().len() <= MOST);
    }
}
