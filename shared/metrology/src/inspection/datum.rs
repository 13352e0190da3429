//! Datum systems (ISO 5459): ordered datums fix the part's frame one after another.
//!
//! A datum gives equations between its nominal element, moved with the frame, and the measured one: a plane one distance
//! and two tilts, an axis two shifts and two tilts, a centre three shifts, a circle the two within its plane, a slot its
//! turn besides, a surface point one distance. Each step solves its equations by least squares in what the steps before
//! left open, and leaves to the later ones what it does not fix. One element a step is the ordered system |A|B|C|;
//! several elements in one step are a common datum or a best fit; surface points alone are the 3-2-1 of RPS.

use nalgebra::Vector3;

use super::substitute::{Shape, Substitute, turned};
use fringe::geometry::pose::Pose;
use fringe::math;

/// Rounds of Gauss–Newton; from the nominal pose four to six are enough.
const ROUNDS: usize = 40;

/// A motion that moves a datum by less than this part of itself is not fixed by it.
const SMALLEST_EFFECT: f64 = 1e-3;

/// A step below this, mm, is rounding.
const STILL_MM: f64 = 1e-12;

/// A small motion: shift of the centre, and turn times the extent, both mm.
pub type Motion = [f64; 6];

/// What the datums fix.
#[derive(Debug, Clone)]
pub struct Frame {
    /// From the part frame of the plan to the datums as measured.
    pub pose: Pose,
    /// Motions that no datum fixes.
    pub open: Vec<Motion>,
    /// Point about which the motions turn, mm, and the length that makes their turns millimetres.
    pub center: Vector3<f64>,
    /// Extent of the datums, mm: a turn counts as far as it moves a point at this distance.
    pub extent_mm: f64,
}

impl Frame {
    /// The pose of a small motion.
    pub fn motion(&self, motion: &Motion) -> Pose {
        moved(motion, &self.center, self.extent_mm)
    }

    /// The open motions in words.
    pub fn open_words(&self) -> String {
        let word = |m: &Motion| {
            let [x, y, z, a, b, c] = *m;
            let (shift, turn) = (Vector3::new(x, y, z), Vector3::new(a, b, c));
            let [u, v, w]: [f64; 3] =
                if turn.norm() > shift.norm() { turn / turn.norm() } else { shift / shift.norm() }.into();
            let what = if turn.norm() > shift.norm() { "turn about" } else { "shift along" };
            format!("{what} ({u:.2}, {v:.2}, {w:.2})")
        };
        self.open.iter().map(word).collect::<Vec<_>>().join(", ")
    }
}

fn moved(motion: &Motion, center: &Vector3<f64>, extent_mm: f64) -> Pose {
    let turn = Vector3::new(motion[3], motion[4], motion[5]) / extent_mm;
    let columns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| turned(&axis, &turn));
    let rotation = nalgebra::Matrix3::from_columns(&columns);
    let shift = Vector3::new(motion[0], motion[1], motion[2]);
    Pose { rotation, translation: center + shift - rotation * center }
}

/// A substitute in another frame.
pub fn carried(element: &Substitute, pose: &Pose) -> Substitute {
    Substitute {
        point: pose.point(&element.point),
        direction: pose.rotation * element.direction,
        across: pose.rotation * element.across,
        ..*element
    }
}

/// What lies between a nominal element, moved with the frame, and the measured one, mm.
fn gaps(nominal: &Substitute, measured: &Substitute, extent_mm: f64, out: &mut Vec<f64>) {
    let between = measured.point - nominal.point;
    // Those of the measured element, which stands still while the frame moves.
    let [e1, e2] = if measured.direction == Vector3::zeros() {
        [Vector3::x(), Vector3::y()]
    } else {
        crate::fit::tangents(&measured.direction)
    };
    let tilt = |e: &Vector3<f64>| extent_mm * nominal.direction.dot(e);
    match nominal.shape {
        Shape::Point | Shape::Sphere => out.extend(between.iter()),
        Shape::Surface => {}
        Shape::SurfacePoint => out.push(between.dot(&nominal.direction)),
        Shape::Plane => {
            // At the measured place: it lies elsewhere in the plane than the nominal one.
            out.extend([between.dot(&nominal.direction), tilt(&e1), tilt(&e2)]);
        }
        Shape::Circle => out.extend([between.dot(&e1), between.dot(&e2)]),
        Shape::Oblong => {
            let normal = nominal.direction;
            let width = normal.cross(&nominal.across);
            out.extend([
                between.dot(&nominal.across),
                between.dot(&width),
                extent_mm * measured.across.dot(&width),
            ]);
        }
        Shape::Line | Shape::Cylinder | Shape::Cone => {
            out.extend([between.dot(&e1), between.dot(&e2), tilt(&e1), tilt(&e2)]);
            if nominal.shape == Shape::Cone {
                // A cone also holds along its axis, by where it has its nominal diameter.
                let slope = math::tan(measured.sizes[1]);
                let place = (nominal.sizes[0] - measured.sizes[0]) / (2.0 * slope);
                out.push(between.dot(&nominal.direction) + place);
            }
        }
        Shape::Torus => {
            out.extend(between.iter());
            out.extend([tilt(&e1), tilt(&e2)]);
        }
    }
}

/// Fixes the frame. `nominal` and `measured` are the elements of each step, in the same order.
///
/// # Errors
/// States that the steps do not come to rest.
pub fn fix(nominal: &[Vec<Substitute>], measured: &[Vec<Substitute>]) -> Result<Frame, String> {
    let all = || nominal.iter().flatten();
    let count = all().count().max(1) as f64;
    let center = all().map(|s| s.point).sum::<Vector3<f64>>() / count;
    let reach =
        |s: &Substitute| (s.point - center).norm() + s.half_mm[0].max(s.half_mm[1]).max(0.5 * s.sizes[0]);
    let extent_mm = all().map(reach).fold(1.0, f64::max);
    let mut pose = Pose { rotation: nalgebra::Matrix3::identity(), translation: Vector3::zeros() };
    for _ in 0..ROUNDS {
        let here = pose.point(&center);
        let at = |motion: &Motion| -> Vec<Vec<f64>> {
            let there = moved(motion, &here, extent_mm).after(&pose);
            let step = |(n, m): (&Vec<Substitute>, &Vec<Substitute>)| {
                let mut rows = Vec::new();
                for (nominal, measured) in n.iter().zip(m) {
                    gaps(&carried(nominal, &there), measured, extent_mm, &mut rows);
                }
                rows
            };
            nominal.iter().zip(measured).map(step).collect()
        };
        let (step, open) = ordered_step(&at);
        pose = moved(&step, &here, extent_mm).after(&pose);
        if step.iter().all(|s| s.abs() <= STILL_MM * extent_mm.max(1.0)) {
            return Ok(Frame { pose, open, center: here, extent_mm });
        }
    }
    Err("the datums do not come to rest: their measured places contradict the nominal ones".into())
}

/// One Gauss–Newton step over all datum steps in their order, and the motions that stay open.
fn ordered_step(at: &dyn Fn(&Motion) -> Vec<Vec<f64>>) -> (Motion, Vec<Motion>) {
    const H: f64 = 1e-4;
    let unit = |k: usize, h: f64| -> Motion { std::array::from_fn(|i| if i == k { h } else { 0.0 }) };
    let here = at(&[0.0; 6]);
    let ahead: Vec<Vec<Vec<f64>>> = (0..6).map(|k| at(&unit(k, H))).collect();
    let behind: Vec<Vec<Vec<f64>>> = (0..6).map(|k| at(&unit(k, -H))).collect();
    let mut free: Vec<Motion> = (0..6).map(|k| unit(k, 1.0)).collect();
    let mut step = [0.0; 6];
    for (index, rows) in here.iter().enumerate() {
        let slope = |row: usize| -> Motion {
            std::array::from_fn(|k| (ahead[k][index][row] - behind[k][index][row]) / (2.0 * H))
        };
        // What is left of each row after the steps before, and its effect on what is still free.
        let slopes: Vec<Motion> = (0..rows.len()).map(slope).collect();
        let rest: Vec<f64> = rows.iter().zip(&slopes).map(|(r, s)| r + dot(s, &step)).collect();
        let effects: Vec<Vec<f64>> =
            slopes.iter().map(|s| free.iter().map(|f| dot(s, f)).collect()).collect();
        let basis = row_space(&effects, free.len());
        if basis.is_empty() {
            continue;
        }
        let by: Vec<Vec<f64>> = effects.iter().map(|e| basis.iter().map(|b| inner(e, b)).collect()).collect();
        if let Some(weights) = least_squares(&by, &rest, basis.len()) {
            for (weight, direction) in weights.iter().zip(&basis) {
                for (part, motion) in direction.iter().zip(&free) {
                    step.iter_mut().zip(motion).for_each(|(s, m)| *s += weight * part * m);
                }
            }
        }
        free = complement(&basis, free.len())
            .iter()
            .map(|parts| {
                let mut motion = [0.0; 6];
                for (part, direction) in parts.iter().zip(&free) {
                    motion.iter_mut().zip(direction).for_each(|(m, d)| *m += part * d);
                }
                motion
            })
            .collect();
    }
    (step, free)
}

fn dot(a: &Motion, b: &Motion) -> f64 {
    inner(a, b)
}

fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Takes the parts along orthonormal vectors off a vector, twice, against rounding.
fn reduced(vector: &[f64], basis: &[Vec<f64>]) -> Vec<f64> {
    let mut rest = vector.to_vec();
    for _ in 0..2 {
        for unit in basis {
            let along = inner(&rest, unit);
            rest.iter_mut().zip(unit).for_each(|(r, u)| *r -= along * u);
        }
    }
    rest
}

/// Orthonormal vectors that span the rows, largest first, without those of hardly any effect.
fn row_space(rows: &[Vec<f64>], most: usize) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    while basis.len() < most {
        let rests = rows.iter().map(|row| reduced(row, &basis));
        let Some(best) = rests.reduce(|a, b| if inner(&b, &b) > inner(&a, &a) { b } else { a }) else {
            break;
        };
        let length = inner(&best, &best).sqrt();
        if length <= SMALLEST_EFFECT {
            break;
        }
        basis.push(best.iter().map(|v| v / length).collect());
    }
    basis
}

/// Orthonormal vectors that complete a basis.
fn complement(basis: &[Vec<f64>], size: usize) -> Vec<Vec<f64>> {
    let mut all = basis.to_vec();
    let mut found = Vec::new();
    while all.len() < size {
        let units = (0..size).map(|k| (0..size).map(|i| f64::from(u8::from(i == k))).collect::<Vec<f64>>());
        let rests = units.map(|unit| reduced(&unit, &all));
        let Some(best) = rests.reduce(|a, b| if inner(&b, &b) > inner(&a, &a) + 1e-9 { b } else { a }) else {
            break;
        };
        let length = inner(&best, &best).sqrt();
        let unit: Vec<f64> = best.iter().map(|v| v / length).collect();
        all.push(unit.clone());
        found.push(unit);
    }
    found
}

/// Weights w that make |A w + r| least.
fn least_squares(rows: &[Vec<f64>], rest: &[f64], count: usize) -> Option<Vec<f64>> {
    let column = |i: usize| rows.iter().map(move |row| row[i]);
    let matrix = (0..count)
        .map(|i| (0..count).map(|j| column(i).zip(column(j)).map(|(a, b)| a * b).sum()).collect())
        .collect();
    let right = (0..count).map(|i| -column(i).zip(rest).map(|(a, r)| a * r).sum::<f64>()).collect();
    crate::fit::solve_square(matrix, right)
}
