//! Where GDAL's messages go: to the log. It would otherwise print to stderr on its own account.

use std::cell::RefCell;
use std::sync::Once;

/// Warnings of libjpeg about pixels that it has made up because the file's are missing or garbled. That there
/// are bytes too many between pieces is harmless.
const MADE_UP: [&str; 3] = ["premature end of", "bad huffman code", "corrupt jpeg data: found marker"];

thread_local! {
    /// The last such warning of this thread: GDAL reads on the thread that asks.
    static DAMAGE: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Messages since the last time about pixels that are made up.
pub(crate) fn take_damage() -> Option<String> {
    DAMAGE.take()
}

/// Sends GDAL's messages to the log, from the first call on. Errors that matter also come back as error values.
pub(crate) fn route_messages() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        gdal::config::set_error_handler(|class, number, message| {
            tracing::debug!(?class, number, "GDAL: {message}");
            let words = message.to_ascii_lowercase();
            if MADE_UP.iter().any(|known| words.contains(known)) {
                // GDAL goes on to say how the warning could be made an error.
                DAMAGE.set(message.split(" (").next().map(str::to_owned));
            }
        });
    });
}
