//! `fringecell demo`: the cell of `configs/demo.toml`, which the binary carries with it, measured against the truth.

use crate::kernels;
use crate::print;
use crate::run::{self, RunArgs};
use anyhow::{Context, Result};
use files::atomic;
use files::cycle_record::Kept;
use std::path::{Path, PathBuf};

/// The files of the demo cell, as they are in the repository.
const FILES: [(&str, &str); 4] = [
    ("demo.toml", include_str!("../configs/demo.toml")),
    ("demo-rig.toml", include_str!("../configs/demo-rig.toml")),
    ("complex-artefact.plan.toml", include_str!("../configs/complex-artefact.plan.toml")),
    ("complex-artefact.scene.toml", include_str!("../configs/complex-artefact.scene.toml")),
];

/// What lies in the folder.
const GUIDE: &str = "  report.html   open it in a browser
  cloud.ply     the fused cloud of the last cycle
  result.json   the last cycle; results/ has all of them
  trace.json    open it at https://ui.perfetto.dev
  config/       the cell, to change and `fringecell run`";

/// Arguments of `demo`.
#[derive(Debug, Clone, clap::Args)]
pub struct DemoArgs {
    /// Folder for cloud.ply, result.json, report.html and trace.json.
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    pub out: PathBuf,
    /// Number of cycles instead of the configuration's.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    pub cycles: Option<u32>,
    /// Name of the cell.
    #[arg(long, default_value = "demo")]
    pub cell: String,
}

/// Runs the demo; the exit code says whether every feature passed.
pub fn demo(args: &DemoArgs) -> Result<u8> {
    // Before anything is written.
    ipc::cell::CellName::new(&args.cell)?;
    let config = write_files(&args.out.join("config"))?;
    let run_args = RunArgs {
        config: config.clone(),
        cycles: args.cycles,
        out: Some(args.out.clone()),
        record: None,
        cycle_record: None,
        keep: Kept::Hashes,
        cell: Some(args.cell.clone()),
        metrics: None,
        serve: false,
        trace: None,
    };
    // The only place where the truth of the scene is looked at; what measures never sees it.
    let truth = kernels::scene(&files::config::Config::load(&config)?)?.truth().clone();
    let code = run::run(&run_args, Some(&truth))?;
    let folder = args.out.canonicalize().unwrap_or_else(|_| args.out.clone());
    print::say(&format!("files in {}:\n{GUIDE}", folder.display()));
    Ok(code)
}

/// Writes the configuration beside the results, so that it can be read, changed and run again.
fn write_files(folder: &Path) -> Result<PathBuf> {
    atomic::create_dir(folder)?;
    for (name, text) in FILES {
        atomic::write(&folder.join(name), text.as_bytes())
            .context("the demo needs a place to write to; see --out")?;
    }
    Ok(folder.join(FILES[0].0))
}
