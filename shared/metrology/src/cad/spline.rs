//! B-splines, rational or not: curves and surfaces by their basis functions.

use nalgebra::{Point3, Vector3};

/// Largest degree that is read.
pub const MOST_DEGREE: usize = 25;

/// Degree and knots of one direction, each knot as often as it counts.
#[derive(Debug, Clone, PartialEq)]
pub struct Knots {
    /// Degree of the pieces.
    pub degree: usize,
    /// Knots that never fall.
    pub values: Vec<f64>,
}

/// The basis functions that are not zero at a parameter.
struct Basis {
    /// Index of the first control point that counts.
    first: usize,
    values: [f64; MOST_DEGREE + 1],
    slopes: [f64; MOST_DEGREE + 1],
}

impl Knots {
    /// What is wrong with them for so many control points: value and limit.
    pub fn fault(&self, count: usize) -> Option<String> {
        let degree = self.degree;
        if !(1..=MOST_DEGREE).contains(&degree) {
            return Some(format!("degree {degree} is not within 1 … {MOST_DEGREE}"));
        }
        if count <= degree {
            return Some(format!(
                "degree {degree} needs {} control points or more, it has {count}",
                degree + 1
            ));
        }
        if self.values.len() != count + degree + 1 {
            return Some(format!(
                "{} knots (each as often as it counts), but {count} control points of degree {degree} need {}",
                self.values.len(),
                count + degree + 1
            ));
        }
        let falls = |before: f64, after: f64| before.is_nan() || after.is_nan() || before > after;
        let mut pairs = self.values.iter().zip(self.values.iter().skip(1));
        if let Some((before, after)) = pairs.find(|(before, after)| falls(**before, **after)) {
            return Some(format!("knot {after} stands after knot {before}: knots must not fall"));
        }
        let [from, to] = self.domain();
        if !(to - from).is_finite() || to - from <= 1e-12 * from.abs().max(to.abs()) {
            return Some(format!("its parameters go from {from} to {to}: nothing is between"));
        }
        let most = |knot: f64| if knot > from && knot < to { degree } else { degree + 1 };
        let broken = self.values.chunk_by(|a, b| a == b).find(|equal| equal.len() > most(equal[0]))?;
        let (knot, times) = (broken[0], broken.len());
        Some(format!("knot {knot} counts {times} times, at most {} for degree {degree}", most(knot)))
    }

    /// First and last parameter.
    pub fn domain(&self) -> [f64; 2] {
        let count = self.values.len() - self.degree - 1;
        [self.values[self.degree], self.values[count]]
    }

    /// Parameters at which pieces begin and end, rising.
    pub fn breaks(&self) -> Vec<f64> {
        let [from, to] = self.domain();
        let mut breaks: Vec<f64> =
            self.values.iter().copied().filter(|knot| (from..=to).contains(knot)).collect();
        breaks.dedup();
        breaks
    }

    fn basis(&self, t: f64) -> Basis {
        let (degree, knots) = (self.degree, &self.values);
        let last = knots.len() - degree - 2;
        let [from, to] = self.domain();
        let t = t.clamp(from, to);
        let mut span = knots.partition_point(|knot| *knot <= t).saturating_sub(1).clamp(degree, last);
        while span > degree && knots[span] >= knots[span + 1] {
            span -= 1;
        }
        let mut basis =
            Basis { first: span - degree, values: [0.0; MOST_DEGREE + 1], slopes: [0.0; MOST_DEGREE + 1] };
        basis.values[0] = 1.0;
        for level in 1..=degree {
            // Slopes follow from the functions of one degree less.
            if level == degree {
                let mut before = 0.0;
                for j in 0..degree {
                    let width = knots[span + 1 + j] - knots[span + 1 + j - degree];
                    let share = if width > 0.0 { degree as f64 * basis.values[j] / width } else { 0.0 };
                    basis.slopes[j] = before - share;
                    before = share;
                }
                basis.slopes[degree] = before;
            }
            let mut saved = 0.0;
            for j in 0..level {
                let (high, low) = (knots[span + 1 + j], knots[span + 1 + j - level]);
                let share = if high > low { basis.values[j] / (high - low) } else { 0.0 };
                basis.values[j] = saved + (high - t) * share;
                saved = (t - low) * share;
            }
            basis.values[level] = saved;
        }
        basis
    }
}

/// What is wrong with the weights of so many control points.
fn fault_of_weights(weights: &[f64], count: usize) -> Option<String> {
    if weights.len() != count {
        return Some(format!("{} weights for {count} control points", weights.len()));
    }
    let (index, weight) = weights.iter().enumerate().find(|(_, w)| !(w.is_finite() && **w > 0.0))?;
    Some(format!("weight {} is {weight}, must be above 0", index + 1))
}

/// A B-spline curve, which may be rational.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    /// Degree and knots of the curve.
    pub knots: Knots,
    /// Control points of the curve, mm.
    pub poles: Vec<Point3<f64>>,
    /// Weights of the control points.
    pub weights: Vec<f64>,
}

impl Spline {
    /// What is wrong with its numbers: value and limit.
    pub fn fault(&self) -> Option<String> {
        let count = self.poles.len();
        self.knots.fault(count).or_else(|| fault_of_weights(&self.weights, count))
    }

    /// The point of a parameter.
    pub fn at(&self, t: f64) -> Point3<f64> {
        self.with_tangent(t).0
    }

    /// The point of a parameter, and how it moves with the parameter.
    pub fn with_tangent(&self, t: f64) -> (Point3<f64>, Vector3<f64>) {
        let basis = self.knots.basis(t);
        let (mut sum, mut slope) = ([Vector3::zeros(); 2], [0.0; 2]);
        for j in 0..=self.knots.degree {
            let weight = self.weights[basis.first + j];
            let pole = self.poles[basis.first + j].coords;
            for (k, factor) in [basis.values[j] * weight, basis.slopes[j] * weight].into_iter().enumerate() {
                sum[k] += pole * factor;
                slope[k] += factor;
            }
        }
        let point = sum[0] / slope[0];
        (Point3::from(point), (sum[1] - point * slope[1]) / slope[0])
    }

    /// The same line from its end to its start.
    #[must_use]
    pub fn reversed(mut self) -> Self {
        self.poles.reverse();
        self.weights.reverse();
        self.knots.values.reverse();
        for knot in &mut self.knots.values {
            *knot = -*knot;
        }
        self
    }
}

/// A B-spline surface, which may be rational.
#[derive(Debug, Clone, PartialEq)]
pub struct SplineSurface {
    /// Degrees and knots of both directions.
    pub knots: [Knots; 2],
    /// Control points, mm: those of the second direction follow each other.
    pub poles: Vec<Point3<f64>>,
    /// Weights of the control points.
    pub weights: Vec<f64>,
}

impl SplineSurface {
    /// What is wrong with its numbers, for so many control points in both directions: value and limit.
    pub fn fault(&self, counts: [usize; 2]) -> Option<String> {
        let own = self.knots.iter().zip(counts).zip(["first", "second"]);
        let faults = own.map(|((knots, count), name)| {
            knots.fault(count).map(|fault| format!("its {name} direction: {fault}"))
        });
        faults.flatten().next().or_else(|| fault_of_weights(&self.weights, self.poles.len()))
    }

    /// The point of two parameters, and how it moves with each of them.
    pub fn with_tangents(&self, [u, v]: [f64; 2]) -> (Point3<f64>, [Vector3<f64>; 2]) {
        let [first, second] = [self.knots[0].basis(u), self.knots[1].basis(v)];
        let count = self.knots[1].values.len() - self.knots[1].degree - 1;
        let (mut sums, mut weights) = ([Vector3::zeros(); 3], [0.0; 3]);
        for i in 0..=self.knots[0].degree {
            let row = (first.first + i) * count + second.first;
            for j in 0..=self.knots[1].degree {
                let (weight, pole) = (self.weights[row + j], self.poles[row + j].coords);
                let factors = [
                    first.values[i] * second.values[j],
                    first.slopes[i] * second.values[j],
                    first.values[i] * second.slopes[j],
                ];
                for (k, factor) in factors.into_iter().enumerate() {
                    sums[k] += pole * (factor * weight);
                    weights[k] += factor * weight;
                }
            }
        }
        let point = sums[0] / weights[0];
        let along = |k: usize| (sums[k] - point * weights[k]) / weights[0];
        (Point3::from(point), [along(1), along(2)])
    }
}
