//! The monitor: serves the live page and the metrics. It reads what the supervisor tells it and holds nothing of the dataflow,
//! so it may end at any time; commands of the page go over the command socket, like those of every other client.

mod assets;
mod cloud;
mod connection;
mod guard;
mod model;
mod performance;
mod pictures;
mod reports;
mod routes;
mod updates;
mod view;

use crate::stage::check_files;
use anyhow::{Context, Result, bail, ensure};
use cell::Options;
use guard::Guard;
use ipc::cell::CellName;
use ipc::os;
use model::Model;
use std::io::Read as _;
use std::net::TcpListener;
use std::os::fd::AsFd as _;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Shortest and longest token, characters.
const TOKEN_CHARS: std::ops::RangeInclusive<usize> = 16..=256;

/// Longest file with a token, bytes; a device may have no end.
const MAX_TOKEN_FILE: u64 = 4096;

/// Arguments of the hidden subcommand `monitor`, written by the supervisor. Standard input is the socket that listens, standard
/// output the one over which the supervisor reports.
#[derive(Debug, Clone, clap::Args)]
pub struct MonitorArgs {
    /// Name of the cell.
    #[arg(long, value_name = "NAME")]
    cell: String,
    /// The host of the cell that this computer is.
    #[arg(long)]
    host: Option<String>,
    /// Path of the configuration.
    #[arg(long)]
    config: PathBuf,
    /// Hashes of all files that the supervisor read; the monitor must read the same.
    #[arg(long, value_delimiter = ',')]
    files: Vec<String>,
    /// Process id of the supervisor.
    #[arg(long)]
    parent: u32,
    /// Output folder of the run, for the reports of its parts.
    #[arg(long)]
    out: Option<PathBuf>,
    /// File with the token that viewers must know.
    #[arg(long)]
    page_token: Option<PathBuf>,
    /// Serve nothing but the metrics.
    #[arg(long)]
    metrics_only: bool,
    /// Show that the part is simulated.
    #[arg(long)]
    demo: bool,
}

/// Serves until the supervisor ends.
///
/// # Errors
/// The files of the cell have changed, or the system refuses threads or sockets.
pub fn run(args: &MonitorArgs) -> Result<()> {
    os::ignore_interrupts();
    ensure!(os::die_with_parent(args.parent)?, "the supervisor (pid {}) has ended", args.parent);
    // Cycles come first, whoever looks at them.
    let _refused = os::yield_to_others();
    let options = Options { cell: Some(args.cell.clone()), host: args.host.clone(), ..Options::default() };
    let cell = devices::load(&args.config, &options)?;
    check_files(&cell, &args.files)?;
    let token = args.page_token.as_deref().map(read_token).transpose()?;
    let listener = TcpListener::from(std::io::stdin().as_fd().try_clone_to_owned()?);
    listener.set_nonblocking(true)?;
    let updates = UnixStream::from(std::io::stdout().as_fd().try_clone_to_owned()?);
    let guard = Guard::new(token, &listener.local_addr()?);
    let socket = CellName::new(&cell.name)?.socket();
    let model = Arc::new(Model::new(cell, args, socket, updates.try_clone()?));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let ended = updates::listen(&model, updates)?;
        let router = if args.metrics_only { routes::metrics(&model) } else { routes::page(&model, guard) };
        let listener = tokio::net::TcpListener::from_std(listener).context("the socket that listens")?;
        tokio::select! {
            () = connection::serve(&listener, router, !args.metrics_only) => {}
            _ = ended => {}
        }
        // The page hears that the cell has ended.
        tokio::time::sleep(connection::LAST_WORDS).await;
        Ok(())
    })
}

/// Reads the token that viewers must know.
///
/// # Errors
/// No file, or no token in it.
pub fn read_token(file: &Path) -> Result<String> {
    let mut text = String::new();
    std::fs::File::open(file)
        .and_then(|opened| opened.take(MAX_TOKEN_FILE + 1).read_to_string(&mut text))
        .with_context(|| format!("--page-token {}: cannot read this file", file.display()))?;
    if text.len() as u64 > MAX_TOKEN_FILE {
        bail!(
            "--page-token {}: longer than {MAX_TOKEN_FILE} bytes, which is the limit; name a file that holds the token and nothing else",
            file.display()
        );
    }
    let token = text.trim();
    let plain = token.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_".contains(&b));
    if !plain || !TOKEN_CHARS.contains(&token.len()) {
        bail!(
            "--page-token {}: a token has {} to {} letters, digits, '-' or '_', and nothing else stands in the file; make one \
             with `openssl rand -hex 16`",
            file.display(),
            TOKEN_CHARS.start(),
            TOKEN_CHARS.end()
        );
    }
    Ok(token.to_owned())
}
