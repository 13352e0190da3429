//! `fringetool serve-camera`: the cameras of a digital twin as GigE Vision cameras on this computer.

use crate::Outcome;
use anyhow::{Result, bail};
use cell::Options;
use devices::ServedTwin;
use devices::gige_simulator::Faults;
use fringe::decode::OrderEvent;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Configuration of a cell whose cameras are twins (TOML, docs/formats.md).
    #[arg(value_name = "CONFIG")]
    config: PathBuf,
    /// Address of the first camera; the others have the addresses after it.
    #[arg(long, default_value = "127.0.0.11")]
    address: Ipv4Addr,
    /// Address and port where the projectors take their commands.
    #[arg(long, default_value = "127.0.0.1:3957")]
    light: SocketAddr,
    /// Fault on the network, for tests: `drop=N`, `duplicate=N` or `swap=N` (every N-th packet), `ignore-trigger=N`
    /// (every N-th trigger), `no-resend`; of the order of the frames in every cycle: `lost=K` or `twice=K` (from frame K on each shows the
    /// next pattern, or the one before), `repeat=K` (frame K shows the one before), `exchange=K` (frames K and K + 1). `storm=SEED`: one of these, a
    /// missing or short frame, or a camera silent for seconds, in every second cycle. `warm-up=S`: a cold camera with this
    /// time constant; `no-clock`: one whose clock never follows another (PTP); `old-names`: one with the feature names of before SFNC 2. May be
    /// given several times.
    #[arg(long = "fault", value_name = "FAULT")]
    faults: Vec<String>,
}

/// Serves until the process is stopped.
pub fn run(args: &Args) -> Result<Outcome> {
    let cell = devices::load(&args.config, &Options::default())?;
    let served = ServedTwin::start(&cell, args.address, args.light, faults(&args.faults)?)?;
    for (name, address) in served.cameras() {
        println!("camera \"{name}\" at {}", address.ip());
    }
    println!("projectors at {}", served.light());
    if !served.is_searchable() {
        println!("another program answers searches here: these cameras are found by their address only");
    }
    println!("serving until Ctrl-C");
    loop {
        std::thread::park();
    }
}

fn faults(texts: &[String]) -> Result<Faults> {
    let mut faults = Faults::default();
    for text in texts {
        let (name, every) = text.split_once('=').unwrap_or((text, "1"));
        let Some(every) = every.parse::<u64>().ok().filter(|every| *every > 0) else {
            bail!("--fault {text}: must count from 1, for instance drop=100");
        };
        let frame = every as usize - 1;
        match name {
            "drop" => faults.drop_every = every,
            "duplicate" => faults.duplicate_every = every,
            "swap" => faults.swap_every = every,
            "ignore-trigger" => faults.ignore_trigger_every = every,
            "no-resend" => faults.no_resend = true,
            "storm" => faults.storm = Some(every),
            "no-clock" => faults.quirks.no_clock = true,
            "old-names" => faults.quirks.old_names = true,
            "warm-up" => faults.quirks.warm_up_s = every as f32,
            "lost" => faults.order = Some(OrderEvent::Lost(frame)),
            "twice" => faults.order = Some(OrderEvent::Twice(frame)),
            "repeat" => faults.order = Some(OrderEvent::Repeated(frame)),
            "exchange" => faults.order = Some(OrderEvent::Exchanged(frame, frame + 1)),
            _ => bail!(
                "--fault {text}: must be drop=N, duplicate=N, swap=N, ignore-trigger=N, no-resend, lost=K, twice=K, repeat=K, exchange=K, storm=SEED, no-clock, old-names or warm-up=S"
            ),
        }
    }
    Ok(faults)
}
