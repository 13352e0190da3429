//! `fringecell demo`: runs the cell of `configs/demo.toml`, which is part of the program, and compares with the truth.

use crate::client;
use crate::run::{self, RunArgs};
use crate::terminal;
use anyhow::{Context, Result, bail};
use cell::Retention;
use files::atomic;
use files::bundled::DEMO;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// List of the files in the output folder.
const GUIDE: &str = "  report.html   the report; open it in a browser
  cloud.ply     the fused cloud of the last cycle
  result.json   the result of the last cycle; results/ has all cycles
  trace.json    the times of all stages; open it at https://ui.perfetto.dev
  config/       the configuration, to edit and start with `fringecell run`";

/// Command-line arguments of `fringecell demo`.
#[derive(Debug, Clone, clap::Args)]
pub struct DemoArgs {
    /// Write result.json, cloud.ply, report.html and trace.json to this folder.
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    pub out: PathBuf,
    /// Number of cycles; overrides the configuration.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub cycles: Option<u32>,
    /// Name of the cell.
    #[arg(long, value_name = "NAME", default_value = "demo")]
    pub cell: String,
    /// Serve the live page at this address, for example 127.0.0.1:8080; port 0: any free port.
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub page: Option<SocketAddr>,
    /// File with a token of 16 to 256 characters that viewers of the page must know; needed where other machines can reach it.
    #[arg(long, value_name = "FILE", requires = "page")]
    pub page_token: Option<PathBuf>,
    /// Keep the cell running after its cycles, for jobs from the page, until Ctrl-C.
    #[arg(long, requires = "page")]
    pub stay: bool,
    /// Write counts and results of all cycles as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Runs the demo; exit code 0 if every feature passes.
pub fn demo(args: &DemoArgs) -> Result<u8> {
    // Check the name before writing any file.
    client::refuse_running(&args.cell)?;
    let config = write_files(&args.out.join("config"), files::guard::replaces_anything())?;
    let settings = files::config::Config::load(&config)?;
    let cycles = args.cycles.or(settings.cell.cycles);
    let run_args = RunArgs {
        config: config.clone(),
        cycles: args.cycles,
        out: Some(args.out.clone()),
        record: None,
        cycle_record: None,
        retain: Retention::Hashes,
        cell: Some(args.cell.clone()),
        page: args.page,
        page_token: args.page_token.clone(),
        metrics: None,
        allow_remote: false,
        serve: args.stay,
        host: None,
        first_cycles: args.stay.then(|| cycles.map_or(1, u64::from)),
        trace: None,
        json: args.json.clone(),
    };
    // The truth of the scene is used only here; the stages never read it.
    let twin = settings.twin.context("the demo has no [twin]")?;
    let truth = files::scene_file::parse_scene(&twin.scene)?.truth().clone();
    let code = run::run(&run_args, Some(&truth))?;
    let folder = args.out.canonicalize().unwrap_or_else(|_| args.out.clone());
    terminal::print_line(&format!("files in {}:\n{GUIDE}", folder.display()));
    Ok(code)
}

/// Writes the configuration beside the results, to read, edit and run it again. One that was edited stays.
pub fn write_files(folder: &Path, force: bool) -> Result<PathBuf> {
    atomic::create_dir(folder)?;
    let differs = |(name, text): &(&str, &str)| {
        std::fs::read(folder.join(name)).is_ok_and(|bytes| bytes != text.as_bytes())
    };
    if let Some((name, _)) = DEMO.iter().find(|file| differs(file)).filter(|_| !force) {
        let (file, main) = (folder.join(name), folder.join(DEMO[0].0));
        bail!(
            "{}: differs from the one of the demo: edited, or of another version; run it with \"fringecell run {}\", \
             choose another folder with --out, or add --force to replace it",
            file.display(),
            main.display()
        );
    }
    for (name, text) in DEMO {
        atomic::write(&folder.join(name), text.as_bytes())
            .context("the demo cannot write its configuration; choose another folder with --out")?;
    }
    Ok(folder.join(DEMO[0].0))
}
