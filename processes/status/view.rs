//! Tables of `status`, fitted to the terminal.

use crate::supervisor::profile::Percentiles;
use crate::supervisor::protocol::{CameraStatus, LastPart, StageStatus, Status};
use files::result::OUTCOME_OK;
use metrology::verdict::Verdict;
use std::fmt::Write as _;
use std::io::{IsTerminal as _, Write as _};

/// Minimum width for the table with all columns.
const WIDE: usize = 120;

/// Minimum width of the lines; a narrower terminal truncates them.
const NARROW: usize = 80;

/// Width of the stage table without name and process id.
const NUMBERS: usize = 58;

/// Width of the columns for resource use, only in a wide table.
const RESOURCES: usize = 36;

/// Width of the process id with its gap.
const PID: usize = 8;

/// Width for a status that is printed once; unlimited if standard output is not a terminal.
pub(super) fn columns() -> usize {
    let is_terminal = std::io::stdout().is_terminal();
    if is_terminal { console::Term::stdout().size().1.into() } else { usize::MAX }
}

/// The live view; each draw replaces the previous one.
#[derive(Default)]
pub(super) struct View {
    lines: usize,
}

impl View {
    pub(super) fn draw(&mut self, status: &Status) -> std::io::Result<()> {
        let terminal = console::Term::stdout();
        let (rows, columns) = terminal.size();
        // One line fewer than the terminal, or the cursor cannot return to the first one.
        let lines = fit(&table(status, columns.into()), usize::from(rows).saturating_sub(1).max(1));
        let mut frame = String::new();
        if self.lines > 0 {
            let _ = write!(frame, "\x1b[{}A", self.lines);
        }
        for line in &lines {
            let shown: String = line.chars().take(columns.into()).collect();
            let _ = writeln!(frame, "\x1b[2K{shown}");
        }
        // Clear the rest of a longer previous table.
        frame.push_str("\x1b[J");
        self.lines = lines.len();
        let mut out = std::io::stdout().lock();
        out.write_all(frame.as_bytes())?;
        out.flush()
    }
}

/// At most `rows` lines of a text; the last one counts the omitted lines.
fn fit(text: &str, rows: usize) -> Vec<String> {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    if lines.len() > rows {
        let left_out = lines.len() - rows + 1;
        lines.truncate(rows - 1);
        lines.push(format!("… {left_out} more lines: enlarge the window or use --once"));
    }
    lines
}

/// The status as text, in lines of at most `columns` (80 at least).
pub(super) fn table(status: &Status, columns: usize) -> String {
    let (columns, wide) = (columns.max(NARROW), columns >= WIDE);
    let mut text = head(status, columns);
    let _ = writeln!(
        text,
        "\n{:<22} {:>9} {:>9} {:>9} {:>9} {:>7}",
        "ms", "median", "95 %", "99 %", "max", "cycles"
    );
    for (name, times) in [("start → outcome", status.cycle_time), ("last frame → verdict", status.latency)]
    {
        let _ = writeln!(
            text,
            "{name:<22} {:>9} {:>9} {:>9} {:>9} {:>7}",
            ms(times.p50_ms, &times),
            ms(times.p95_ms, &times),
            ms(times.p99_ms, &times),
            ms(times.max_ms, &times),
            times.cycles
        );
    }
    text.push('\n');
    stages(&mut text, status, columns, wide);
    cameras(&mut text, status);
    text
}

/// One line per camera that tells anything of itself.
fn cameras(text: &mut String, status: &Status) {
    for (index, CameraStatus { name, state }) in status.cameras.iter().enumerate() {
        if index == 0 {
            let _ = writeln!(
                text,
                "\n{:<22} {:>7} {:>10} {:>8} {:>8}",
                "camera", "°C", "packets", "resent", "lost"
            );
        }
        let celsius = state.temperature_c.map_or_else(|| "–".to_owned(), |celsius| format!("{celsius:.1}"));
        let link = state.link.unwrap_or_default();
        let lost = link.lost_packets + link.dropped_packets;
        let _ = writeln!(
            text,
            "{name:<22} {celsius:>7} {:>10} {:>8} {lost:>8}",
            link.packets, link.resent_packets
        );
    }
}

/// One line per stage. Process ids are omitted if long names need their space.
fn stages(text: &mut String, status: &Status, columns: usize, wide: bool) {
    let longest = status.stages.iter().map(|s| s.name.chars().count()).max().unwrap_or(0).max(5);
    let space = columns - NUMBERS - if wide { RESOURCES } else { 0 };
    let with_pid = longest <= space - PID;
    let name = longest.min(if with_pid { space - PID } else { space });
    let pid = |text: &str| if with_pid { format!(" {text:>7}") } else { String::new() };
    let _ = write!(
        text,
        "{:<name$} {:<9}{} {:>3} {:>8} {:>8} {:>8} {:>8} {:>7}",
        "stage",
        "state",
        pid("pid"),
        "rst",
        "wait",
        "compute",
        "99 %",
        "max",
        "send"
    );
    text.push_str(if wide { "    cpu   faults  switches  MB/cycle\n" } else { "\n" });
    for stage in &status.stages {
        let number = stage.pid.map_or_else(|| "–".to_owned(), |pid| pid.to_string());
        row(text, stage, name, &pid(&number), wide);
    }
}

fn head(status: &Status, columns: usize) -> String {
    let of = status.cycles_requested.map_or_else(String::new, |n| format!(" of {n}"));
    let running: Vec<String> = status.running.iter().map(|cycle| (cycle + 1).to_string()).collect();
    let now = match running.len() {
        0 => "between cycles".to_owned(),
        1 => format!("in cycle {}", running[0]),
        _ => format!("in cycles {}", running.join(", ")),
    };
    let rate = status.cycles_per_minute.map_or_else(|| "–".to_owned(), |r| format!("{r:.1}"));
    let o = &status.outcomes;
    let mut lines = vec![
        format!("cell '{}', pid {}: {:?}, {now}", status.cell, status.pid, status.state),
        format!(
            "{}{of} done, {rate} per minute, {} deadline misses",
            status.cycles_done, status.deadline_misses
        ),
        format!(
            "pass {}  indeterminate {}  fail {}  no verdict {}  not ok {}",
            o.pass, o.indeterminate, o.fail, o.no_verdict, o.not_ok
        ),
    ];
    if let Some(recipe) = &status.recipe {
        lines.push(format!("now: {}", part_and_recipe(status.part.as_deref(), recipe)));
    }
    lines.extend(status.last.as_ref().map(last_part));
    if let Some(reason) = &status.reason {
        let cell = &status.cell;
        lines.push(format!("in error: {reason}; remove the cause, then: fringecell reset {cell}"));
    }
    if let Some((cycle, reason)) = &status.last_failure {
        lines.push(format!("last failure, cycle {}: {reason}", cycle + 1));
    }
    lines.iter().map(|line| wrapped(line, columns)).collect()
}

fn part_and_recipe(part: Option<&str>, recipe: &str) -> String {
    let part = part.map_or_else(String::new, |part| format!("part {part:?}, "));
    format!("{part}recipe {recipe}")
}

/// The last part with its verdict, and the features that did not pass.
fn last_part(last: &LastPart) -> String {
    let what = part_and_recipe(last.part.as_deref(), last.recipe.as_deref().unwrap_or("none"));
    let verdict = match last.outcome.as_str() {
        OUTCOME_OK => last.verdict.map_or("no verdict", Verdict::word),
        reason => reason,
    };
    let mut line = format!("last: cycle {}, {what}: {verdict}", last.number);
    for feature in last.features.iter().filter(|feature| feature.verdict != Some(Verdict::Pass)) {
        let _ = match (feature.value, feature.verdict) {
            (Some(value), Some(verdict)) => {
                write!(line, "; {} {} {value:.4} {}", feature.name, verdict.word(), feature.unit)
            }
            _ => write!(line, "; {} not measured", feature.name),
        };
    }
    line
}

/// Wraps a line at spaces; further lines are indented.
fn wrapped(line: &str, columns: usize) -> String {
    let mut text = String::new();
    let mut used = 0;
    for word in line.split(' ') {
        let length = word.chars().count();
        if used > 0 && used + 1 + length > columns {
            text.push_str("\n ");
            used = 1;
        }
        // Preserve double spaces.
        if !text.is_empty() {
            text.push(' ');
            used += 1;
        }
        text.push_str(word);
        used += length;
    }
    text.push('\n');
    text
}

fn row(text: &mut String, stage: &StageStatus, name: usize, pid: &str, wide: bool) {
    let compute = &stage.compute;
    let _ = write!(
        text,
        "{:<name$.name$} {:<9.9}{pid} {:>3} {:>8} {:>8} {:>8} {:>8} {:>7}",
        stage.name,
        // "waiting to restart" is shortened to "waiting".
        stage.state.split(' ').next().unwrap_or_default(),
        stage.restarts,
        ms(stage.wait.p50_ms, &stage.wait),
        ms(compute.p50_ms, compute),
        ms(compute.p99_ms, compute),
        ms(compute.max_ms, compute),
        ms(stage.send.p50_ms, &stage.send)
    );
    if wide {
        let (total, cycles) = (&stage.total, stage.cycles.max(1) as f64);
        let mean = |sum: u64| sum as f64 / cycles;
        let _ = write!(
            text,
            " {:>6.1} {:>8.1} {:>9.1} {:>9.2}",
            mean(total.cpu_ns) / 1e6,
            mean(total.minor_faults + total.major_faults),
            mean(total.voluntary_switches + total.involuntary_switches),
            mean(total.bytes) / 1e6
        );
    }
    text.push('\n');
}

/// A time in ms, or a dash if there is none yet.
fn ms(value: f64, of: &Percentiles) -> String {
    match value {
        _ if of.cycles == 0 => "–".to_owned(),
        v if v >= 10_000.0 => format!("{v:.0}"),
        v if v >= 100.0 => format!("{v:.1}"),
        v => format!("{v:.2}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::State;
    use crate::supervisor::profile::Outcomes;
    use files::result::StageResult;
    use metrology::inspection::FeatureResult;

    fn stage(name: &str) -> StageStatus {
        let times = Percentiles { cycles: 9, p50_ms: 12_345.6, p95_ms: 1.0, p99_ms: 99_999.0, max_ms: 123.4 };
        StageStatus {
            name: name.into(),
            pid: Some(4_194_304),
            state: "waiting to restart".into(),
            restarts: 12,
            silent_ms: 0,
            cycles: 9,
            wait: times,
            compute: times,
            send: times,
            total: StageResult::default(),
        }
    }

    fn last() -> LastPart {
        let feature = |name: &str, value, verdict| FeatureResult {
            name: name.into(),
            value,
            verdict,
            ..FeatureResult::default()
        };
        LastPart {
            number: 9,
            part: Some("4710".into()),
            recipe: Some("spheres".into()),
            outcome: "ok".into(),
            verdict: Some(Verdict::Fail),
            features: vec![
                feature("good", Some(1.0), Some(Verdict::Pass)),
                feature("wide", Some(20.12), Some(Verdict::Fail)),
                feature("hidden", None, None),
            ],
        }
    }

    fn status(stages: &[&str]) -> Status {
        Status {
            cell: "a-cell-with-a-name-of-32-letters".into(),
            pid: 4_194_304,
            state: State::ContinuousExecution,
            reason: Some(
                "stage matching/pair1 failed 6 times within 60 s, the last time: no such camera".into(),
            ),
            cycle: Some(123_456),
            running: vec![123_456, 123_457],
            cycles_done: 123_456,
            cycles_ok: 1,
            cycles_requested: Some(1_000_000),
            cycles_per_minute: Some(1234.5),
            outcomes: Outcomes {
                pass: 123_456,
                indeterminate: 12_345,
                fail: 12_345,
                no_verdict: 0,
                not_ok: 12_345,
            },
            deadline_misses: 12_345,
            cycle_time: Percentiles::default(),
            latency: Percentiles::default(),
            last_failure: Some((7, "word ".repeat(40))),
            part: Some("4711".into()),
            recipe: Some("spheres".into()),
            last: Some(last()),
            cameras: Vec::new(),
            stages: stages.iter().map(|name| stage(name)).collect(),
        }
    }

    #[test]
    fn no_line_is_wider_than_the_terminal_and_no_word_is_lost() {
        for stages in [&["projection", "matching/pair1"][..], &["matching/left-to-projector"]] {
            for columns in [80, 100, 119, 120, 200] {
                let text = table(&status(stages), columns);
                for line in text.lines() {
                    assert!(line.chars().count() <= columns, "{columns}: {line}");
                }
                assert_eq!(text.matches("word").count(), 40, "{text}");
            }
        }
        let narrow = table(&status(&["projection", "matching/pair1"]), 80);
        assert!(narrow.contains("matching/pair1 waiting   4194304  12"), "{narrow}");
        assert!(narrow.contains("now: part \"4711\", recipe spheres\n"), "{narrow}");
        let last = "last: cycle 9, part \"4710\", recipe spheres: FAIL; wide FAIL 20.1200 mm; hidden";
        assert!(narrow.contains(last), "{narrow}");
    }

    #[test]
    fn lines_that_do_not_fit_are_counted() {
        assert_eq!(fit("a\nb\nc\n", 3), ["a", "b", "c"]);
        assert_eq!(fit("a\nb\nc\nd\n", 3), ["a", "b", "… 2 more lines: enlarge the window or use --once"]);
        assert_eq!(fit("a\nb\n", 1).len(), 1);
    }

    #[test]
    fn long_lines_are_wrapped_at_spaces() {
        assert_eq!(wrapped("ab  cd ef", 20), "ab  cd ef\n");
        assert_eq!(wrapped("ab cd ef", 5), "ab cd\n  ef\n");
    }
}
