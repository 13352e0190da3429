//! `fringetool cameras`: which GenICam cameras answer on the network and, in a program with Aravis, on USB.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::Result;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Write the list as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Searches all network adapters, and USB if the program can, and prints what answers; no camera at all is exit code 1.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    let cameras = devices::find_cameras()?;
    let text = args.json.as_deref().is_none_or(|path| path != "-");
    if text && cameras.is_empty() {
        println!("no camera answers; is it powered and in the network of an adapter of this computer?");
    }
    for camera in cameras.iter().filter(|_| text) {
        println!(
            "{:15}  serial {:16}  name {:16}  {} {} {}  {}",
            camera.address.map_or_else(|| "USB".to_owned(), |address| address.to_string()),
            camera.serial,
            camera.user_name,
            camera.manufacturer,
            camera.model,
            camera.version,
            camera.mac
        );
    }
    emit(args.json.as_deref(), &serde_json::json!({ "cameras": cameras }))?;
    Ok(if cameras.is_empty() { Outcome::LimitFailed } else { Outcome::Done })
}
