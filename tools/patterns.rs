//! `fringetool patterns`: the images that the projectors of a cell show, to flash or to show by other means.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::Result;
use files::config::Config;
use files::pattern_files::{PATTERNS_FILE, PatternFiles, write_patterns};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Cell configuration (TOML, docs/formats.md) whose sequences are drawn.
    #[arg(value_name = "CONFIG")]
    config: PathBuf,
    /// New folder for the images and `patterns.toml`, which states what each of them is (docs/formats.md).
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write frames of black and white alone with one bit a pixel.
    #[arg(long)]
    one_bit: bool,
    /// Also write images of 24 bits (BMP) that hold several patterns, as boards take them into flash; of projectors with the
    /// driver "lightcrafter" they are written anyway.
    #[arg(long)]
    packed: bool,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let config = Config::load(&args.config)?;
    check_outputs(&[("--json", args.json.as_deref())], &config.paths(), Some(&args.out))?;
    let how = PatternFiles { one_bit: args.one_bit, packed: args.packed };
    let list = write_patterns(&args.out, &config.cell.projectors, how)?;
    for projector in &list.projector {
        let images = match projector.image.len() {
            0 => String::new(),
            count => format!(", in {count} images of 24 bits"),
        };
        println!(
            "{}: {} frames of {} × {} px{images}",
            projector.name,
            projector.frame.len(),
            projector.width_px,
            projector.height_px
        );
    }
    println!("{}: what each of them is", args.out.join(PATTERNS_FILE).display());
    emit(args.json.as_deref(), &list)?;
    Ok(Outcome::Done)
}
