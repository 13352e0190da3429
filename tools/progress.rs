//! Progress of work that takes longer than a second: a bar on a terminal; on a pipe a line now and then with the time to come.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

/// A bar that stays silent for the first second.
pub struct Progress {
    bar: ProgressBar,
    what: String,
    started: Instant,
    shown: bool,
    /// When the next line is due, on a pipe.
    next_line: Duration,
}

/// Pause before the first line on a pipe; each further one comes after three times as long.
const FIRST_LINE: Duration = Duration::from_secs(20);

impl Progress {
    /// A bar of `total` steps.
    pub fn new(total: usize, what: &str) -> Self {
        let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::hidden());
        if let Ok(style) = ProgressStyle::with_template("{msg:16} [{bar:32}] {pos}/{len} {eta}") {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_message(what.to_owned());
        Self { bar, what: what.to_owned(), started: Instant::now(), shown: false, next_line: FIRST_LINE }
    }

    /// A bar of steps whose number is not known beforehand.
    pub fn unbounded(what: &str) -> Self {
        let progress = Self::new(0, what);
        progress.bar.unset_length();
        if let Ok(style) = ProgressStyle::with_template("{msg:16} {spinner} {pos} {elapsed}") {
            progress.bar.set_style(style);
        }
        progress
    }

    /// Counts one finished step.
    pub fn step(&mut self) {
        self.bar.inc(1);
        let elapsed = self.started.elapsed();
        if cli::is_quiet() || elapsed < Duration::from_secs(1) {
            return;
        }
        if std::io::stderr().is_terminal() {
            if !std::mem::replace(&mut self.shown, true) {
                self.bar.set_draw_target(ProgressDrawTarget::stderr());
            }
        } else if elapsed >= self.next_line {
            self.next_line = 3 * elapsed;
            self.print_line(elapsed);
        }
    }

    fn print_line(&self, elapsed: Duration) {
        let (done, seconds) = (self.bar.position(), elapsed.as_secs_f64());
        match self.bar.length().filter(|total| *total > done) {
            Some(total) => {
                let rest = seconds * (total - done) as f64 / done.max(1) as f64;
                eprintln!("{}: {done} of {total} after {seconds:.0} s, about {rest:.0} s to go", self.what);
            }
            None => eprintln!("{}: {done} after {seconds:.0} s", self.what),
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
