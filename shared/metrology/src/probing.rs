//! Where a coordinate measuring machine probes an element (thesis section 4.3.2, after BS 7172): evenly spread points
//! that do not beat with the waves of the form.

use nalgebra::{Point3, Unit, Vector3};

use crate::fit::tangents;
use fringe::math;
use fringe::math::random::Key;

/// A place to probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Probe {
    /// Nominal point on the surface, mm.
    pub point_mm: Point3<f64>,
    /// Unit normal out of the material; the probe comes along it.
    pub normal: Vector3<f64>,
}

/// Points on a sphere between two polar angles about an axis, `cos_polar` their cosines, largest angle first: Hammersley
/// points, even in z (which is even in area) and in the reversed bits of their number.
pub fn sphere(
    center_mm: &Point3<f64>,
    radius_mm: f64,
    axis: &Unit<Vector3<f64>>,
    cos_polar: [f64; 2],
    count: usize,
) -> Vec<Probe> {
    let [e1, e2] = tangents(axis);
    (0..count)
        .map(|index| {
            let share = (index as f64 + 0.5) / count as f64;
            let z = cos_polar[1] + (cos_polar[0] - cos_polar[1]) * share;
            let across = (1.0 - z * z).max(0.0).sqrt();
            let (sin, cos) = math::sincos(std::f64::consts::TAU * radical_inverse(index as u32));
            let normal = axis.into_inner() * z + (e1 * cos + e2 * sin) * across;
            Probe { point_mm: center_mm + normal * radius_mm, normal }
        })
        .collect()
}

/// The bits of a number behind the binary point, in reverse (van der Corput 1935).
fn radical_inverse(index: u32) -> f64 {
    f64::from(index.reverse_bits()) / 4_294_967_296.0
}

/// A rectangle in a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    /// Centre of the rectangle, mm.
    pub center_mm: Point3<f64>,
    /// Unit normal out of the material.
    pub normal: Vector3<f64>,
    /// Unit directions of its edges.
    pub edges: [Vector3<f64>; 2],
    /// Half the edge lengths, mm.
    pub half_size_mm: [f64; 2],
}

/// At least `count` points on a rectangle: a grid of cells as square as possible, one point at random in each, which
/// keeps the spread even and the waves of milling apart from the grid. `taken` states which places (along the edges from
/// the middle, mm) may be probed; the grid becomes finer until enough of its points fall on such places.
///
/// Returns fewer points only when `taken` refuses nearly everything.
pub fn plane(rectangle: &Rectangle, count: usize, seed: u64, taken: &dyn Fn([f64; 2]) -> bool) -> Vec<Probe> {
    let mut asked = count.max(1);
    loop {
        let probes = grid(rectangle, asked, seed, taken);
        if probes.len() >= count || asked >= 64 * count.max(1) {
            return probes;
        }
        asked += asked.div_ceil(8);
    }
}

fn grid(rectangle: &Rectangle, count: usize, seed: u64, taken: &dyn Fn([f64; 2]) -> bool) -> Vec<Probe> {
    let [half_x, half_y] = rectangle.half_size_mm;
    let columns = ((count as f64 * half_x / half_y).sqrt().round() as usize).clamp(1, count);
    let rows = count.div_ceil(columns);
    let key = Key::new(seed);
    let mut probes = Vec::with_capacity(rows * columns);
    for row in 0..rows {
        for column in 0..columns {
            let number = 2 * (row * columns + column) as u64;
            let place = |cell: usize, cells: usize, half: f64, draw: u64| {
                half * (2.0 * (cell as f64 + key.open(draw)) / cells as f64 - 1.0)
            };
            let across = [place(column, columns, half_x, number), place(row, rows, half_y, number + 1)];
            if taken(across) {
                let [a, b] = rectangle.edges;
                let point_mm = rectangle.center_mm + a * across[0] + b * across[1];
                probes.push(Probe { point_mm, normal: rectangle.normal });
            }
        }
    }
    probes
}

/// Circles and points on each of them for about `count` points on a cylinder, spaced alike along and around it:
/// √(N h / 2πr) circles (eq. 4.13) of N over that many points (eq. 4.14), at least 2 circles of 3.
///
/// The thesis calls the first number points in a plane and the second planes; the spacing is alike only the other way
/// round, as here and in BS 7172.
pub fn cylinder_circles(radius_mm: f64, height_mm: f64, count: usize) -> [usize; 2] {
    let wanted = (count as f64 * height_mm / (std::f64::consts::TAU * radius_mm)).sqrt();
    let circles = (wanted.round() as usize).clamp(2, count.max(2));
    [circles, count.div_ceil(circles).max(3)]
}

/// Points on a cylinder about `center_mm`, circles turned against each other by half a spacing.
pub fn cylinder(
    center_mm: &Point3<f64>,
    axis: &Unit<Vector3<f64>>,
    radius_mm: f64,
    height_mm: f64,
    count: usize,
) -> Vec<Probe> {
    let [circles, each] = cylinder_circles(radius_mm, height_mm, count);
    let [e1, e2] = tangents(axis);
    let mut probes = Vec::with_capacity(circles * each);
    for circle in 0..circles {
        let along = height_mm * ((circle as f64 + 0.5) / circles as f64 - 0.5);
        for place in 0..each {
            let turn = (place as f64 + 0.5 * (circle % 2) as f64) / each as f64;
            let (sin, cos) = math::sincos(std::f64::consts::TAU * turn);
            let normal = e1 * cos + e2 * sin;
            probes
                .push(Probe { point_mm: center_mm + axis.into_inner() * along + normal * radius_mm, normal });
        }
    }
    probes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::{self, FitSettings};

    fn tilted() -> Unit<Vector3<f64>> {
        Unit::new_unchecked(Vector3::new(0.6, 0.0, 0.8))
    }

    fn points(probes: &[Probe]) -> Vec<Point3<f64>> {
        probes.iter().map(|probe| probe.point_mm).collect()
    }

    /// Share of the points in each of 8 caps and sectors against its share of the area: Hammersley points are off by
    /// about ln N / N, random ones by 1/√N.
    #[test]
    fn sphere_points_lie_on_the_cap_and_fill_it_evenly() {
        let (center, axis) = (Point3::new(1.0, 2.0, 300.0), tilted());
        let probes = sphere(&center, 11.0, &axis, [-0.3, 1.0], 256);
        let [e1, e2] = tangents(&axis);
        for probe in &probes {
            let z = probe.normal.dot(&axis);
            assert!((-0.3..=1.0).contains(&z));
            assert!((probe.point_mm - center - probe.normal * 11.0).norm() < 1e-12);
        }
        for eighth in 0..8 {
            let limit = 1.0 - 1.3 * f64::from(eighth) / 8.0;
            let above = probes.iter().filter(|p| p.normal.dot(&axis) > limit).count();
            assert!((above as f64 / 256.0 - f64::from(eighth) / 8.0).abs() < 0.01);
            let turn = f64::from(eighth) * std::f64::consts::FRAC_PI_4;
            let direction = e1 * math::cos(turn) + e2 * math::sin(turn);
            let half = probes.iter().filter(|p| p.normal.dot(&direction) > 0.0).count();
            assert!((half as f64 / 256.0 - 0.5).abs() < 0.03, "{half} of 256");
        }
        let fit = fit::sphere(&points(&probes[..]), &FitSettings::default()).unwrap();
        assert!((fit.diameter_mm - 22.0).abs() < 1e-9);
    }

    #[test]
    fn plane_points_fall_one_to_a_cell_and_never_where_nothing_may_be_probed() {
        let normal = tilted().into_inner();
        let rectangle = Rectangle {
            center_mm: Point3::new(0.0, 5.0, 100.0),
            normal,
            edges: tangents(&normal),
            half_size_mm: [30.0, 10.0],
        };
        let probes = plane(&rectangle, 27, 7, &|_| true);
        assert_eq!(probes.len(), 27, "9 columns of 3");
        let [a, b] = rectangle.edges;
        for (index, probe) in probes.iter().enumerate() {
            let arm = probe.point_mm - rectangle.center_mm;
            let cell = [(arm.dot(&a) + 30.0) / 60.0 * 9.0, (arm.dot(&b) + 10.0) / 20.0 * 3.0];
            assert!(arm.dot(&normal).abs() < 1e-12);
            assert_eq!([cell[0] as usize, cell[1] as usize], [index % 9, index / 9]);
        }
        assert_eq!(probes, plane(&rectangle, 27, 7, &|_| true));
        assert_ne!(probes, plane(&rectangle, 27, 8, &|_| true));
        let outside = |place: [f64; 2]| place[0] > 0.0;
        let half = plane(&rectangle, 27, 7, &outside);
        assert!(half.len() >= 27 && half.iter().all(|p| (p.point_mm - rectangle.center_mm).dot(&a) > 0.0));
        assert!(plane(&rectangle, 27, 7, &|_| false).is_empty());
    }

    #[test]
    fn cylinder_points_are_spaced_alike_along_and_around() {
        // Eq. 4.13 and 4.14 by hand: N = 100, h = 40, r = 5: √(4000/31.4) = 11.3 circles, 100/11 → 10 points.
        assert_eq!(cylinder_circles(5.0, 40.0, 100), [11, 10]);
        let (along, around) = (40.0 / 11.0, std::f64::consts::TAU * 5.0 / 10.0);
        assert!((along / around - 1.0_f64).abs() < 0.2);
        // A flat ring keeps two circles, a thin pin three points on each.
        assert_eq!(cylinder_circles(50.0, 1.0, 20), [2, 10]);
        assert_eq!(cylinder_circles(0.1, 50.0, 20), [20, 3]);
        let probes = cylinder(&Point3::new(3.0, 0.0, 200.0), &tilted(), 5.0, 40.0, 100);
        assert_eq!(probes.len(), 110);
        let fit = fit::cylinder(&points(&probes), &FitSettings::default()).unwrap();
        assert!((fit.diameter_mm - 10.0).abs() < 1e-9);
        let centre = Point3::from(Vector3::from(fit.axis_point_mm));
        assert!((centre - Point3::new(3.0, 0.0, 200.0)).norm() < 1e-6);
    }
}
