//! The stages as processes: started, told apart, killed, reaped.

use super::restart::{Policy, Restarts, Verdict};
use anyhow::{Context, Result};
use ipc::os::now_ns;
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// How long the last line of a process that has ended may take through the pipe: the kernel holds it already.
const LAST_LINE_PATIENCE_MS: u32 = 50;

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
    voice: Option<Voice>,
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
            voice: None,
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
        self.voice = child.stderr.take().map(|stderr| Voice::listen(&self.name, stderr));
        tracing::info!(stage = self.name, pid = child.id(), "stage started");
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

    /// Starts a stage that was given up again, its earlier failures forgiven.
    pub fn revive(&mut self) {
        self.restarts.forgive();
        self.life = Life::Waiting { until_ns: 0 };
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
            (None, Some(signal), _) => format!("died (signal {signal}{})", meaning(signal)),
            (None, None, Some(code)) => format!("ended (exit code {code})"),
            (None, None, None) => "ended".to_owned(),
        };
        // A process that ended itself, by an error, a panic or for want of memory, said why.
        let ended_itself =
            matches!((status.signal(), status.code()), (Some(libc::SIGABRT), _) | (None, Some(1..)));
        let said = || self.voice.as_ref().filter(|_| ended_itself && self.killed.is_none())?.last_line();
        match self.last_words.clone().or_else(said) {
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

/// What may be meant by a signal that is not known to everybody.
fn meaning(signal: i32) -> &'static str {
    match signal {
        libc::SIGBUS => ", bus error: is /dev/shm full?",
        libc::SIGSEGV => ", segmentation fault",
        libc::SIGABRT => ", aborted",
        _ => "",
    }
}

/// What a stage says on its standard error: passed on with its name in front, and its last line kept.
#[derive(Debug)]
struct Voice {
    last: Arc<Mutex<String>>,
    thread: JoinHandle<()>,
}

impl Voice {
    fn listen(name: &str, stderr: ChildStderr) -> Self {
        let (name, last) = (name.to_owned(), Arc::new(Mutex::new(String::new())));
        let kept = Arc::clone(&last);
        let thread = std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                eprintln!("[{name}] {line}");
                keep(&mut kept.lock().unwrap_or_else(PoisonError::into_inner), &line);
            }
        });
        Self { last, thread }
    }

    /// The line that says why the process ended.
    fn last_line(&self) -> Option<String> {
        for _ in 0..LAST_LINE_PATIENCE_MS {
            if self.thread.is_finished() {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        Some(last.clone()).filter(|line| !line.is_empty())
    }
}

/// Keeps the last line; of a panic the two lines that tell where and why, and not the backtrace after them.
fn keep(last: &mut String, line: &str) {
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
    use super::keep;

    fn last(lines: &[&str]) -> String {
        let mut last = String::new();
        for line in lines {
            keep(&mut last, line);
        }
        last
    }

    #[test]
    fn the_line_that_tells_why_is_kept() {
        assert_eq!(last(&[" WARN something", "", "error: no camera", ""]), "error: no camera");
        let panic =
            ["", "thread 'main' panicked at a.rs:1:2:", "out of bounds", "note: run with", "  0: main"];
        assert_eq!(last(&panic), "thread 'main' panicked at a.rs:1:2: out of bounds");
        assert_eq!(last(&[]), "");
    }
}
