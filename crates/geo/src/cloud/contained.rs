//! Work of a decoder that is not ours, and that panics on data that contradict themselves: the panic becomes an error, and is not
//! printed. Only for decoders whose data cannot be checked without decoding them, and that work on the thread that calls them.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    static IS_QUIET: Cell<bool> = const { Cell::new(false) };
}

/// The outcome, or the words that it ended with.
pub(super) fn contained<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let usual = take_hook();
        set_hook(Box::new(move |panic| {
            if !IS_QUIET.get() {
                usual(panic);
            }
        }));
    });
    let was_quiet = IS_QUIET.replace(true);
    // What the work was about is dropped with it.
    let outcome = catch_unwind(AssertUnwindSafe(work));
    IS_QUIET.set(was_quiet);
    outcome.map_err(|panic| {
        let words = panic.downcast_ref::<String>().map(String::as_str);
        words.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("its decoder gave up").to_owned()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_an_error_and_work_goes_on() {
        assert_eq!(contained(|| 7), Ok(7));
        let nothing: [u8; 0] = [];
        let words = contained(|| nothing[nothing.len()..][0]).unwrap_err();
        assert!(words.contains("out of bounds"), "{words}");
        assert_eq!(contained(|| -> u8 { panic!("no") }), Err("no".to_owned()));
        assert!(!IS_QUIET.get());
    }
}
