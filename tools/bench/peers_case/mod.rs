//! Our side of a comparison with programs in other languages: one case on inputs that a foreign script wrote, timed as that
//! script times its own (one call to warm up, then repetitions), with the same keys for accuracy.
//!
//! `fringetool bench peers-case --case decode --size 1124x750 --input DIR --repeats 5 --json FILE`

mod clouds;
mod corners;
mod frames;
mod input;
mod memory;
mod phase;

use crate::Outcome;
use crate::report::emit_bare;
use anyhow::{Result, ensure};
use clap::ValueEnum;
use ipc::os::Usage;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Repetitions of one row end after this time, unless fewer than `--repeats` were made.
const BUDGET: Duration = Duration::from_millis(1500);

/// Most repetitions of one row.
const MOST_REPEATS: usize = 50;

/// Case of the comparison that is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
enum Case {
    /// Memory bandwidth of this machine.
    Stream,
    /// Eighteen frames to an absolute phase map.
    Decode,
    /// Two phase maps to points.
    Match,
    /// Two times eighteen frames to points.
    Pipeline,
    /// Spatial unwrapping of one phase map.
    Unwrap,
    /// Corners of a checkerboard in an image.
    Calib,
    /// Adjustment of a calibration: not measured here.
    CalibSolve,
    /// Alignment of two clouds, distances between them.
    Icp,
    /// Least-squares fit of a sphere.
    Sphere,
    /// Transport between processes: see `fringetool bench transport`.
    Ipc,
}

#[derive(clap::Args)]
pub struct Args {
    /// Case of the comparison that is measured.
    #[arg(long, value_enum)]
    case: Case,
    /// Size as in the inputs, for instance `1124x750` or `200k`.
    #[arg(long, default_value = "")]
    size: String,
    /// Folder of the inputs (NumPy files).
    #[arg(long, value_name = "DIR", default_value = "")]
    input: PathBuf,
    /// Least number of repetitions.
    #[arg(
        long = "repeats",
        alias = "reps",
        value_name = "N",
        default_value_t = 5,
        value_parser = clap::value_parser!(u32).range(1..=1000)
    )]
    reps: u32,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// One line of the table.
#[derive(Debug, Serialize)]
struct Row {
    case: String,
    task: String,
    size: String,
    threads: usize,
    n: usize,
    median_ms: f64,
    min_ms: f64,
    max_ms: f64,
    cpu_ms: f64,
    /// Accuracy, or a note.
    #[serde(flatten)]
    extra: Map<String, Value>,
}

/// Measures the rows of one case.
struct Bench {
    case: String,
    size: String,
    input: PathBuf,
    reps: usize,
    rows: Vec<Row>,
}

impl Bench {
    /// Times `call` on so many threads: once to warm up, then at least `--repeats` times.
    fn time(
        &mut self,
        task: &str,
        threads: usize,
        mut call: impl FnMut() -> Result<()> + Send,
    ) -> Result<&mut Row> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        let (mut wall, mut cpu) = pool.install(|| {
            call()?;
            let (mut wall, mut cpu, start) = (Vec::new(), Vec::new(), Instant::now());
            while wall.len() < self.reps || (start.elapsed() < BUDGET && wall.len() < MOST_REPEATS) {
                let (begin, used) = (Instant::now(), Usage::now());
                call()?;
                wall.push(begin.elapsed().as_secs_f64() * 1e3);
                cpu.push((Usage::now().cpu_ns - used.cpu_ns) as f64 * 1e-6);
            }
            anyhow::Ok((wall, cpu))
        })?;
        self.rows.push(Row {
            case: self.case.clone(),
            task: task.to_owned(),
            size: self.size.clone(),
            threads,
            n: wall.len(),
            median_ms: fringe::math::statistics::median(&mut wall).unwrap_or(f64::NAN),
            min_ms: wall.iter().copied().fold(f64::INFINITY, f64::min),
            max_ms: wall.iter().copied().fold(0.0, f64::max),
            cpu_ms: fringe::math::statistics::median(&mut cpu).unwrap_or(f64::NAN),
            extra: Map::new(),
        });
        let last = self.rows.len() - 1;
        Ok(&mut self.rows[last])
    }

    /// Columns and rows of an image size.
    fn image_size(&self) -> Result<(u32, u32)> {
        let sides = self.size.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
        let (width, height) = sides.unwrap_or((0, 0));
        ensure!(
            width > 0 && height > 0,
            "--size {}: must be columns x rows, for instance 1124x750",
            self.size
        );
        Ok((width, height))
    }
}

impl Row {
    /// Adds keys to the row.
    fn with(&mut self, extra: Value) {
        if let Value::Object(extra) = extra {
            self.extra.extend(extra);
        }
    }
}

/// Runs the case, prints its rows and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    // As every stage of a cell does: what is measured uses the same memory again.
    ipc::os::keep_freed_memory();
    let mut bench = Bench {
        case: args.case.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned()),
        size: args.size.clone(),
        input: args.input.clone(),
        reps: args.reps as usize,
        rows: Vec::new(),
    };
    match args.case {
        Case::Stream => memory::stream(&mut bench)?,
        Case::Decode => frames::decode(&mut bench)?,
        Case::Match => frames::matching(&mut bench)?,
        Case::Pipeline => frames::pipeline(&mut bench)?,
        Case::Unwrap => phase::unwrapping(&mut bench)?,
        Case::Calib => corners::corners(&mut bench)?,
        Case::Icp => clouds::icp(&mut bench)?,
        Case::Sphere => clouds::sphere(&mut bench)?,
        Case::CalibSolve | Case::Ipc => {}
    }
    for row in &bench.rows {
        eprintln!(
            "  {:20} {:>9} {} thread{} {:10.3} ms (min {:.3})",
            row.task,
            row.size,
            row.threads,
            if row.threads == 1 { " " } else { "s" },
            row.median_ms,
            row.min_ms
        );
    }
    emit_bare(args.json.as_deref(), &json!({ "rows": bench.rows }))?;
    Ok(Outcome::Done)
}
