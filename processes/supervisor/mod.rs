//! The supervisor: plans, starts, watches, restarts and stops the stages, and gathers what they measure.
//!
//! Its decisions are made in pure modules ([`crate::schedule`], [`cycle`], [`restart`]); `state` moves
//! messages between them and the world. It never blocks on a child: every 20 ms it looks at all of them.

mod children;
pub mod collect;
pub mod cycle;
mod desk;
mod flight;
pub mod history;
mod http;
mod keep;
mod lives;
mod metrics;
mod operator;
mod privileges;
pub mod profile;
pub mod protocol;
pub mod restart;
pub mod socket;
mod start;
mod state;
pub mod watch;

pub use start::Orders;
pub use state::Summary;

use crate::graph::Cell;
use anyhow::{Context, Result};
use cycle::Input;
use files::result::CycleResult;
use state::{Supervisor, TICK};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Runs a cell; `each` gets every cycle's result as soon as it stands.
///
/// # Errors
/// What keeps the cell from starting, or makes the supervisor itself unable to go on.
pub fn run(cell: &Cell, orders: &Orders, each: &mut dyn FnMut(&CycleResult)) -> Result<Summary> {
    let interrupted = Arc::clone(&orders.interrupted);
    let flag = Arc::clone(&interrupted);
    ctrlc::set_handler(move || flag.store(true, Ordering::SeqCst))
        .context("taking over the interrupt signal")?;
    privileges::claim(cell);
    let mut supervisor = Supervisor::new(cell, orders, interrupted)?;
    let ended = work(&mut supervisor, each);
    supervisor.shut_down();
    ended?;
    Ok(supervisor.summary())
}

fn work(supervisor: &mut Supervisor, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
    while !supervisor.cycles.is_finished() {
        supervisor.start_waiting()?;
        supervisor.hear(each)?;
        supervisor.bury(each)?;
        supervisor.connect(each)?;
        supervisor.obey(each)?;
        supervisor.feed(Input::Tick, each)?;
        if !supervisor.cycles.is_finished() {
            supervisor.bell.wait(TICK)?;
        }
    }
    Ok(())
}
