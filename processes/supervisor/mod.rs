//! The supervisor: starts, monitors, restarts and stops the stages, and collects their results.
//!
//! Pure modules decide ([`cell::schedule`], [`cycle`], [`restart`]); `state` connects them to messages, processes and the
//! clock. The supervisor never waits for a stage: it checks all of them every 20 ms.

mod changes;
pub mod collect;
pub mod command_socket;
pub mod cycle;
mod cycle_recorder;
pub mod history;
mod in_flight;
mod job_controller;
mod led;
mod lifecycle;
mod metrics;
mod monitor;
mod monitor_scan;
mod ports;
mod privileges;
pub mod profile;
pub mod protocol;
mod requests;
pub mod restart;
mod result_delivery;
mod result_writer;
mod service_manager;
mod setup;
pub mod snapshot;
mod stage_process;
mod state;
mod summary;
mod warm_up;

pub use metrics::CONTENT_TYPE;
pub use monitor::{KEPT_CYCLES, MONITOR};
pub use setup::{PageOptions, RunOptions};
pub use summary::Summary;

use crate::panic_drill::panic_if_requested;
use crate::terminal;
use anyhow::{Context, Result, anyhow};
use cell::schedule::SUPERVISOR;
use cycle::Input;
use devices::LoadedCell;
use files::result::CycleResult;
use state::{Supervisor, TICK};
use std::sync::Arc;

/// Runs a cell. `each` is called with the result of every cycle as soon as it is known.
///
/// # Errors
/// The cell cannot start, or the supervisor itself cannot continue.
pub fn run(cell: &LoadedCell, options: &RunOptions, each: &mut dyn FnMut(&CycleResult)) -> Result<Summary> {
    let interrupted = Arc::clone(&options.interrupted);
    ipc::os::catch_termination().context("handling the termination signals")?;
    privileges::claim(cell);
    warn_of_calibration(cell);
    let mut supervisor = Supervisor::new(cell, options, interrupted)?;
    let ended = without_panic(|| event_loop(&mut supervisor, each));
    if let Err(error) = &ended {
        // Every cycle has an outcome, also after an error of the supervisor itself.
        let reason = format!("the supervisor failed: {error:#}");
        let _ = without_panic(|| supervisor.step(Input::Stop { reason }, each));
    }
    service_manager::ServiceManager::stopping();
    supervisor.shut_down();
    supervisor.answer_remaining();
    supervisor.end_monitor();
    // Waits for the disk, also after an error: the last results are the ones that say what happened.
    let summary = supervisor.summary();
    if let (Err(_), Some(error)) = (&ended, &summary.unrecorded) {
        tracing::error!("{error:#}");
    }
    ended.map(|()| summary)
}

/// Says which uncertainties hold nothing of the calibration.
fn warn_of_calibration(cell: &LoadedCell) {
    let recipes = cell.file.without_calibration();
    // A host that is led inspects nothing.
    if !recipes.is_empty() && cell.graph.leads() {
        terminal::print_note(&format!(
            "warning: {}: names the covariance of its calibration, which counts for nothing in the features of recipe {} that have no u_system; \
             measure a part with `fringetool measure --rig --json` and name its result as calibration_shares, or state u_system_mm in the plan",
            cell.file.rig_path.display(),
            recipes.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ")
        ));
    }
}

/// Makes a panic an error: stages, files and clients are then left in order.
fn without_panic(work: impl FnOnce() -> Result<()>) -> Result<()> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
        Err(anyhow!("panic: {text}"))
    })
}

fn event_loop(supervisor: &mut Supervisor, each: &mut dyn FnMut(&CycleResult)) -> Result<()> {
    while !supervisor.cycles.is_finished() {
        supervisor.start_due(each)?;
        panic_if_requested(SUPERVISOR);
        supervisor.drain(each)?;
        supervisor.reap_ended(each)?;
        supervisor.connect(each)?;
        supervisor.handle_requests(each)?;
        supervisor.results_out.update();
        supervisor.notify_service_manager();
        supervisor.update_monitor();
        supervisor.update_changes();
        supervisor.step(Input::Tick, each)?;
        if !supervisor.cycles.is_finished() {
            supervisor.listener.wait(TICK)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_with_its_words() {
        assert!(without_panic(|| Ok(())).is_ok());
        let error = without_panic(|| panic!("index {} of {}", 3, 2)).unwrap_err();
        assert_eq!(error.to_string(), "panic: index 3 of 2");
        let error = without_panic(|| panic!("plain")).unwrap_err();
        assert_eq!(error.to_string(), "panic: plain");
        let error = without_panic(|| std::panic::panic_any(7)).unwrap_err();
        assert_eq!(error.to_string(), "panic: no message");
    }
}
