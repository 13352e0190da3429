//! Build script of all crates whose tests read data beside the repository or need another program: where `../shared/data` or the
//! program is absent, these tests are compiled as ignored, so that the summary counts them.

// The pure crates' lints are for their own code; a build script looks at the disk and prints.
#![allow(clippy::disallowed_methods, clippy::disallowed_macros)]

use std::path::Path;

/// Sets `shared_data` where the data are there, and `xmllint` where documents can be held against a schema.
pub fn main() {
    look_for("xmllint", &["xmllint"]);
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

/// Sets a condition where a program of one of these names is found; elsewhere the tests that need it are compiled as ignored.
pub fn look_for(condition: &str, names: &[&str]) {
    println!("cargo::rustc-check-cfg=cfg({condition})");
    println!("cargo::rerun-if-env-changed=PATH");
    let path = std::env::var_os("PATH").unwrap_or_default();
    if std::env::split_paths(&path).any(|folder| names.iter().any(|name| folder.join(name).is_file())) {
        println!("cargo::rustc-cfg={condition}");
    }
}
