//! `fringetool export`: the pairs of a rig file in OpenCV's keys.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use files::atomic;
use files::opencv::{Language, pair_text};
use files::rig_file::read_rig;
use fringe::geometry::rig::{Pair, Rig};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Rig file (TOML, docs/formats.md).
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Format of the result.
    #[arg(long, value_enum, default_value_t = Format::Opencv)]
    format: Format,
    /// File to write (`.yml`, `.yaml` or `.xml`) for one pair, or a folder that gets a file `<pair>.yml` for each pair.
    #[arg(long, value_name = "FILE|DIR")]
    out: PathBuf,
    /// Only these pairs; by default all.
    #[arg(long, value_name = "NAME")]
    pair: Vec<String>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What other programs read.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// M1 D1 M2 D2 R T E F R1 R2 P1 P2 Q as OpenCV's FileStorage writes them.
    Opencv,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let Format::Opencv = args.format;
    let language = language(&args.out);
    let folder = language.is_none().then_some(args.out.as_path());
    let file = language.is_some().then_some(args.out.as_path());
    check_outputs(&[("--out", file), ("--json", args.json.as_deref())], &[&args.rig], folder)?;
    let rig_file = read_rig(&args.rig)?;
    let pairs = pairs(args, &rig_file.rig)?;
    let mut texts = Vec::new();
    for pair in &pairs {
        let path = match language {
            Some(_) => args.out.clone(),
            None => args.out.join(format!("{}.yml", pair.name)),
        };
        let text = text(&rig_file.rig, pair, language.unwrap_or(Language::Yaml))
            .with_context(|| format!("{}: pair \"{}\"", args.rig.display(), pair.name))?;
        texts.push((path, text));
    }
    if let Some(folder) = folder {
        atomic::create_dir(folder)?;
    }
    for (path, text) in &texts {
        atomic::write(path, text.as_bytes())?;
        println!("{}", path.display());
    }
    let files: Vec<&Path> = texts.iter().map(|(path, _)| path.as_path()).collect();
    emit(args.json.as_deref(), &serde_json::json!({ "files": files }))?;
    Ok(Outcome::Done)
}

/// Whether the file's ending is one of the format; a folder has none.
fn language(out: &Path) -> Option<Language> {
    match out.extension()?.to_str()?.to_ascii_lowercase().as_str() {
        "yml" | "yaml" => Some(Language::Yaml),
        "xml" => Some(Language::Xml),
        _ => None,
    }
}

fn pairs(args: &Args, rig: &Rig) -> Result<Vec<Pair>> {
    let known: Vec<&str> = rig.pairs.iter().map(|p| p.name.as_str()).collect();
    if let Some(unknown) = args.pair.iter().find(|name| !known.contains(&name.as_str())) {
        bail!("--pair {unknown}: {} has no such pair; known: {}", args.rig.display(), known.join(", "));
    }
    let asked = |pair: &&Pair| args.pair.is_empty() || args.pair.contains(&pair.name);
    let pairs: Vec<Pair> = rig.pairs.iter().filter(asked).cloned().collect();
    if pairs.is_empty() {
        bail!("{}: has no [[pair]]; OpenCV's keys describe two views, so add one", args.rig.display());
    }
    if pairs.len() > 1 && language(&args.out).is_some() {
        bail!(
            "--out {}: a file contains one pair, there are {} ({}); choose one with --pair, or name a folder",
            args.out.display(),
            pairs.len(),
            known.join(", ")
        );
    }
    Ok(pairs)
}

fn text(rig: &Rig, pair: &Pair, language: Language) -> Result<String> {
    let left = rig.camera(&pair.left).context("its left camera is not in the rig file")?;
    let right = rig.camera(&pair.right).or_else(|| rig.projector(&pair.right));
    let right = right.context("its right view is not in the rig file")?;
    for (name, camera) in [(&pair.left, left), (&pair.right, right)] {
        if camera.skew != 0.0 {
            eprintln!(
                "\"{name}\" has the skew {} px: it is written in M, but OpenCV's functions ignore it",
                camera.skew
            );
        }
    }
    Ok(pair_text(left, right, language)?)
}
