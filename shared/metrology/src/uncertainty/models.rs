//! Measurement models of the thesis, for any [`Number`]: values for the Monte Carlo method, derivatives for the budget.
//!
//! Each is a function of the same name in the models of budget files.

use super::function::Function;
use super::number::Number;

/// Temperature at which lengths are stated, °C (ISO 1).
pub const REFERENCE_TEMPERATURE_DEG_C: f64 = 20.0;

fn difference<T: Number>(from: [T; 3], to: [T; 3]) -> [T; 3] {
    let ([a, b, c], [x, y, z]) = (from, to);
    [x - a, y - b, z - c]
}

fn dot<T: Number>([a, b, c]: [T; 3], [x, y, z]: [T; 3]) -> T {
    a * x + b * y + c * z
}

fn norm<T: Number>(vector: [T; 3]) -> T {
    dot(vector, vector).apply(Function::Sqrt)
}

/// Distance of two points, such as the centres of two spheres; in their unit.
pub fn distance<T: Number>(from: [T; 3], to: [T; 3]) -> T {
    norm(difference(from, to))
}

/// Cosine of the angle between the line from one point to another and the x axis (eq. 4.3); its derivatives are the
/// sensitivities of eq. 4.6. Equations 4.4 and 4.5 follow by exchanging coordinates.
pub fn direction_cosine<T: Number>(from: [T; 3], to: [T; 3]) -> T {
    let along = difference(from, to);
    along[0] / norm(along)
}

/// Angle between two planes by their normals of any length, rad, 0 … π.
///
/// By atan2(|n × m|, n · m), which keeps its digits at all angles; the thesis' arc cosine loses half of them near 0 and
/// π. There the angle has no derivative.
pub fn plane_angle<T: Number>(first: [T; 3], second: [T; 3]) -> T {
    let ([a, b, c], [x, y, z]) = (first, second);
    let cross = [b * z - c * y, c * x - a * z, a * y - b * x];
    norm(cross).atan2(dot(first, second))
}

/// Length at 20 °C of a part whose length was taken at `temperature` (°C): L / (1 + α (t − 20 °C)), α in 1/K.
///
/// The exact form of eq. 4.7, ΔL = α L ΔT; it corrects the known offset, which the thesis only counts as uncertainty.
pub fn length_at_20<T: Number>(length: T, expansion: T, temperature: T) -> T {
    length / (T::constant(1.0) + expansion * (temperature - T::constant(REFERENCE_TEMPERATURE_DEG_C)))
}

/// Change of a length with temperature, ΔL = α L ΔT (eq. 4.7).
pub fn thermal_expansion<T: Number>(length: T, expansion: T, temperature_difference: T) -> T {
    expansion * length * temperature_difference
}
