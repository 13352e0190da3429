//! Gives the programs the commit from which they were built, which they state in every result, and the tests the knowledge
//! whether the data beside the repository are there.

#[path = "tests/build.rs"]
mod shared_data;

use std::path::Path;
use std::process::Command;

fn main() {
    shared_data::main();
    // The tests of the live page drive a browser.
    shared_data::look_for(
        "chromium",
        &["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"],
    );
    // The tests of the gateway use a client that is not ours, which has these commands.
    shared_data::look_for("asyncua", &["uals"]);
    // The tests of cameras by Aravis use its own simulated camera too.
    shared_data::look_for("fake_camera", &["arv-fake-gv-camera-0.8"]);
    // The tests of screens have a virtual one.
    shared_data::look_for("xvfb", &["Xvfb"]);
    // Only what may change the answer: sources, and where the commit of this working copy is written.
    for path in ["processes", "tools", "shared", "configs", "Cargo.toml", "Cargo.lock", "build.rs"] {
        println!("cargo:rerun-if-changed={path}");
    }
    for name in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--git-path", name]).filter(|path| Path::new(path).exists()) {
            println!("cargo:rerun-if-changed={path}");
        }
    }
    // Line tables and symbols are most of a program; every reader of them, the backtrace of a panic too, unpacks them.
    println!("cargo:rustc-link-arg-bins=-Wl,--compress-debug-sections=zlib");
    let commit = commit().unwrap_or_else(|| "unknown".to_owned());
    println!("cargo:rustc-env=FRINGECELL_COMMIT={commit}");
    // For `--version` of both programs.
    let (version, features) = (env!("CARGO_PKG_VERSION"), features());
    println!("cargo:rustc-env=FRINGECELL_VERSION_LINE={version} ({commit}), features: {features}");
}

/// The features that the programs are built with.
fn features() -> String {
    let set =
        std::env::vars().filter_map(|(name, _)| Some(name.strip_prefix("CARGO_FEATURE_")?.to_lowercase()));
    let mut names: Vec<String> = set.map(|name| name.replace('_', "-")).collect();
    names.sort();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// The commit, with `-dirty` where files differ from it; `None` without git, or in a copy that is no repository.
fn commit() -> Option<String> {
    // A copy unpacked inside of another repository is not that repository's commit.
    let top = git(&["rev-parse", "--show-toplevel"])?;
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).canonicalize().ok()?;
    if Path::new(&top).canonicalize().ok()? != here {
        return None;
    }
    git(&["describe", "--always", "--abbrev=12", "--dirty", "--exclude=*"])
}

/// One line from git; `None` where it is absent or refuses.
fn git(arguments: &[&str]) -> Option<String> {
    let output =
        Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    let text = String::from_utf8(output.stdout).ok()?;
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}
