//! Panics on request: what becomes of a cell when one of its processes panics can be tried at any time.

use std::path::Path;

/// Variable that names the folder of the requests.
const FOLDER: &str = "FRINGECELL_PANIC_DRILL";

/// Panics if the folder holds a file with the name of this process (`decode-cam1` for `decode/cam1`). The file is removed
/// first: one request is one panic.
pub fn panic_if_requested(process: &str) {
    let Some(folder) = std::env::var_os(FOLDER) else { return };
    let request = Path::new(&folder).join(process.replace('/', "-"));
    assert!(std::fs::remove_file(request).is_err(), "a panic was requested");
}
