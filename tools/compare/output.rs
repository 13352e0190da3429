//! What `compare` prints and writes.

use super::{Align, Alignment, Args, Method};
use crate::register::{determined, doubts, word};
use crate::report::emit;
use crate::software::FRINGETOOL;
use anyhow::Result;
use files::hash::cloud_sha256_hex;
use fringe::cloud::Point;
use metrology::compare::m3c2::M3c2Settings;
use metrology::compare::{Conformity, Counts, Statistics};
use metrology::inspection::AlignmentResult;
use metrology::reference::Reference;
use metrology::register::Registration;
use report::{ColourMap, ComparisonInput, write_comparison};
use serde::Serialize;

/// Colour of points without a deviation.
const GREY: [u8; 3] = [178, 182, 188];

/// A comparison by either method.
pub struct Compared {
    /// The cloud, or the core points.
    pub points: Vec<Point>,
    /// Of each of them.
    pub deviations_mm: Vec<Option<f64>>,
    /// Over all that have one.
    pub statistics: Statistics,
    /// Why others have none.
    pub counts: Option<Counts>,
    /// Levels of detection; `None` without M3C2.
    pub m3c2: Option<Levels>,
    /// What a tolerance says; `None` without one.
    pub conformity: Option<Conformity>,
}

/// Settings and counts of M3C2.
#[derive(Serialize)]
pub struct Levels {
    #[serde(flatten)]
    pub settings: M3c2Settings,
    pub core_points: usize,
    pub without_distance: usize,
    pub with_level: usize,
    pub significant: usize,
    pub lod95_median_mm: Option<f64>,
}

#[derive(Serialize)]
struct Written<'a> {
    cloud: String,
    reference: String,
    reference_kind: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    reference_spacing_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    radius_mm: Option<f64>,
    method: &'static str,
    align: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    best_fit: Option<&'a Registration>,
    #[serde(skip_serializing_if = "Option::is_none")]
    world_from_part: Option<&'a AlignmentResult>,
    max_distance_mm: Option<f64>,
    #[serde(flatten)]
    statistics: &'a Statistics,
    #[serde(flatten)]
    counts: Option<Counts>,
    #[serde(skip_serializing_if = "Option::is_none")]
    m3c2: Option<&'a Levels>,
    #[serde(skip_serializing_if = "Option::is_none")]
    conformity: Option<&'a Conformity>,
    software: &'static str,
}

const SOFTWARE: &str = concat!("fringetool ", env!("CARGO_PKG_VERSION"));

/// Writes what was asked for and prints the numbers.
pub fn write(args: &Args, compared: &Compared, reference: &Reference, alignment: &Alignment) -> Result<()> {
    let result = result(args, compared, reference, alignment);
    let half_range_mm = args.range.unwrap_or(compared.statistics.histogram.high_mm).max(f64::MIN_POSITIVE);
    if let Some(path) = &args.out {
        let value = |d: &Option<f64>| match d {
            Some(mm) => (*mm as f32, ColourMap::Diverging.colour(0.5 + mm / (2.0 * half_range_mm))),
            None => (f32::NAN, GREY),
        };
        let values: Vec<(f32, [u8; 3])> = compared.deviations_mm.iter().map(value).collect();
        let range = format!("{half_range_mm} mm at the ends");
        let comments = [
            ("source", result.cloud.as_str()),
            ("compared_with", result.reference.as_str()),
            ("deviation", "mm, NaN: none"),
            ("colours", range.as_str()),
            ("software", SOFTWARE),
        ];
        files::ply::write_deviations(path, &compared.points, &values, &comments)?;
    }
    if let Some(path) = &args.report {
        let deviations: Vec<(u32, f32)> =
            (0..).zip(&compared.deviations_mm).filter_map(|(i, d)| Some((i, (*d)? as f32))).collect();
        let input = ComparisonInput {
            title: format!("{} against {}", result.cloud, result.reference),
            details: details(args, &result)?,
            tables: tables(compared, alignment),
            cloud: &compared.points,
            deviations: &deviations,
            meaning: meaning(args.method, reference).to_owned(),
            half_range_mm: args.range,
            notes: NOTES.map(str::to_owned).to_vec(),
        };
        write_comparison(path, &input)?;
    }
    emit(args.json.as_deref(), &result)?;
    warn(args, compared);
    print(compared);
    Ok(())
}

fn result<'a>(
    args: &Args,
    compared: &'a Compared,
    reference: &Reference,
    alignment: &'a Alignment,
) -> Written<'a> {
    let cloud = match reference {
        Reference::Cloud(cloud) => Some(cloud),
        Reference::Mesh(_) => None,
    };
    Written {
        cloud: args.cloud.display().to_string(),
        reference: args.reference.display().to_string(),
        reference_kind: if cloud.is_some() { "cloud" } else { "mesh" },
        reference_spacing_mm: cloud.map(metrology::reference::CloudReference::spacing_mm),
        radius_mm: cloud.map(metrology::reference::CloudReference::radius_mm),
        method: match args.method {
            Method::Surface => "surface",
            Method::Nearest => "nearest",
            Method::M3c2 => "m3c2",
        },
        align: match args.align {
            Align::None => "none",
            Align::BestFit => "best-fit",
            Align::Rps => "rps",
        },
        best_fit: match alignment {
            Alignment::BestFit(found) => Some(found),
            _ => None,
        },
        world_from_part: match alignment {
            Alignment::Rps(found) => Some(found),
            _ => None,
        },
        max_distance_mm: args.max_distance,
        statistics: &compared.statistics,
        counts: compared.counts,
        m3c2: compared.m3c2.as_ref(),
        conformity: compared.conformity.as_ref(),
        software: SOFTWARE,
    }
}

/// The tables of the report; the verdict comes first.
fn tables(compared: &Compared, alignment: &Alignment) -> Vec<(String, Vec<[String; 3]>)> {
    let tolerance = tolerance_rows(compared).map(|rows| ("Tolerance".to_owned(), rows));
    let others = [("Deviations".into(), rows(compared)), ("Alignment".into(), alignment_rows(alignment))];
    tolerance.into_iter().chain(others).collect()
}

fn print(compared: &Compared) {
    let conformity = tolerance_rows(compared).unwrap_or_default();
    for [label, value, meaning] in rows(compared).into_iter().chain(conformity) {
        println!("{label:24} {value:>14}  {meaning}");
    }
}

/// Says that a verdict has no guard band.
fn warn(args: &Args, compared: &Compared) {
    if compared.conformity.is_some_and(|conformity| !conformity.has_guard_band()) {
        eprintln!(
            "warning: {}: has no uncertainties, so the verdict has no guard band; E57 and STL-derived clouds have none; use the PLY \
             of reconstruct",
            args.cloud.display()
        );
    }
}

/// The rows of the tolerance, where there is one.
fn tolerance_rows(compared: &Compared) -> Option<Vec<[String; 3]>> {
    compared.conformity.as_ref().map(conformity_rows)
}

fn conformity_rows(c: &Conformity) -> Vec<[String; 3]> {
    let row = |label: &str, value: String, meaning: &str| [label.to_owned(), value, meaning.to_owned()];
    let percent = |share: f64| format!("{:.3} %", 100.0 * share);
    let limits = format!("{} … {}", c.tolerance.lower_mm, c.tolerance.upper_mm);
    let rule = if c.has_guard_band() {
        "by ISO 14253-1"
    } else {
        "without uncertainties of the points: simple acceptance, not by ISO 14253-1"
    };
    vec![
        row("Verdict", c.verdict.word().to_owned(), rule),
        row("Tolerance", limits, "mm"),
        row("Allowed outside", percent(c.tolerance.allowed_share), "of the points that are judged"),
        row("Outside", percent(c.outside_share), "below, above, or farther away than is compared"),
        row(
            "Proven outside",
            percent(c.proven_outside_share),
            "outside by more than 2 standard uncertainties",
        ),
        row("Possibly outside", percent(c.possibly_outside_share), "not inside by 2 standard uncertainties"),
        row("Below, above, too far", format!("{}, {}, {}", c.below, c.above, c.too_far), "points"),
        row(
            "Not judged",
            c.not_judged.to_string(),
            "points beside the reference, or where it has no surface",
        ),
        row(
            "Largest guard band",
            format!("{:.5}", c.largest_guard_mm),
            "mm, of point and reference; 0 where neither has uncertainties",
        ),
    ]
}

fn rows(compared: &Compared) -> Vec<[String; 3]> {
    let s = &compared.statistics;
    let row = |label: &str, value: String, meaning: &str| [label.to_owned(), value, meaning.to_owned()];
    let mm = |label: &str, value: f64, meaning: &str| row(label, format!("{value:+.5}"), meaning);
    let mut rows = vec![
        row("Compared", s.count.to_string(), "points with a deviation"),
        mm("Mean", s.mean_mm, "mm"),
        row("Standard deviation", s.sd_mm.map_or("–".into(), |v| format!("{v:.5}")), "mm, n − 1"),
        row("Root mean square", format!("{:.5}", s.rms_mm), "mm"),
        row("Mean magnitude", format!("{:.5}", s.mean_abs_mm), "mm"),
        mm("Median", s.median_mm, "mm"),
        mm("Smallest", s.min_mm, "mm"),
        mm("Largest", s.max_mm, "mm"),
    ];
    for p in s.percentiles.iter().filter(|p| [2.5, 97.5].contains(&p.percent)) {
        rows.push(mm(&format!("Percentile {}", p.percent), p.value_mm, "mm"));
    }
    if let Some(c) = compared.counts {
        for (label, cut, meaning) in [
            ("Cut, too far", c.cut_too_far, "points farther than the limit"),
            ("Cut, beside", c.cut_beyond_edge, "points beyond the edge of the reference"),
            ("Cut, no surface", c.cut_no_surface, "points where the reference has too few"),
        ] {
            rows.push(row(label, cut.to_string(), meaning));
        }
    }
    if let Some(m) = &compared.m3c2 {
        rows.push(row("Core points", m.core_points.to_string(), "of the reference"));
        rows.push(row("Without distance", m.without_distance.to_string(), "core points without both clouds"));
        rows.push(row(
            "Significant",
            format!("{} of {}", m.significant, m.with_level),
            "beyond the level of detection",
        ));
        let level = m.lod95_median_mm.map_or("–".into(), |v| format!("{v:.5}"));
        rows.push(row("Level of detection", level, "mm, 95 %, median"));
    }
    rows
}

fn details(args: &Args, result: &Written<'_>) -> Result<Vec<(String, String)>> {
    let (cloud, reference) = (cloud_sha256_hex(&args.cloud)?, cloud_sha256_hex(&args.reference)?);
    let mut lines = vec![
        ("Cloud".to_owned(), format!("{} (SHA-256 {cloud})", result.cloud)),
        (
            "Reference".to_owned(),
            format!("{} ({}, SHA-256 {reference})", result.reference, result.reference_kind),
        ),
        ("Operator".to_owned(), args.operator.clone().unwrap_or_else(|| "not stated".to_owned())),
        ("Method".to_owned(), result.method.to_owned()),
        ("Alignment".to_owned(), result.align.to_owned()),
        ("Date".to_owned(), files::clock::rfc3339_now()),
        ("Software".to_owned(), FRINGETOOL.line()),
    ];
    if let Some(spacing) = result.reference_spacing_mm {
        lines.push(("Spacing of the reference".to_owned(), format!("{spacing:.4} mm")));
    }
    if let Some(limit) = args.max_distance {
        lines.push(("Largest distance".to_owned(), format!("{limit} mm")));
    }
    Ok(lines)
}

fn alignment_rows(alignment: &Alignment) -> Vec<[String; 3]> {
    let row = |label: &str, value: String, meaning: &str| [label.to_owned(), value, meaning.to_owned()];
    let vector = |v: [f64; 3]| v.map(|c| format!("{c:.5}")).join("  ");
    match alignment {
        Alignment::None => vec![row("None", "as it lay".into(), "")],
        Alignment::Rps(found) => vec![
            row("3-2-1 on the plan's datums", format!("{} rounds", found.rounds), ""),
            row("Origin of the part", vector(found.translation_mm), "mm, world frame"),
            row("Residual of the datum line", format!("{:+.5}", found.line_residual_mm), "mm"),
        ],
        Alignment::BestFit(found) => {
            let mut rows = vec![
                row("Best fit", word(found).into(), &format!("after {:?} iterations", found.iterations)),
                row("Translation", vector(found.translation_mm), "mm"),
                row("Rotation", format!("{:.6}", found.angle_deg()), "°"),
                row("Residual", format!("{:.5}", found.rms_mm), "mm rms along the normal"),
                row("Overlap", format!("{:.1}", 100.0 * found.overlap), "% of the cloud's points"),
                row(
                    "Uncertainty of the place",
                    found.u_translation_mm.map(|u| determined(u, format!("{u:.5}"))).join("  "),
                    "mm, k = 1, correlation of neighbours included",
                ),
            ];
            rows.extend(doubts(found).into_iter().map(|doubt| row("Attention", doubt, "")));
            rows
        }
    }
}

fn meaning(method: Method, reference: &Reference) -> &'static str {
    match (method, reference) {
        (Method::M3c2, _) => {
            "Mean of the cloud less mean of the reference in a cylinder along the reference's normal, at core points of the \
             reference; positive outside."
        }
        (Method::Nearest, Reference::Mesh(_)) => {
            "Shortest distance from the triangles of the mesh, without a sign."
        }
        (Method::Nearest, Reference::Cloud(_)) => {
            "Distance from the nearest point of the reference, without a sign; it grows with the spacing of these points."
        }
        (Method::Surface, Reference::Mesh(_)) => {
            "Shortest distance from the triangles of the mesh, positive outside."
        }
        (Method::Surface, Reference::Cloud(_)) => {
            "Distance along the normal from the paraboloid through the reference's points around the nearest one, positive \
             outside."
        }
    }
}

const NOTES: [&str; 4] = [
    "Mean: arithmetic mean. Standard deviation: sample standard deviation, n − 1, about the mean. Root mean square: about \
     zero. Percentiles: linear between sorted values, the smallest being 0 % and the largest 100 %.",
    "A best fit shares deviations out over the whole part and hides a shift or tilt; where datums are given, align to them.",
    "Points whose foot lies beside the reference, and those farther away than the largest distance, are counted and left out.",
    "M3C2: D. Lague, N. Brodu, J. Leroux, ISPRS J. 82, 2013; level of detection 1.96 (√(s₁²/n₁ + s₂²/n₂) + registration).",
];
