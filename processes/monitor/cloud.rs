//! The cloud as the page loads it: few bytes per point, in an order whose every beginning shows the whole part.
//!
//! Little-endian: `FCC1`, number of points n, points of the whole cloud, a zero (u32 each); the middle of the cloud, mm (3 × f64); then
//! planes of n: x, y, z from the middle, mm (3 × f32), deviation, mm (f32, NaN without), sigma, mm (f32), normal times 127 and pair
//! (3 × i8, u8).

use crate::feed::{Ended, Scan};
use axum::body::Bytes;
use cell::Cell;
use fringe::cloud::Point;
use metrology::inspection;

/// Bytes before the planes.
const HEAD: usize = 40;

/// Bytes of one point.
const PER_POINT: usize = 24;

/// Packs the cloud of a scan; `ended`: the cycle that it belongs to.
pub fn packed(cell: &Cell, ended: Option<&Ended>, scan: &Scan) -> Bytes {
    let points = &scan.points;
    let deviations = deviations(cell, ended, points);
    let order: Vec<usize> = spread(points.len()).collect();
    let middle = middle(points);
    let mut bytes = Vec::with_capacity(HEAD + PER_POINT * points.len());
    bytes.extend(b"FCC1");
    for number in [points.len(), scan.header.all_points, 0] {
        bytes.extend((number as u32).to_le_bytes());
    }
    bytes.extend(middle.iter().flat_map(|value| value.to_le_bytes()));
    for &n in &order {
        for (value, middle) in points[n].position_mm.iter().zip(middle) {
            bytes.extend(((value - middle) as f32).to_le_bytes());
        }
    }
    bytes.extend(order.iter().flat_map(|&n| deviations[n].to_le_bytes()));
    bytes.extend(order.iter().flat_map(|&n| points[n].sigma_mm.to_le_bytes()));
    for &n in &order {
        bytes.extend(points[n].normal.map(|value| (127.0 * value) as i8 as u8));
        bytes.push(points[n].pair as u8);
    }
    bytes.into()
}

/// Distance of each point from its fitted element, mm; NaN where it belongs to none.
fn deviations(cell: &Cell, ended: Option<&Ended>, points: &[Point]) -> Vec<f32> {
    let mut all = vec![f32::NAN; points.len()];
    let Some(result) = ended.map(|ended| &ended.result) else { return all };
    let recipe = cell.config.recipes.iter().find(|recipe| Some(&recipe.name) == result.recipe.as_ref());
    if let (Some(plan), Some(alignment)) = (recipe.and_then(|recipe| recipe.plan.as_ref()), &result.alignment)
    {
        for (index, deviation) in inspection::deviations(plan, alignment, &result.elements, points) {
            all[index as usize] = deviation;
        }
    }
    all
}

/// Middle of the box around the points, mm.
fn middle(points: &[Point]) -> [f64; 3] {
    std::array::from_fn(|axis| {
        let values = points.iter().map(|point| point.position_mm[axis]);
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if low <= high { 0.5 * (low + high) } else { 0.0 }
    })
}

/// All of 0 … n − 1, each beginning of which is spread evenly: steps of about n over the golden ratio, which share no divisor with n.
fn spread(n: usize) -> impl Iterator<Item = usize> {
    let golden = (n as f64 * 0.618_033_988_749_895) as usize;
    let step = (golden..=n).find(|&step| step > 0 && gcd(step, n) == 1).unwrap_or(1);
    (0..n).map(move |index| (index as u64 * step as u64 % n as u64) as usize)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_holds_every_point_once_and_its_beginnings_are_even() {
        for n in (0..200).chain([10_007, 65_536, 100_000]) {
            let order: Vec<usize> = spread(n).collect();
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..n).collect::<Vec<_>>(), "{n}");
        }
        let n = 100_000;
        for count in [100, 1000, 30_000] {
            let mut first: Vec<usize> = spread(n).take(count).collect();
            first.sort_unstable();
            let widest = first.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
            assert!(widest <= 4 * n / count, "{count}: a gap of {widest}");
        }
    }
}
