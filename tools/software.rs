//! This program, as results name it.

use files::provenance::Software;

/// Name and version of the program `fringetool`.
pub const FRINGETOOL: Software =
    Software { name: "fringetool", version: env!("CARGO_PKG_VERSION"), commit: env!("FRINGECELL_COMMIT") };
