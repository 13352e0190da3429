//! Gantt chart of the schedule of a cycle, as text and as SVG.
//!
//! A schedule defines an order, not times. Without measured times every activation has the length of one unit; with a result
//! of the cell, the mean duration of its stage in that cycle. An activation starts when its inputs and the previous
//! activation of its lane are done. If cycles overlap, the chart shows two of them, the second one pale or in lower case. It
//! does not show how the two lanes of a core slow each other down.

use anyhow::{Result, ensure};
use cell::Cell;
use cell::schedule::{Activation, Half, Lane, Order, Schedule, Work, label};
use files::result::CycleResult;
use report::Page;
use report::svg::{self, Anchor};
use std::fmt::Write as _;

/// Width of the chart on the terminal without names, columns.
const COLUMNS: usize = 96;

/// Width of the time axis, px.
const WIDTH_PX: f64 = 1400.0;

/// Height of a stage, px.
const ROW_PX: f64 = 26.0;

/// Smallest width of a bar, px.
const LEAST_PX: f64 = 1.5;

/// Size of the letters, px.
const FONT: f64 = 12.0;

/// Left margin for the names, px.
const LEFT_PX: f64 = 190.0;

/// Top margin for title and axis, px.
const TOP_PX: f64 = 64.0;

/// A schedule with times.
#[derive(Debug, Clone, PartialEq)]
pub struct ScheduleChart {
    /// For each cycle of the chart: start and end of each activation, ms or units.
    cycles: Vec<Vec<(f64, f64)>>,
    /// Time from the start of a cycle to that of the next: at least each half, and at least the work of each core.
    period: f64,
    /// Unit of the times: `ms` or `units`.
    unit: &'static str,
}

impl ScheduleChart {
    /// Computes the times; `measured` is the result of a cycle of this cell.
    ///
    /// # Errors
    /// The result is of another cell, or of a cycle that is not ok.
    pub fn new(schedule: &Schedule, measured: Option<&CycleResult>) -> Result<Self> {
        let durations = match measured {
            Some(result) => durations(schedule, result)?,
            None => vec![1.0; schedule.stages.len()],
        };
        let unit = if measured.is_some() { "ms" } else { "units" };
        let first = place(schedule, &durations, 0.0, 0.0);
        let verdict = end(&first);
        if schedule.in_flight == 1 {
            return Ok(Self { cycles: vec![first], period: verdict, unit });
        }
        let of = |half: Half| {
            first.iter().zip(&schedule.activations).filter(move |(_, a)| schedule.half(a) == half)
        };
        let acquired = of(Half::Acquisition).map(|(bar, _)| bar.1).fold(0.0, f64::max);
        let evaluated = verdict - of(Half::Evaluation).map(|(bar, _)| bar.0).fold(verdict, f64::min);
        let busiest = busiest(schedule, &durations);
        let second = place(schedule, &durations, acquired, verdict);
        Ok(Self { cycles: vec![first, second], period: acquired.max(evaluated).max(busiest), unit })
    }

    /// Compares measured times with the limits, as text and as whether they are kept. `None` without measured times.
    pub fn check_limits(&self, cell: &Cell) -> Option<(String, bool)> {
        let limits = &cell.config.limits;
        let (budget_ms, deadline_ms) = (limits.stage_budget_ms as f64, limits.cycle_deadline_ms as f64);
        let lasts = |bar: &(f64, f64)| bar.1 - bar.0;
        let longest = self.cycles[0]
            .iter()
            .zip(&cell.schedule.activations)
            .max_by(|a, b| lasts(a.0).total_cmp(&lasts(b.0)));
        let (bar, activation) = longest.filter(|_| self.unit == "ms")?;
        let (longest_ms, verdict_ms) = (lasts(bar), end(&self.cycles[0]));
        let met = |met: bool| if met { "kept" } else { "EXCEEDED" };
        let text = format!(
            "measured: verdict after {verdict_ms:.1} ms, deadline {deadline_ms} ms {}; longest activation \"{}\" of {} \
             {longest_ms:.1} ms, stage budget {budget_ms} ms {}",
            met(verdict_ms <= deadline_ms),
            label(&cell.graph, activation.work),
            cell.schedule.stages[activation.stage].name,
            met(longest_ms <= budget_ms)
        );
        Some((text, verdict_ms <= deadline_ms && longest_ms <= budget_ms))
    }

    /// All bars: index of the cycle, activation, start and end.
    fn bars<'a>(
        &'a self,
        schedule: &'a Schedule,
    ) -> impl Iterator<Item = (usize, &'a Activation, (f64, f64))> {
        let cycles = self.cycles.iter().enumerate();
        cycles.flat_map(|(cycle, bars)| {
            schedule.activations.iter().zip(bars).map(move |(a, &bar)| (cycle, a, bar))
        })
    }

    fn end(&self) -> f64 {
        self.cycles.iter().map(|bars| end(bars)).fold(f64::MIN_POSITIVE, f64::max)
    }

    /// The chart as text: one line per stage, one letter per slice of time.
    pub fn text(&self, cell: &Cell) -> String {
        let schedule = &cell.schedule;
        let name = schedule.stages.iter().map(|s| s.name.chars().count()).max().unwrap_or(0);
        let slice = self.end() / COLUMNS as f64;
        let mut text = format!(
            "a cycle every {:.1} {unit}, from its start to the verdict {:.1} {unit}\n\
             one column is {slice:.2} {unit}; P project  E expose  A accumulate  Φ phase  M match  T take  F fuse  I inspect  S store  · idle\n",
            self.period,
            end(&self.cycles[0]),
            unit = self.unit
        );
        for (number, stage) in schedule.stages.iter().enumerate() {
            let mut line = vec!['·'; COLUMNS];
            for (cycle, activation, bar) in self.bars(schedule).filter(|(_, a, _)| a.stage == number) {
                // A bar shorter than a column still shows.
                let first = ((bar.0 / slice) as usize).min(COLUMNS - 1);
                let last = ((bar.1 / slice).ceil() as usize).clamp(first + 1, COLUMNS);
                let letter = letter(activation.work);
                line[first..last].fill(if cycle == 0 { letter } else { small(letter) });
            }
            let line: String = line.into_iter().collect();
            let _ = writeln!(text, "{:<name$} {} {line}", stage.name, stage.core);
        }
        text
    }

    /// The chart as SVG, with every activation and every dependency between stages.
    pub fn svg(&self, cell: &Cell) -> String {
        let schedule = &cell.schedule;
        let height = TOP_PX + ROW_PX * schedule.stages.len() as f64 + 40.0;
        let width = LEFT_PX + WIDTH_PX + 30.0;
        let scale = WIDTH_PX / self.end();
        let mut page = svg::begin_file([width, height], FONT);
        let title = format!(
            "cell {}: {} activations of {} stages on {} cores, {:.1} {}{}",
            cell.name,
            schedule.activations.len(),
            schedule.stages.len(),
            schedule.cores,
            self.end(),
            self.unit,
            if self.cycles.len() > 1 { " for two cycles that overlap" } else { "" }
        );
        svg::text(&mut page, [12.0, 22.0], 16.0, Anchor::Start, &title);
        self.axis(&mut page, scale, height);
        for (number, stage) in schedule.stages.iter().enumerate() {
            let y = TOP_PX + ROW_PX * number as f64;
            svg::text(&mut page, [12.0, y + 17.0], FONT, Anchor::Start, &stage.name);
            let core = format!("core {}", stage.core);
            svg::styled_text(&mut page, [LEFT_PX - 8.0, y + 17.0], FONT, Anchor::End, "fill=\"#777\"", &core);
            svg::line(&mut page, [[LEFT_PX, y], [LEFT_PX + WIDTH_PX, y]], "stroke=\"#eee\"");
        }
        self.dependencies(&mut page, schedule, scale);
        for (cycle, activation, bar) in self.bars(schedule) {
            let at = [LEFT_PX + scale * bar.0, TOP_PX + ROW_PX * activation.stage as f64 + 4.0];
            // A trigger would be too narrow to see.
            let size = [(scale * (bar.1 - bar.0)).max(LEAST_PX), ROW_PX - 8.0];
            let opacity = if cycle == 0 { 1.0 } else { 0.45 };
            let style = format!("opacity=\"{opacity}\" stroke=\"#fff\" stroke-width=\"0.5\"");
            let shown = label(&cell.graph, activation.work);
            let title = format!("{shown}, {:.2} to {:.2} {}", bar.0, bar.1, self.unit);
            svg::titled_rectangle(&mut page, at, size, colour(activation.work), &style, &title);
        }
        legend(&mut page, height);
        svg::end_file(page)
    }

    fn axis(&self, page: &mut Page, scale: f64, height: f64) {
        let step = report::number::round_up(self.end() / 8.0);
        let mut at = 0.0;
        while at <= self.end() {
            let x = LEFT_PX + scale * at;
            svg::line(page, [[x, TOP_PX - 8.0], [x, height - 36.0]], "stroke=\"#ddd\"");
            let value = format!("{at} {}", self.unit);
            svg::styled_text(page, [x, TOP_PX - 14.0], FONT, Anchor::Middle, "fill=\"#555\"", &value);
            at += step;
        }
    }

    /// Lines from the end of an input to the start of the activation that uses it, between different stages.
    fn dependencies(&self, page: &mut Page, schedule: &Schedule, scale: f64) {
        let middle = |stage: usize| TOP_PX + ROW_PX * (stage as f64 + 0.5);
        for (cycle, activation, bar) in self.bars(schedule) {
            for &input in
                activation.inputs.iter().filter(|&&i| schedule.activations[i].stage != activation.stage)
            {
                let end = self.cycles[cycle][input].1;
                let from = [LEFT_PX + scale * end, middle(schedule.activations[input].stage)];
                let to = [LEFT_PX + scale * bar.0, middle(activation.stage)];
                svg::line(page, [from, to], "stroke=\"#bbb\" stroke-width=\"0.6\"");
            }
        }
    }
}

/// Start and end of the activations of a cycle whose halves start at these times at the earliest.
fn place(schedule: &Schedule, durations: &[f64], acquisition: f64, evaluation: f64) -> Vec<(f64, f64)> {
    let order = Order::new(schedule);
    let begin = |lane: &Lane| if lane.half == Half::Evaluation { evaluation } else { acquisition };
    let mut free: Vec<f64> = order.lanes.iter().map(begin).collect();
    let mut bars: Vec<(f64, f64)> = Vec::with_capacity(schedule.activations.len());
    for (number, activation) in schedule.activations.iter().enumerate() {
        let lane = order.lane[number];
        let start = activation.inputs.iter().map(|&input| bars[input].1).fold(free[lane], f64::max);
        free[lane] = start + durations[activation.stage];
        bars.push((start, free[lane]));
    }
    bars
}

fn end(bars: &[(f64, f64)]) -> f64 {
    bars.iter().map(|bar| bar.1).fold(f64::MIN_POSITIVE, f64::max)
}

/// Work of a cycle on the busiest core.
fn busiest(schedule: &Schedule, durations: &[f64]) -> f64 {
    // The link to other hosts stands behind the cores.
    let mut work = vec![0.0; schedule.cores + 1];
    for activation in &schedule.activations {
        work[schedule.stages[activation.stage].core] += durations[activation.stage];
    }
    work.into_iter().fold(0.0, f64::max)
}

/// Mean duration of an activation of each stage, ms.
fn durations(schedule: &Schedule, result: &CycleResult) -> Result<Vec<f64>> {
    let names = |stages: Vec<&str>| stages.join(", ");
    let (planned, measured): (Vec<&str>, Vec<&str>) = (
        schedule.stages.iter().map(|s| s.name.as_str()).collect(),
        result.stages.iter().map(|s| s.name.as_str()).collect(),
    );
    ensure!(
        planned == measured,
        "the result is of another cell: it has the stages {}, the schedule has {}",
        names(measured),
        names(planned)
    );
    let mean = |stage: &files::result::StageResult| {
        ensure!(
            stage.activations > 0,
            "stage {} did nothing in cycle {}; use the result of a cycle that is ok",
            stage.name,
            result.cycle + 1
        );
        Ok(stage.compute_ns.saturating_add(stage.send_ns) as f64 / 1e6 / f64::from(stage.activations))
    };
    result.stages.iter().map(mean).collect()
}

fn letter(work: Work) -> char {
    match work {
        Work::Project { .. } => 'P',
        Work::Expose { .. } => 'E',
        Work::Accumulate { .. } => 'A',
        Work::Phase { .. } => 'Φ',
        Work::Match { .. } => 'M',
        Work::Take { .. } => 'T',
        Work::Fuse => 'F',
        Work::Inspect => 'I',
        Work::Store => 'S',
        Work::Remote { .. } => 'R',
        Work::Receive { .. } => 'C',
        Work::HandOver => 'H',
        Work::Deliver => 'D',
    }
}

/// The letter for the second cycle.
fn small(letter: char) -> char {
    letter.to_lowercase().next().unwrap_or(letter)
}

/// Kinds of work with their colours (Okabe and Ito: distinct for colour-blind readers).
const COLOURS: [(&str, &str); 9] = [
    ("project", "#e69f00"),
    ("expose", "#56b4e9"),
    ("accumulate", "#009e73"),
    ("phase", "#b8a900"),
    ("match", "#0072b2"),
    ("fuse", "#d55e00"),
    ("inspect", "#cc79a7"),
    ("store", "#999999"),
    ("other hosts", "#000000"),
];

fn colour(work: Work) -> &'static str {
    let place = match work {
        Work::Project { .. } => 0,
        Work::Expose { .. } => 1,
        Work::Accumulate { .. } => 2,
        Work::Phase { .. } => 3,
        Work::Match { .. } => 4,
        Work::Take { .. } | Work::Fuse => 5,
        Work::Inspect => 6,
        Work::Store => 7,
        Work::Remote { .. } | Work::Receive { .. } | Work::HandOver | Work::Deliver => 8,
    };
    COLOURS[place].1
}

fn legend(page: &mut Page, height: f64) {
    for (place, (name, colour)) in COLOURS.iter().enumerate() {
        let x = LEFT_PX + 110.0 * place as f64;
        svg::rectangle(page, [x, height - 24.0], [12.0, 12.0], colour, "");
        svg::text(page, [x + 17.0, height - 14.0], FONT, Anchor::Start, name);
    }
}
