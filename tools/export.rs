//! `fringetool export`: a rig file for OpenCV, ROS or Kalibr.

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use files::atomic;
use files::foreign_rig::{camchain_text, camera_info_texts};
use files::opencv::{Language, pair_text};
use files::rig_file::read_rig;
use fringe::geometry::camera::Camera;
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
    /// File to write (`.yml`, `.yaml` or `.xml`) for one pair, or for the chain of Kalibr; or a folder that gets a file `<pair>.yml` for
    /// each pair, of ROS `<pair>-<view>.yaml`.
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
    /// `camera_info` of ROS: a folder with two files for each pair, in metres.
    Ros,
    /// `camchain.yaml` of Kalibr: all cameras in one file, in metres.
    Kalibr,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let language = language(&args.out);
    match (args.format, language) {
        (Format::Ros, Some(_)) => {
            bail!("--out {}: ROS has a file for each camera: name a folder", args.out.display())
        }
        (Format::Kalibr, None | Some(Language::Xml)) => {
            bail!("--out {}: Kalibr has one file: name it, such as camchain.yaml", args.out.display())
        }
        _ => {}
    }
    let folder = language.is_none().then_some(args.out.as_path());
    let file = language.is_some().then_some(args.out.as_path());
    check_outputs(&[("--out", file), ("--json", args.json.as_deref())], &[&args.rig], folder)?;
    let rig_file = read_rig(&args.rig)?;
    let texts = match args.format {
        Format::Opencv => opencv(args, &rig_file.rig, language)?,
        Format::Ros => ros(args, &rig_file.rig)?,
        Format::Kalibr => vec![(args.out.clone(), kalibr(args, &rig_file.rig)?)],
    };
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

/// A file for each pair, or the one file.
fn opencv(args: &Args, rig: &Rig, language: Option<Language>) -> Result<Vec<(PathBuf, String)>> {
    let of_pair = |pair: &Pair| {
        let path = match language {
            Some(_) => args.out.clone(),
            None => args.out.join(format!("{}.yml", pair.name)),
        };
        let text = text(rig, pair, language.unwrap_or(Language::Yaml))
            .with_context(|| format!("{}: pair \"{}\"", args.rig.display(), pair.name))?;
        Ok((path, text))
    };
    pairs(args, rig)?.iter().map(of_pair).collect()
}

/// Two files for each pair.
fn ros(args: &Args, rig: &Rig) -> Result<Vec<(PathBuf, String)>> {
    let mut texts = Vec::new();
    for pair in pairs(args, rig)? {
        let (left, right) = views(rig, &pair)?;
        let both = camera_info_texts((&pair.left, left), (&pair.right, right))
            .with_context(|| format!("{}: pair \"{}\"", args.rig.display(), pair.name))?;
        for (name, text) in [&pair.left, &pair.right].into_iter().zip(both) {
            texts.push((args.out.join(format!("{}-{name}.yaml", pair.name)), text));
        }
    }
    Ok(texts)
}

/// All cameras of the rig, or those of the chosen pairs, in the order of the rig.
fn kalibr(args: &Args, rig: &Rig) -> Result<String> {
    let chosen = if args.pair.is_empty() { Vec::new() } else { pairs_by_name(args, rig)? };
    let wanted = |name: &str| chosen.is_empty() || chosen.iter().any(|p| p.left == name || p.right == name);
    let cameras: Vec<(&str, &Camera)> = rig
        .cameras
        .iter()
        .filter(|named| wanted(&named.name))
        .map(|named| (named.name.as_str(), &named.camera))
        .collect();
    camchain_text(&cameras).map_err(|(name, what)| {
        anyhow::anyhow!(
            "{}: camera \"{name}\" has {what}, which Kalibr's radtan model lacks; export it for OpenCV or ROS",
            args.rig.display()
        )
    })
}

/// Whether the file's ending is one of the format; a folder has none.
fn language(out: &Path) -> Option<Language> {
    match out.extension()?.to_str()?.to_ascii_lowercase().as_str() {
        "yml" | "yaml" => Some(Language::Yaml),
        "xml" => Some(Language::Xml),
        _ => None,
    }
}

/// The pairs that were asked for.
fn pairs_by_name(args: &Args, rig: &Rig) -> Result<Vec<Pair>> {
    let known: Vec<&str> = rig.pairs.iter().map(|p| p.name.as_str()).collect();
    if let Some(unknown) = args.pair.iter().find(|name| !known.contains(&name.as_str())) {
        bail!("--pair {unknown}: {} has no such pair; known: {}", args.rig.display(), known.join(", "));
    }
    let asked = |pair: &&Pair| args.pair.is_empty() || args.pair.contains(&pair.name);
    Ok(rig.pairs.iter().filter(asked).cloned().collect())
}

fn pairs(args: &Args, rig: &Rig) -> Result<Vec<Pair>> {
    let pairs = pairs_by_name(args, rig)?;
    if pairs.is_empty() {
        bail!("{}: has no [[pair]]; these files describe two views, so add one", args.rig.display());
    }
    if pairs.len() > 1 && language(&args.out).is_some() {
        bail!(
            "--out {}: a file contains one pair, there are {} ({}); choose one with --pair, or name a folder",
            args.out.display(),
            pairs.len(),
            pairs.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ")
        );
    }
    Ok(pairs)
}

/// Both views of a pair.
fn views<'a>(rig: &'a Rig, pair: &Pair) -> Result<(&'a Camera, &'a Camera)> {
    let left = rig.camera(&pair.left).context("its left camera is not in the rig file")?;
    let right = rig.device(&pair.right);
    Ok((left, right.context("its right view is not in the rig file")?))
}

fn text(rig: &Rig, pair: &Pair, language: Language) -> Result<String> {
    let (left, right) = views(rig, pair)?;
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
