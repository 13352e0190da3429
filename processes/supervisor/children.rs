//! The stages as processes: started, told apart, killed, reaped.

use super::restart::{Policy, Restarts, Verdict};
use anyhow::{Context, Result};
use ipc::os::now_ns;
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};

/// Where a stage is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Life {
    /// Started; has not reported ready.
    Starting {
        /// Since when, ns.
        since_ns: u64,
    },
    /// Its ports stand.
    Up,
    /// Will be started again.
    Waiting {
        /// When, ns.
        until_ns: u64,
    },
    /// Failed too often.
    Held,
    /// Ended as asked.
    Ended,
}

impl Life {
    /// For `status`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Starting { .. } => "starting",
            Self::Up => "up",
            Self::Waiting { .. } => "waiting to restart",
            Self::Held => "held",
            Self::Ended => "ended",
        }
    }
}

/// A stage and its process.
#[derive(Debug)]
pub struct StageProcess {
    /// Name in the schedule.
    pub name: String,
    /// Where it is in its life.
    pub life: Life,
    /// Its failures.
    pub restarts: Restarts,
    /// When it last said anything, ns.
    pub heard_ns: u64,
    /// Why the supervisor killed it, if it did.
    pub killed: Option<String>,
    /// What it said before it ended.
    pub last_words: Option<String>,
    child: Option<Child>,
    arguments: Vec<String>,
    threads: usize,
}

impl StageProcess {
    /// Not started yet. `threads`: of its parallel kernels.
    pub fn new(name: &str, arguments: Vec<String>, threads: usize, policy: Policy) -> Self {
        Self {
            name: name.to_owned(),
            life: Life::Waiting { until_ns: 0 },
            restarts: Restarts::new(policy),
            heard_ns: now_ns(),
            killed: None,
            last_words: None,
            child: None,
            arguments,
            threads,
        }
    }

    /// Process id, while there is a process.
    pub fn pid(&self) -> Option<u32> {
        self.child.as_ref().map(Child::id)
    }

    /// Starts the process: this very image, even if the file was replaced meanwhile.
    pub fn start(&mut self, now_ns: u64) -> Result<()> {
        let mut child = Command::new("/proc/self/exe")
            .arg0("fringecell")
            .args(&self.arguments)
            .env("RAYON_NUM_THREADS", self.threads.to_string())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            // The interrupt key reaches only the supervisor; it then stops the stages in order.
            .process_group(0)
            .spawn()
            .with_context(|| format!("starting stage {}", self.name))?;
        if let Some(stderr) = child.stderr.take() {
            forward(&self.name, stderr);
        }
        self.child = Some(child);
        self.life = Life::Starting { since_ns: now_ns };
        (self.heard_ns, self.killed, self.last_words) = (now_ns, None, None);
        Ok(())
    }

    /// Kills the process; its end is noticed later like any other.
    pub fn kill(&mut self, reason: &str) {
        if let Some(child) = &mut self.child {
            self.killed.get_or_insert_with(|| reason.to_owned());
            // It fails only for a process that has ended already.
            let _ = child.kill();
        }
    }

    /// Reaps the process if it has ended and says how.
    pub fn reap(&mut self) -> Option<String> {
        let status = self.child.as_mut()?.try_wait().ok()??;
        self.child = None;
        Some(self.epitaph(status))
    }

    /// Decides what follows after an end that nobody asked for.
    pub fn failed(&mut self, now_ns: u64) {
        self.life = match self.restarts.failed(now_ns) {
            Verdict::RestartAt(until_ns) => Life::Waiting { until_ns },
            Verdict::Hold => Life::Held,
        };
    }

    fn epitaph(&self, status: ExitStatus) -> String {
        let end = match (&self.killed, status.signal(), status.code()) {
            (Some(reason), _, _) => reason.clone(),
            (None, Some(signal), _) => format!("died (signal {signal})"),
            (None, None, Some(code)) => format!("ended (exit code {code})"),
            (None, None, None) => "ended".to_owned(),
        };
        match &self.last_words {
            Some(words) => format!("{end}: {words}"),
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

/// Puts the stage's name in front of what it says.
fn forward(name: &str, stderr: ChildStderr) {
    let name = name.to_owned();
    std::thread::spawn(move || {
        for line in BufReader::new(stderr).lines().map_while(Result::ok) {
            eprintln!("[{name}] {line}");
        }
    });
}
