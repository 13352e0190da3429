//! A stage as a process: start, kill, reap, exit reason.

use super::restart::{Decision, Policy, Restarts};
use crate::terminal;
use anyhow::{Context, Result};
use ipc::long_text::Joined;
use ipc::os::now_ns;
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Longest wait for the last line of an ended process: the pipe holds it already.
const LAST_LINE_WAIT_MS: u32 = 50;

/// State of a stage process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProcessState {
    /// Started, not ready yet.
    Starting {
        /// Time of the start, ns.
        since_ns: u64,
    },
    /// Ready: all its ports exist.
    Up,
    /// Waits for its next start.
    Waiting {
        /// Time of the next start, ns.
        until_ns: u64,
    },
    /// Failed too often; is not started again.
    GaveUp,
    /// The process ended on request.
    Ended,
}

impl ProcessState {
    /// The state as `status` shows it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Starting { .. } => "starting",
            Self::Up => "up",
            Self::Waiting { .. } => "waiting to restart",
            Self::GaveUp => "held",
            Self::Ended => "ended",
        }
    }
}

/// A stage with its process.
#[derive(Debug)]
pub struct StageProcess {
    /// Name in the schedule.
    pub name: String,
    /// State of the process.
    pub state: ProcessState,
    /// Failures and restart policy.
    pub restarts: Restarts,
    /// Time of its last message, ns.
    pub last_message_ns: u64,
    /// Reason why the supervisor killed it, if it did.
    pub killed: Option<String>,
    /// Whether an operator requested the restart.
    restart_requested: bool,
    /// Parts of a report that is not complete yet.
    pub report: Joined,
    /// Reason that it sent before it ended.
    pub final_message: Option<String>,
    child: Option<Child>,
    stderr: Option<StderrReader>,
    arguments: Vec<String>,
    threads: usize,
}

impl StageProcess {
    /// A stage that is not started yet. `threads`: number of threads of its parallel kernels.
    pub fn new(name: &str, arguments: Vec<String>, threads: usize, policy: Policy) -> Self {
        Self {
            name: name.to_owned(),
            state: ProcessState::Waiting { until_ns: 0 },
            restarts: Restarts::new(policy),
            last_message_ns: now_ns(),
            killed: None,
            restart_requested: false,
            report: Joined::default(),
            final_message: None,
            child: None,
            stderr: None,
            arguments,
            threads,
        }
    }

    /// Process id, while the process exists.
    pub fn pid(&self) -> Option<u32> {
        self.child.as_ref().map(Child::id)
    }

    /// Starts the process from the running program image, even if the file was replaced since.
    pub fn start(&mut self, now_ns: u64) -> Result<()> {
        self.start_with(now_ns, Stdio::null(), Stdio::null())
    }

    /// Starts the process with these as its standard input and output.
    pub fn start_with(&mut self, now_ns: u64, stdin: Stdio, stdout: Stdio) -> Result<()> {
        let mut child = Command::new("/proc/self/exe")
            .arg0("fringecell")
            .args(&self.arguments)
            .env("RAYON_NUM_THREADS", self.threads.to_string())
            // Only the supervisor speaks with the service manager.
            .env_remove("NOTIFY_SOCKET")
            .stdin(stdin)
            .stdout(stdout)
            .stderr(Stdio::piped())
            // Signals of the terminal reach only the supervisor, which stops the stages.
            .process_group(0)
            .spawn()
            .with_context(|| format!("starting stage {}", self.name))?;
        match child.stderr.take().map(|stderr| StderrReader::start(&self.name, stderr)).transpose() {
            Ok(stderr) => self.stderr = stderr,
            Err(error) => {
                // Unread, its messages would fill the pipe and block it.
                let _ = child.kill();
                let _ = child.wait();
                return Err(error).context("starting the thread that reads its messages");
            }
        }
        tracing::info!(stage = self.name, pid = child.id(), "stage started");
        self.child = Some(child);
        self.state = ProcessState::Starting { since_ns: now_ns };
        (self.last_message_ns, self.killed, self.final_message) = (now_ns, None, None);
        Ok(())
    }

    /// Kills the process; [`Self::reap`] finds its end later.
    pub fn kill(&mut self, reason: &str) {
        if let Some(child) = &mut self.child {
            self.killed.get_or_insert_with(|| reason.to_owned());
            // Fails only if the process has ended already.
            let _ = child.kill();
        }
    }

    /// Kills the process at the request of an operator; its end does not count as a failure.
    pub fn restart(&mut self) {
        self.restart_requested = true;
        self.kill("was restarted by the operator");
    }

    /// Reaps the process if it has ended; returns the reason.
    pub fn reap(&mut self) -> Option<String> {
        let status = self.child.as_mut()?.try_wait().ok()??;
        self.child = None;
        Some(self.exit_reason(status))
    }

    /// Schedules a stage that was given up for a new start and clears its failures.
    pub fn revive(&mut self) {
        self.restarts.clear();
        self.state = ProcessState::Waiting { until_ns: 0 };
    }

    /// Schedules the restart after the end of the process, or gives up.
    pub fn ended(&mut self, now_ns: u64) {
        let decision = if std::mem::take(&mut self.restart_requested) {
            self.restarts.requested(now_ns)
        } else {
            self.restarts.failed(now_ns)
        };
        self.state = match decision {
            Decision::RestartAt(until_ns) => ProcessState::Waiting { until_ns },
            Decision::GiveUp => ProcessState::GaveUp,
        };
    }

    fn exit_reason(&self, status: ExitStatus) -> String {
        let end = match (&self.killed, status.signal(), status.code()) {
            (Some(reason), _, _) => reason.clone(),
            (None, Some(signal), _) => format!("died (signal {signal}{})", signal_meaning(signal)),
            (None, None, Some(code)) => format!("ended (exit code {code})"),
            (None, None, None) => "ended".to_owned(),
        };
        // After an error, a panic or a failed allocation, the last line on standard error is the reason.
        let ended_itself =
            matches!((status.signal(), status.code()), (Some(libc::SIGABRT), _) | (None, Some(1..)));
        let last_line =
            || self.stderr.as_ref().filter(|_| ended_itself && self.killed.is_none())?.last_line();
        match self.final_message.clone().or_else(last_line) {
            Some(message) => format!("{end}: {message}"),
            None => end,
        }
    }
}

impl Drop for StageProcess {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// The meaning of less familiar signals.
fn signal_meaning(signal: i32) -> &'static str {
    match signal {
        libc::SIGBUS => ", bus error: is /dev/shm full?",
        libc::SIGSEGV => ", segmentation fault",
        libc::SIGABRT => ", aborted",
        _ => "",
    }
}

/// Forwards the standard error of a stage with its name in front, and keeps the last line.
#[derive(Debug)]
struct StderrReader {
    last: Arc<Mutex<String>>,
    thread: JoinHandle<()>,
}

impl StderrReader {
    fn start(name: &str, stderr: ChildStderr) -> std::io::Result<Self> {
        let (name, last) = (name.to_owned(), Arc::new(Mutex::new(String::new())));
        let kept = Arc::clone(&last);
        let thread = std::thread::Builder::new().spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                terminal::print_note(&format!("[{name}] {line}"));
                keep_last(&mut kept.lock().unwrap_or_else(PoisonError::into_inner), &line);
            }
        })?;
        Ok(Self { last, thread })
    }

    /// The line with the reason why the process ended.
    fn last_line(&self) -> Option<String> {
        for _ in 0..LAST_LINE_WAIT_MS {
            if self.thread.is_finished() {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        Some(last.clone()).filter(|line| !line.is_empty())
    }
}

/// Keeps the last line; of a panic the two lines with place and reason, without the backtrace.
fn keep_last(last: &mut String, line: &str) {
    if last.contains("panicked at") {
        if last.ends_with(':') {
            last.push(' ');
            last.push_str(line);
        }
    } else if !line.trim().is_empty() {
        line.trim().clone_into(last);
    }
}

#[cfg(test)]
mod tests {
    use super::keep_last;

    fn last(lines: &[&str]) -> String {
        let mut last = String::new();
        for line in lines {
            keep_last(&mut last, line);
        }
        last
    }

    #[test]
    fn the_line_with_the_reason_is_kept() {
        assert_eq!(last(&[" WARN something", "", "error: no camera", ""]), "error: no camera");
        let panic =
            ["", "thread 'main' panicked at a.rs:1:2:", "out of bounds", "note: run with", "  0: main"];
        assert_eq!(last(&panic), "thread 'main' panicked at a.rs:1:2: out of bounds");
        assert_eq!(last(&[]), "");
    }
}
