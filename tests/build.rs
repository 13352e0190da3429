//! Build script of all crates whose tests read data beside the repository: where `../shared/data` is absent, these tests
//! are compiled as ignored, so that the summary counts them.

// The pure crates' lints are for their own code; a build script looks at the disk and prints.
#![allow(clippy::disallowed_methods, clippy::disallowed_macros)]

use std::path::Path;

/// Sets `shared_data` where the data are there.
pub fn main() {
    println!("cargo::rustc-check-cfg=cfg(shared_data)");
    let manifest = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets it");
    let root = Path::new(&manifest).ancestors().find(|folder| folder.join("Cargo.lock").exists());
    let data = root.expect("a workspace has a lock file").join("../shared/data/README.md");
    // Naming a file keeps cargo from running this after every change; the script itself is watched by cargo.
    println!("cargo::rerun-if-changed={}", data.display());
    if data.exists() {
        println!("cargo::rustc-cfg=shared_data");
    }
}
