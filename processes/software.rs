//! This program, as results name it.

use files::provenance::Software;

/// Name and version of the program `fringecell`.
pub const FRINGECELL: Software =
    Software { name: "fringecell", version: env!("CARGO_PKG_VERSION"), commit: env!("FRINGECELL_COMMIT") };
