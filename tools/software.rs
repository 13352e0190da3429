//! This program, as results name it.

use files::provenance::Software;

/// Name and version of the program `fringetool`.
pub const FRINGETOOL: Software =
    Software { name: "fringetool", version: env!("CARGO_PKG_VERSION"), commit: env!("FRINGECELL_COMMIT") };

/// Version, commit and features on one line, for `--version`.
pub const VERSION_LINE: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    " (",
    env!("FRINGECELL_COMMIT"),
    "), features: ",
    env!("FRINGECELL_FEATURES")
);
