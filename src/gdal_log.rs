//! Where GDAL's messages go: to the log. It would otherwise print to stderr on its own account.

use std::sync::Once;

/// Sends GDAL's messages to the log, from the first call on. Errors that matter also come back as error values.
pub(crate) fn route_messages() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        gdal::config::set_error_handler(|class, number, message| {
            tracing::debug!(?class, number, "GDAL: {message}");
        });
    });
}
