//! The plan as JSON, table, text and picture.

use super::Args;
use super::features::{COVERAGE_FACTOR, ExpectedFeature};
use super::proposals::{ProposedPair, stand};
use super::task::Task;
use anyhow::Result;
use bytemuck::Zeroable as _;
use fringe::cloud::Point;
use fringe::geometry::rig::Named;
use metrology::view_planning::{CauseArea, Coverage, PairCoverage, Patch, Seeing};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// Patches that are listed.
const PATCHES: usize = 20;
/// Patches that are printed.
const PRINTED_PATCHES: usize = 5;

/// Everything that was found.
pub(super) struct Planned {
    pub(super) seeing: Vec<Seeing>,
    pub(super) coverage: Coverage,
    pub(super) patches: Vec<Patch>,
    pub(super) features: Option<Vec<ExpectedFeature>>,
    pub(super) proposals: Vec<ProposedPair>,
}

impl Planned {
    /// What all pairs see of one element.
    fn of_element(&self, element: usize) -> &[Seeing] {
        let pairs = self.coverage.pairs.len();
        &self.seeing[element * pairs..(element + 1) * pairs]
    }

    fn never_mm2(&self) -> f64 {
        self.coverage.by_pairs_mm2[0]
    }
}

/// The least uncertainty of a point among the pairs that see an element, mm; NaN where none does.
fn least_sigma_mm(seeing: &[Seeing]) -> f32 {
    seeing.iter().filter(|s| s.is_seen()).map(|s| s.sigma_mm).fold(f32::NAN, f32::min)
}

fn seen_by(seeing: &[Seeing]) -> usize {
    seeing.iter().filter(|seeing| seeing.is_seen()).count()
}

/// The result for a program.
pub(super) fn machine_readable(args: &Args, task: &Task, planned: &Planned) -> Value {
    let coverage = &planned.coverage;
    let rig = &task.rig_file.rig;
    let pairs: Vec<Value> = rig
        .pairs
        .iter()
        .zip(&coverage.pairs)
        .enumerate()
        .map(|(number, (pair, seen))| {
            let mut value = json!(seen);
            value["name"] = json!(pair.name);
            value["left"] = json!(pair.left);
            value["right"] = json!(pair.right);
            value["light_known"] = json!(task.planner.is_lit(number));
            value
        })
        .collect();
    let by_pairs: Vec<Value> = coverage
        .by_pairs_mm2
        .iter()
        .enumerate()
        .map(|(pairs, area_mm2)| json!({ "pairs": pairs, "area_mm2": area_mm2 }))
        .collect();
    let patches: Vec<&Patch> = planned.patches.iter().take(PATCHES).collect();
    json!({
        "part": args.part,
        "rig": task.rig_file.path,
        "conditions": task.planner.conditions(),
        "elements": task.planner.elements().len(),
        "area_mm2": coverage.area_mm2,
        "buried_mm2": coverage.buried_mm2,
        "by_pairs": by_pairs,
        "pairs": pairs,
        "never_seen": { "area_mm2": planned.never_mm2(), "causes": coverage.never, "patches": patches },
        "k": COVERAGE_FACTOR,
        "features": planned.features,
        "proposals": planned.proposals.iter().map(proposal).collect::<Vec<_>>(),
    })
}

fn proposal(proposal: &ProposedPair) -> Value {
    let view = |view: &Named| {
        let (centre_mm, direction) = stand(&view.camera);
        json!({ "name": view.name, "centre_mm": centre_mm, "direction": direction })
    };
    json!({
        "pair": proposal.pair.name,
        "turned_from": proposal.turned_from,
        "gain_mm2": proposal.gain_mm2,
        "left_mm2": proposal.left_mm2,
        "cameras": proposal.rig.cameras.iter().map(view).collect::<Vec<_>>(),
        "projectors": proposal.rig.projectors.iter().map(view).collect::<Vec<_>>(),
    })
}

/// One line for each element.
pub(super) fn csv(task: &Task, planned: &Planned) -> String {
    let mut out = String::from("x_mm,y_mm,z_mm,nx,ny,nz,area_mm2,pairs,least_sigma_mm");
    for pair in task.planner.pairs() {
        for column in ["cause", "incidence_deg", "modulation_dn", "sigma_mm", "bounce"] {
            let _ = write!(out, ",{}_{column}", pair.name);
        }
    }
    out.push('\n');
    let number = |value: f32| if value.is_finite() { format!("{value:.6}") } else { String::new() };
    for (index, element) in task.planner.elements().iter().enumerate() {
        let seeing = planned.of_element(index);
        let (at, normal) = (element.at, element.normal);
        let _ = write!(
            out,
            "{:.4},{:.4},{:.4},{:.5},{:.5},{:.5},{:.6},{},{}",
            at.x,
            at.y,
            at.z,
            normal.x,
            normal.y,
            normal.z,
            element.area_mm2,
            seen_by(seeing),
            number(least_sigma_mm(seeing))
        );
        for seen in seeing {
            let cause = json!(seen.cause);
            let _ = write!(
                out,
                ",{},{},{},{},{}",
                cause.as_str().unwrap_or_default(),
                number(seen.incidence_rad.to_degrees()),
                number(seen.modulation_dn),
                number(seen.sigma_mm),
                number(seen.bounce)
            );
        }
        out.push('\n');
    }
    out
}

/// Number of pairs and uncertainty on the part.
pub(super) fn picture(task: &Task, planned: &Planned) -> Result<Vec<u8>> {
    let elements = task.planner.elements().iter().enumerate().filter(|(_, element)| !element.buried);
    let (mut points, mut pairs, mut sigmas_um) = (Vec::new(), Vec::new(), Vec::new());
    for (index, element) in elements {
        let seeing = planned.of_element(index);
        let normal: [f64; 3] = element.normal.into();
        points.push(Point {
            position_mm: element.at.coords.into(),
            normal: normal.map(|c| c as f32),
            ..Point::zeroed()
        });
        pairs.push(seen_by(seeing));
        sigmas_um.push(1e3 * least_sigma_mm(seeing));
    }
    Ok(report::view_plan_png(&points, &pairs, &sigmas_um, planned.coverage.pairs.len())?)
}

/// Prints what a person wants to know first.
pub(super) fn print(args: &Args, task: &Task, planned: &Planned) {
    let coverage = &planned.coverage;
    let share = |area_mm2: f64| 100.0 * area_mm2 / coverage.area_mm2.max(f64::MIN_POSITIVE);
    println!(
        "{}: {:.0} mm² in {} elements of up to {} mm",
        args.part.display(),
        coverage.area_mm2,
        task.planner.elements().len(),
        args.element_mm
    );
    if coverage.buried_mm2 > 0.0 {
        println!("  {:.0} mm² lie within other bodies of the part and count nowhere", coverage.buried_mm2);
    }
    for (pairs, area_mm2) in coverage.by_pairs_mm2.iter().enumerate() {
        println!("  seen by {pairs} pairs: {area_mm2:.0} mm², {:.1} %", share(*area_mm2));
    }
    println!(
        "{:12} {:>9} {:>7} {:>11} {:>10} {:>10} {:>10} {:>9} {:>12}",
        "pair", "seen mm²", "%", "incidence °", "B DN", "σ µm", "σ 95 % µm", "bounce %", "bounce > 5 %"
    );
    for (number, (pair, seen)) in task.planner.pairs().zip(&coverage.pairs).enumerate() {
        println!("{}", line(&pair.name, seen, share(seen.seen_mm2)));
        println!("{:12} not seen: {}", "", causes(&seen.lost));
        if !task.planner.is_lit(number) {
            println!("{:12} the rig does not state its projector: light and uncertainty are not known", "");
        }
    }
    print_never(task, planned);
    print_features(planned);
    for proposal in &planned.proposals {
        let from = proposal.turned_from.as_ref().map_or_else(String::new, |pair| format!(", {pair} turned"));
        println!(
            "proposed: pair {}{from}: sees {:.0} mm² that no pair saw before, {:.0} mm² are left",
            proposal.pair.name, proposal.gain_mm2, proposal.left_mm2
        );
        for view in proposal.rig.cameras.iter().chain(&proposal.rig.projectors) {
            let ([x, y, z], [dx, dy, dz]) = stand(&view.camera);
            println!(
                "  {} at ({x:.1}, {y:.1}, {z:.1}) mm, looking along ({dx:.4}, {dy:.4}, {dz:.4})",
                view.name
            );
        }
    }
    if args.propose > 0 && planned.proposals.is_empty() {
        println!("proposed: none; no candidate sees a thousandth of the part that is not seen yet");
    }
}

fn line(name: &str, seen: &PairCoverage, share: f64) -> String {
    let number = |value: Option<f64>, scale: f64, digits: usize| {
        value.map_or_else(|| "–".to_owned(), |v| format!("{:.digits$}", scale * v))
    };
    format!(
        "{name:12} {:>9.0} {share:>7.1} {:>11} {:>10} {:>10} {:>10} {:>9} {:>12}",
        seen.seen_mm2,
        number(seen.incidence_median_deg, 1.0, 1),
        number(seen.modulation_median_dn, 1.0, 1),
        number(seen.sigma_median_mm, 1e3, 2),
        number(seen.sigma_p95_mm, 1e3, 2),
        number(seen.bounce_median, 100.0, 1),
        number(seen.bounce_risk_mm2, 1.0, 0),
    )
}

fn causes(list: &[CauseArea]) -> String {
    let one = |area: &CauseArea| format!("{:.0} mm² {}", area.area_mm2, area.cause.words());
    if list.is_empty() { "nothing".to_owned() } else { list.iter().map(one).collect::<Vec<_>>().join(", ") }
}

fn print_never(task: &Task, planned: &Planned) {
    println!("never seen: {}", causes(&planned.coverage.never));
    for patch in planned.patches.iter().take(PRINTED_PATCHES) {
        let ([x, y, z], [nx, ny, nz]) = (patch.centre_mm, patch.normal);
        println!(
            "  {:.0} mm² about ({x:.1}, {y:.1}, {z:.1}) mm, facing ({nx:.2}, {ny:.2}, {nz:.2}): {}",
            patch.area_mm2,
            patch.cause.words()
        );
    }
    if planned.patches.len() > PRINTED_PATCHES {
        println!("  and {} smaller ones", planned.patches.len() - PRINTED_PATCHES);
    }
    let nothing = planned.coverage.by_pairs_mm2.iter().skip(1).all(|area| *area == 0.0);
    if nothing && task.is_open {
        println!("  no pair sees anything of this open mesh: if it is inside out, turn its faces round");
    }
}

fn print_features(planned: &Planned) {
    let Some(features) = &planned.features else { return };
    println!("{:28} {:>12} {:>12} {:>12} {:>8}  k = 2", "feature", "U", "u noise", "u calibr.", "points");
    for feature in features {
        let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |v| format!("{v:.5}"));
        match &feature.reason {
            Some(reason) => println!("{:28} no pair measures it: {reason}", feature.name),
            None => println!(
                "{:28} {:>9} {:<2} {:>12} {:>12} {:>8}",
                feature.name,
                number(feature.expanded_u),
                feature.unit,
                number(feature.u_noise),
                number(feature.u_calibration),
                feature.points
            ),
        }
    }
}
