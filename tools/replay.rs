//! `fringetool replay`: a cycle record, run again through the same kernels and compared byte by byte.

mod compare;
mod source;

use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use cell::Retention;
use cell::executor::InProcess;
use cell::schedule::{label, output};
use cell::{Cell, Options};
use compare::Difference;
use devices::LoadedCell;
use files::cycle_record::{
    ActivationName, DamagedCycle, Ending, Next, RecordHeader, RecordReader, RecordedCycle, RecordedRecipe,
};
use serde::Serialize;
use source::Source;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Cycle record written by `fringecell run --cycle-record FILE` (docs/formats.md).
    record: PathBuf,
    /// Configuration at another place than when recorded; its content must be identical.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Counts and differences of a replay.
#[derive(Debug, Default, Serialize)]
struct ReplayReport {
    /// Program and version that recorded.
    recorded_by: String,
    /// Complete cycles in the record.
    cycles: u64,
    /// Of these, cycles without any output to compare.
    empty: u64,
    /// Numbers between the first and the last cycle that are not in the record.
    missing: Vec<u64>,
    /// Number of outputs compared.
    outputs: u64,
    /// Bytes of the outputs compared.
    bytes: u64,
    /// Bytes after the last complete cycle.
    incomplete_bytes: u64,
    /// Whether the record has its seal, so that nothing is missing at its end.
    sealed: bool,
    /// Cycles that the run could not record, as the seal states.
    lost: u64,
    /// What is damaged, by cycle; these cycles are not compared.
    damage: Vec<String>,
    /// Outputs that differ, in the order of record and schedule.
    differences: Vec<Difference>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[&args.record], None)?;
    let mut reader = RecordReader::open(&args.record)?;
    let cell = cell(args, &reader.header)?;
    let found = replay(&mut reader, &cell)?;
    emit(args.json.as_deref(), &found)?;
    println!("{}", text(&args.record, &reader.header, &found));
    check_record(&args.record, &found)?;
    Ok(if found.differences.is_empty() { Outcome::Done } else { Outcome::LimitFailed })
}

/// A record that is damaged, that ends early or that holds nothing to compare proves nothing: never exit code 0.
fn check_record(path: &Path, found: &ReplayReport) -> Result<()> {
    let path = path.display();
    if let Some(first) = found.damage.first() {
        bail!("{path}: the record is damaged: {first}; restore it from a copy");
    }
    if !found.sealed {
        bail!(
            "{path}: the record has no seal after its {} complete cycles: its run was killed or still goes on, or the \
             file was cut; cycles may be missing",
            found.cycles
        );
    }
    if found.outputs == 0 {
        bail!("{path}: the record holds {} cycles and no output to compare", found.cycles);
    }
    Ok(())
}

/// The cell that was recorded; another one has nothing to be compared with.
fn cell(args: &Args, header: &RecordHeader) -> Result<LoadedCell> {
    let path = args.config.clone().unwrap_or_else(|| PathBuf::from(&header.config));
    let options =
        Options { cell: Some(header.cell.clone()), retention: header.retention, ..Options::default() };
    let cell = devices::load(&path, &options).with_context(|| {
        format!("{}: the configuration of the record; --config names another place", args.record.display())
    })?;
    let recording = cell.file.recording.as_ref().map(|r| r.recording.sha256.clone());
    for (what, recorded, now) in [
        ("the configuration", Some(&header.config_sha256), Some(&cell.file.sha256)),
        ("the rig file", Some(&header.rig_sha256), Some(&cell.file.rig_sha256)),
        ("the recording", header.recording_sha256.as_ref(), recording.as_ref()),
    ] {
        if recorded != now {
            let short = |sha: Option<&String>| sha.map_or("none", |s| s.get(..12).unwrap_or(s)).to_owned();
            bail!(
                "{}: {what} of {} was changed since: SHA-256 {} in the record, {} now; restore it to replay",
                args.record.display(),
                path.display(),
                short(recorded),
                short(now)
            );
        }
    }
    check_recipes(args, header, &cell)?;
    // A stage that writes a recording is not run again; it gave nothing that could be compared.
    let recorded = header.activations.iter().filter(|a| a.stage != "record");
    let planned: Vec<ActivationName> = names(&cell);
    if !recorded.eq(planned.iter()) {
        bail!(
            "{}: {} planned {} activations in another order than this program ({}); replay with the program that recorded",
            args.record.display(),
            header.software,
            header.activations.len(),
            planned.len()
        );
    }
    Ok(cell)
}

/// Every recipe of the record must still be the one that was recorded. The configuration is known to be the same, so
/// names and number are; the files that it names may have been changed.
fn check_recipes(args: &Args, header: &RecordHeader, cell: &Cell) -> Result<()> {
    let now: Vec<RecordedRecipe> = cell.config.recipes.iter().map(Into::into).collect();
    let changed = header.recipes.iter().zip(&now).find(|(recorded, now)| recorded != now);
    let Some((recorded, _)) = changed else { return Ok(()) };
    bail!(
        "{}: the inspection plan or the calibration_shares of recipe \"{}\" changed since; restore them to replay",
        args.record.display(),
        recorded.name
    )
}

fn names(cell: &Cell) -> Vec<ActivationName> {
    let schedule = &cell.schedule;
    let name = |a: &cell::schedule::Activation| ActivationName {
        stage: schedule.stages[a.stage].name.clone(),
        label: label(&cell.graph, a.work),
        output: output(&cell.graph, a.work),
    };
    schedule.activations.iter().map(name).collect()
}

fn replay(reader: &mut RecordReader, cell: &LoadedCell) -> Result<ReplayReport> {
    let mut found = ReplayReport { recorded_by: reader.header.software.clone(), ..ReplayReport::default() };
    let mut executor = InProcess::new(cell)?;
    let mut source = Source::new(cell, reader.header.retention)?;
    let mut progress = Progress::unbounded("replaying");
    let mut next_number = None;
    loop {
        let cycle = match reader.next_cycle() {
            Ok(Next::Cycle(cycle)) => cycle,
            Ok(Next::Damaged(damaged)) => {
                next_number = Some(damaged.cycle.saturating_add(1));
                found.damage.push(damage(&damaged, &reader.header));
                continue;
            }
            Ok(Next::End(Ending::Sealed(seal))) => {
                (found.sealed, found.lost) = (true, seal.lost);
                return Ok(found);
            }
            Ok(Next::End(Ending::Torn(bytes))) => {
                found.incomplete_bytes = bytes;
                return Ok(found);
            }
            Err(error) => {
                found.damage.push(format!("{error:#}"));
                return Ok(found);
            }
        };
        let number = cycle.entry.cycle;
        found.missing.extend(next_number.unwrap_or(number)..number);
        next_number = Some(number + 1);
        found.cycles += 1;
        again(reader, &cycle, &mut executor, &mut source, &mut found)?;
        progress.step();
    }
}

/// Names the damaged parts of a cycle.
fn damage(damaged: &DamagedCycle, header: &RecordHeader) -> String {
    let part = |part: &Option<u32>| match part.and_then(|number| header.activations.get(number as usize)) {
        Some(name) => format!("the kept bytes of stage {}, \"{}\"", name.stage, name.label),
        None => "hashes, times and outcome".to_owned(),
    };
    let parts: Vec<String> = damaged.parts.iter().map(part).collect();
    format!("cycle {}: {}", damaged.cycle + 1, parts.join(", "))
}

/// Runs one cycle again, as far as it was recorded.
fn again(
    reader: &mut RecordReader,
    cycle: &RecordedCycle,
    executor: &mut InProcess,
    source: &mut Source,
    found: &mut ReplayReport,
) -> Result<()> {
    let activations = reader.header.activations.clone();
    let given = cycle.entry.activations.iter().filter(|a| a.bytes > 0);
    let Some(last) = given.map(|a| a.activation).max() else {
        found.empty += 1;
        return Ok(());
    };
    source.load(reader, cycle)?;
    executor.begin(cycle.entry.recipe as usize);
    for number in 0..=last {
        let recorded = cycle.entry.activations.iter().find(|a| a.activation == number);
        let Some(name) = activations.get(number as usize) else {
            bail!(
                "cycle {} of the record has an activation {number} that the schedule lacks",
                cycle.entry.cycle + 1
            );
        };
        let outcome =
            executor.step(number as usize, source).map_err(|e| format!("{:#}", anyhow::Error::from(e)));
        let Some(recorded) = recorded.filter(|a| a.bytes > 0) else {
            match outcome {
                Ok(_) => continue,
                // A stage of the recorded cycle may have failed here as well; if it did not, something follows below.
                Err(_) if cycle.entry.outcome != files::result::OUTCOME_OK => return Ok(()),
                Err(error) => {
                    found.differences.push(Difference::failed(cycle.entry.cycle, name, error));
                    return Ok(());
                }
            }
        };
        match outcome {
            Ok(bytes) => {
                found.outputs += 1;
                found.bytes += bytes.len() as u64;
                let kept = match cycle.values.get(&number) {
                    Some(value) if compare::hash(bytes) != recorded.hash => Some(reader.load(value)?),
                    _ => None,
                };
                found.differences.extend(Difference::between(
                    cycle.entry.cycle,
                    name,
                    recorded,
                    kept.as_deref(),
                    bytes,
                ));
            }
            Err(error) => {
                found.differences.push(Difference::failed(cycle.entry.cycle, name, error));
                return Ok(());
            }
        }
    }
    Ok(())
}

fn text(path: &Path, header: &RecordHeader, found: &ReplayReport) -> String {
    let mut lines = vec![format!(
        "{}: {} cycles of cell '{}' by {}, {} outputs ({} MB) compared",
        path.display(),
        found.cycles,
        header.cell,
        header.software,
        found.outputs,
        found.bytes / 1_000_000
    )];
    if found.empty > 0 {
        lines.push(format!("{} cycles ended before anything was given", found.empty));
    }
    if let (Some(first), Some(last)) = (found.missing.first(), found.missing.last()) {
        lines.push(format!(
            "{} cycles between {} and {} are not in the record",
            found.missing.len(),
            first + 1,
            last + 1
        ));
    }
    if found.lost > 0 {
        lines.push(format!("{} cycles could not be recorded", found.lost));
    }
    lines.extend(found.damage.iter().map(|what| format!("damaged: {what}")));
    if found.incomplete_bytes > 0 && found.damage.is_empty() {
        lines.push(format!(
            "the record ends within a cycle ({} bytes), which does not count: the run was killed or still goes on",
            found.incomplete_bytes
        ));
    }
    let mut shown = None;
    for difference in &found.differences {
        // What follows in the same cycle mostly follows from it.
        if shown.replace(difference.cycle) != Some(difference.cycle) {
            lines.push(difference.to_string());
        }
    }
    lines.push(match found.differences.len() {
        0 if found.outputs == 0 => "nothing to compare".to_owned(),
        0 if !found.sealed || !found.damage.is_empty() => "what could be compared is equal".to_owned(),
        0 => "all equal".to_owned(),
        n => {
            let hint = if header.retention == Retention::All {
                ""
            } else {
                "; record with --retain all to see the byte"
            };
            format!("{n} outputs differ; of each cycle the first is named{hint}")
        }
    });
    lines.join("\n")
}
