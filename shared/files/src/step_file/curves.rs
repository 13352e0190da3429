//! Curves: lines, conics, B-splines and polylines, alone or within others that trim or name them.

use super::graph::{Graph, references};
use super::part21::Value;
use super::units::Units;
use crate::error::FileError;
use fringe::math;
use metrology::cad::{Curve, Frame, Knots, Profile, Spline};
use nalgebra::Point3;

/// What to do about geometry that is not read.
pub(super) const OTHER_EXPORT: &str = "export the part again with other curves and surfaces, or as STL";

/// Curves within curves, surfaces within surfaces; deeper ones are circles.
pub(super) const DEEPEST: usize = 8;

/// Most control points of a curve or surface.
pub(super) const MOST_POLES: usize = 250_000;

/// Curves that name another one, at their second parameter.
const NAMING: [&str; 4] = ["SURFACE_CURVE", "SEAM_CURVE", "INTERSECTION_CURVE", "TRIMMED_CURVE"];

/// The curve of an edge between two corners, in mm.
pub(super) fn curve(
    graph: &Graph,
    units: Units,
    id: u64,
    ends: [Point3<f64>; 2],
    depth: usize,
) -> Result<Curve, FileError> {
    let depth = deeper(graph, id, depth)?;
    for kind in NAMING {
        if let Some(params) = graph.record(id, kind) {
            return curve(graph, units, graph.reference(id, params, 1)?, ends, depth);
        }
    }
    if graph.record(id, "LINE").is_some() {
        return Ok(Curve::Line);
    }
    if let Some((frame, halves)) = ellipse(graph, units, id)? {
        return Ok(Curve::Ellipse(frame, halves));
    }
    if let Some(spline) = conic_arc(graph, units, id, ends)? {
        return Ok(Curve::Spline(spline));
    }
    spline(graph, units, id).map(Curve::Spline)
}

/// The line that a surface is made of, in mm; `None` for a straight one: see [`straight`].
pub(super) fn profile(graph: &Graph, units: Units, id: u64, depth: usize) -> Result<Profile, FileError> {
    let depth = deeper(graph, id, depth)?;
    for kind in NAMING {
        if let Some(params) = graph.record(id, kind) {
            let inner = profile(graph, units, graph.reference(id, params, 1)?, depth)?;
            let turned = kind == "TRIMMED_CURVE" && !graph.truth(id, params, 4)?;
            return Ok(if turned { reversed(inner) } else { inner });
        }
    }
    if let Some((frame, halves)) = ellipse(graph, units, id)? {
        return Ok(Profile::Ellipse(frame, halves));
    }
    spline(graph, units, id).map(Profile::Spline)
}

/// The LINE that a curve is at last, and whether it runs the other way.
pub(super) fn straight(graph: &Graph, id: u64, depth: usize) -> Result<Option<(u64, bool)>, FileError> {
    let depth = deeper(graph, id, depth)?;
    for kind in NAMING {
        if let Some(params) = graph.record(id, kind) {
            let inner = straight(graph, graph.reference(id, params, 1)?, depth)?;
            let turned = kind == "TRIMMED_CURVE" && !graph.truth(id, params, 4)?;
            return Ok(inner.map(|(line, other)| (line, other != turned)));
        }
    }
    Ok(graph.record(id, "LINE").map(|_| (id, false)))
}

/// One level less of those that are left.
pub(super) fn deeper(graph: &Graph, id: u64, depth: usize) -> Result<usize, FileError> {
    let what = || format!("lies in more than {DEEPEST} others: it is made of itself");
    depth.checked_sub(1).ok_or_else(|| graph.fault(id, &what()))
}

fn reversed(profile: Profile) -> Profile {
    match profile {
        // Seen from behind, angles run the other way.
        Profile::Ellipse(mut frame, halves) => {
            for column in 1..3 {
                frame.axes.column_mut(column).neg_mut();
            }
            Profile::Ellipse(frame, halves)
        }
        Profile::Spline(spline) => Profile::Spline(spline.reversed()),
    }
}

/// A length above 0 among the parameters, mm.
pub(super) fn length(
    graph: &Graph,
    units: Units,
    id: u64,
    params: &[Value],
    at: usize,
) -> Result<f64, FileError> {
    let length = graph.number(id, params, at)? * units.length_mm;
    if length > 0.0 && length < 1e9 {
        Ok(length)
    } else {
        Err(graph.fault(id, &format!("has a radius of {length} mm: must be above 0 and below 1e9 mm")))
    }
}

fn ellipse(graph: &Graph, units: Units, id: u64) -> Result<Option<(Frame, [f64; 2])>, FileError> {
    let frame = |params: &[Value]| graph.frame(graph.reference(id, params, 1)?, units.length_mm);
    let size = |params: &[Value], at| length(graph, units, id, params, at);
    if let Some(params) = graph.record(id, "CIRCLE") {
        return Ok(Some((frame(params)?, [size(params, 2)?; 2])));
    }
    let Some(params) = graph.record(id, "ELLIPSE") else { return Ok(None) };
    Ok(Some((frame(params)?, [size(params, 2)?, size(params, 3)?])))
}

/// The arc of a parabola or hyperbola between two corners: a rational spline of degree 2 is all of it.
fn conic_arc(
    graph: &Graph,
    units: Units,
    id: u64,
    ends: [Point3<f64>; 2],
) -> Result<Option<Spline>, FileError> {
    let size = |params: &[Value], at| length(graph, units, id, params, at);
    let frame = |params: &[Value]| graph.frame(graph.reference(id, params, 1)?, units.length_mm);
    let ([from, middle, to], weight, frame) = if let Some(params) = graph.record(id, "PARABOLA") {
        let (frame, focal) = (frame(params)?, size(params, 2)?);
        let [s, t] = ends.map(|end| 0.5 * frame.local(&end).y / focal);
        let at = |s: f64, t: f64| [focal * s * t, focal * (s + t)];
        ([at(s, s), at(s, t), at(t, t)], 1.0, frame)
    } else if let Some(params) = graph.record(id, "HYPERBOLA") {
        let (frame, [a, b]) = (frame(params)?, [size(params, 2)?, size(params, 3)?]);
        let [s, t] = ends.map(|end| {
            let y = frame.local(&end).y / b;
            math::ln((y * y + 1.0).sqrt() + y.abs()).copysign(y)
        });
        let grown = |x: f64| (math::exp(x), math::exp(-x));
        let at = |t: f64, width: f64| {
            let (up, down) = grown(t);
            [a * 0.5 * (up + down) / width, b * 0.5 * (up - down) / width]
        };
        let (up, down) = grown(0.5 * (t - s));
        let width = 0.5 * (up + down);
        ([at(s, 1.0), at(0.5 * (s + t), width), at(t, 1.0)], width, frame)
    } else {
        return Ok(None);
    };
    let poles =
        [from, middle, to].map(|[x, y]| frame.origin + frame.axes.column(0) * x + frame.axes.column(1) * y);
    let knots = Knots { degree: 2, values: vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0] };
    let spline = Spline { knots, poles: poles.to_vec(), weights: vec![1.0, weight, 1.0] };
    if spline.poles.iter().any(|p| p.iter().any(|c| !c.is_finite())) || !weight.is_finite() {
        return Err(graph.fault(id, "leaves the range of numbers between the ends of its edge"));
    }
    Ok(Some(spline))
}

/// A B-spline of one record or of several of one entity, or a polyline.
fn spline(graph: &Graph, units: Units, id: u64) -> Result<Spline, FileError> {
    let scaled = |ids: Vec<u64>| points(graph, units, id, &ids);
    if let Some(params) = graph.record(id, "POLYLINE") {
        let poles = scaled(graph.list(id, params, 1)?)?;
        let mut values: Vec<f64> = (0..poles.len()).map(|k| k as f64).collect();
        values.insert(0, 0.0);
        values.push(poles.len().saturating_sub(1) as f64);
        return valid(
            graph,
            id,
            Spline { weights: vec![1.0; poles.len()], poles, knots: Knots { degree: 1, values } },
        );
    }
    let Some((own, form)) = Form::of(graph, id, &CURVES) else {
        return Err(graph.unread(id, OTHER_EXPORT));
    };
    // As a part of several records it has no name and no control points of its own.
    let (base, from, knots) = match graph.record(id, "B_SPLINE_CURVE") {
        Some(base) => (base, 0, 0),
        None => (own, 1, 6),
    };
    let poles = scaled(graph.list(id, base, from + 1)?)?;
    let degree = graph.number(id, base, from)?;
    let knots = match form {
        Form::Stated => stated_knots(graph, id, degree, [own, own], [knots, knots + 1], poles.len())?,
        form => form.knots(graph, id, degree, poles.len())?,
    };
    let weights = match graph.record(id, "RATIONAL_B_SPLINE_CURVE") {
        Some(params) => graph.numbers(id, params, 0)?,
        None => vec![1.0; poles.len()],
    };
    valid(graph, id, Spline { knots, poles, weights })
}

fn valid(graph: &Graph, id: u64, spline: Spline) -> Result<Spline, FileError> {
    match spline.fault() {
        None => Ok(spline),
        Some(fault) => Err(graph.fault(id, &fault)),
    }
}

/// Control points by their numbers, mm.
pub(super) fn points(
    graph: &Graph,
    units: Units,
    id: u64,
    ids: &[u64],
) -> Result<Vec<Point3<f64>>, FileError> {
    if ids.len() > MOST_POLES {
        return Err(graph.fault(id, &format!("has {} control points, at most {MOST_POLES}", ids.len())));
    }
    ids.iter().map(|p| graph.point(*p).map(|point| point * units.length_mm)).collect()
}

/// Where the knots of a B-spline come from.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Form {
    /// They stand in the file.
    Stated,
    /// Each once, but those at the ends.
    QuasiUniform,
    /// Each of them counts once.
    Uniform,
    /// As often as the degree: pieces of Bézier.
    Bezier,
}

/// Types of curves, with the form of their knots.
const CURVES: [(&str, Form); 4] = [
    ("B_SPLINE_CURVE_WITH_KNOTS", Form::Stated),
    ("QUASI_UNIFORM_CURVE", Form::QuasiUniform),
    ("UNIFORM_CURVE", Form::Uniform),
    ("BEZIER_CURVE", Form::Bezier),
];

impl Form {
    /// The parameters of an entity under the first of some types that it has.
    pub fn of<'a>(graph: &'a Graph, id: u64, types: &[(&str, Self)]) -> Option<(&'a [Value], Self)> {
        types.iter().find_map(|(name, form)| graph.record(id, name).map(|params| (params, *form)))
    }

    /// The knots that a form implies.
    pub fn knots(self, graph: &Graph, id: u64, degree: f64, count: usize) -> Result<Knots, FileError> {
        let degree = whole(graph, id, degree)?;
        let last = count + degree + 1;
        let value = |k: usize| match self {
            Self::Uniform | Self::Stated => k as f64,
            Self::QuasiUniform => (k.clamp(degree, count.max(degree)) - degree) as f64,
            Self::Bezier => (k.saturating_sub(1) / degree).min(count.saturating_sub(1) / degree) as f64,
        };
        if self == Self::Bezier && count % degree != 1 % degree {
            return Err(
                graph.fault(id, &format!("{count} control points are no whole pieces of degree {degree}"))
            );
        }
        Ok(Knots { degree, values: (0..last).map(value).collect() })
    }
}

/// A degree as a whole number.
fn whole(graph: &Graph, id: u64, degree: f64) -> Result<usize, FileError> {
    if (1.0..=25.0).contains(&degree) && degree.fract() == 0.0 {
        Ok(degree as usize)
    } else {
        Err(graph.fault(id, &format!("has degree {degree}, must be a whole number of 1 … 25")))
    }
}

/// Knots that stand in the file: how often each counts, and its value.
pub(super) fn stated_knots(
    graph: &Graph,
    id: u64,
    degree: f64,
    params: [&[Value]; 2],
    places: [usize; 2],
    count: usize,
) -> Result<Knots, FileError> {
    let degree = whole(graph, id, degree)?;
    let times = graph.numbers(id, params[0], places[0])?;
    let values = graph.numbers(id, params[1], places[1])?;
    if times.len() != values.len() {
        let what = format!("{} multiplicities for {} knots", times.len(), values.len());
        return Err(graph.fault(id, &what));
    }
    if let Some(wrong) = times.iter().find(|t| !(**t >= 1.0 && t.fract() == 0.0 && **t <= 26.0)) {
        return Err(
            graph.fault(id, &format!("a knot counts {wrong} times, must be a whole number of 1 … 26"))
        );
    }
    let sum: f64 = times.iter().sum();
    if sum != (count + degree + 1) as f64 {
        let what = format!(
            "its knots count {sum} times in all, {count} control points of degree {degree} need {}",
            count + degree + 1
        );
        return Err(graph.fault(id, &what));
    }
    let repeated = times.iter().zip(&values).flat_map(|(t, k)| std::iter::repeat_n(*k, *t as usize));
    Ok(Knots { degree, values: repeated.collect() })
}

/// The references of a list of lists, row after row, and the length of a row.
pub(super) fn rows(
    graph: &Graph,
    id: u64,
    value: Option<&Value>,
) -> Result<(Vec<u64>, [usize; 2]), FileError> {
    let Some(Value::List(items)) = value else { return Err(graph.fault(id, "has no control points")) };
    let row = |value: &Value| if let Value::List(row) = value { references(row) } else { Vec::new() };
    let all: Vec<Vec<u64>> = items.iter().map(row).collect();
    let columns = all.first().map_or(0, Vec::len);
    if let Some(other) = all.iter().find(|row| row.len() != columns) {
        let what = format!("a row has {} control points, the first one {columns}", other.len());
        return Err(graph.fault(id, &what));
    }
    Ok((all.concat(), [items.len(), columns]))
}
