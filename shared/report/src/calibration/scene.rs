//! Cameras, projectors and all poses of the target from three sides.

use characterise::calibration::{CalibratedDevice, DeviceKind, Volume};
use nalgebra::{Isometry3, Point2, Point3, Vector3};

use super::super::number::round_up;
use super::super::page::{Page, Text};
use super::super::svg::{self, Anchor};
use super::CalibrationReport;

const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 420.0;

/// A side from which the cell is drawn.
struct Side {
    name: &'static str,
    /// Right, down and away from the viewer, in the volume's frame with z towards the devices.
    axes: [Vector3<f64>; 3],
}

fn sides() -> [Side; 3] {
    let oblique = Vector3::new(0.55, 0.65, -0.53).normalize();
    let right = oblique.cross(&-Vector3::z()).normalize();
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
    [
        Side { name: "Oblique", axes: [-right, (oblique.cross(&-right)), oblique] },
        Side { name: "From above", axes: [x, -y, -z] },
        Side { name: "From the side", axes: [x, -z, y] },
    ]
}

/// A closed line with its look.
struct Shape {
    points: Vec<Point3<f64>>,
    style: String,
    label: Option<String>,
}

/// Writes the section with cameras, projectors and poses.
pub fn section(page: &mut Page, report: &CalibrationReport<'_>) {
    let Some(volume) = report.calibration.volume() else { return };
    let shapes = shapes(report, &volume);
    page.section("The cell and all poses of the target");
    page.put(format_args!(
        "<ul class=\"legend\"><li><i style=\"background:#0b5cad\"></i>camera</li><li><i style=\"background:#d97a00\"></i>projector</li>\
         <li><i style=\"background:#7fb69a\"></i>target, one outline a pose</li></ul>\n<div class=\"pictures\">\n"
    ));
    for side in sides() {
        draw(page, &shapes, &side);
    }
    page.put(format_args!("</div>\n"));
    page.small("Parallel projection, to scale. z is the mean normal of the target, pointing to the devices. Each pyramid opens along the \
                device's field of view.");
    page.end_section();
}

/// Everything in the volume's frame, z towards the devices.
fn shapes(report: &CalibrationReport<'_>, volume: &Volume) -> Vec<Shape> {
    let calibration = report.calibration;
    let to_volume = volume.world_from_volume.inverse();
    let centres: Vec<Point3<f64>> =
        calibration.devices.iter().map(|d| to_volume * d.camera.centre_mm()).collect();
    let turned = super::turned(report, volume);
    let up = |p: Point3<f64>| if turned { Point3::new(p.x, -p.y, -p.z) } else { p };
    let far = centres.iter().map(|c| c.coords.norm()).fold(0.0, f64::max);
    let mut shapes = Vec::new();
    let outline = outline(&calibration.target_mm);
    for board in calibration.boards.iter().flatten() {
        shapes.push(Shape {
            points: outline.iter().map(|p| up(to_volume * (board * p))).collect(),
            style: "fill=\"#7fb69a\" fill-opacity=\"0.10\" stroke=\"#2f7d57\" stroke-width=\"0.8\"".into(),
            label: None,
        });
    }
    for device in &calibration.devices {
        shapes.extend(pyramid(device, &to_volume, 0.14 * far).into_iter().map(|mut shape| {
            shape.points.iter_mut().for_each(|p| *p = up(*p));
            shape
        }));
    }
    shapes
}

/// The four outer points of the target.
fn outline(target: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let key = |signs: [f64; 2]| {
        move |p: &&Point3<f64>, q: &&Point3<f64>| {
            (signs[0] * p.x + signs[1] * p.y).total_cmp(&(signs[0] * q.x + signs[1] * q.y))
        }
    };
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .into_iter()
        .filter_map(|signs| target.iter().max_by(key(signs)).copied())
        .collect()
}

/// Base and four sides; the base carries the name.
fn pyramid(device: &CalibratedDevice, to_volume: &Isometry3<f64>, depth_mm: f64) -> Vec<Shape> {
    let camera = &device.camera;
    let (right, bottom) = (f64::from(camera.width_px) - 0.5, f64::from(camera.height_px) - 0.5);
    let base: Vec<Point3<f64>> = [[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]]
        .into_iter()
        .filter_map(|[x, y]| camera.ray(Point2::new(x, y)))
        .map(|ray| to_volume * (ray.origin_mm + ray.direction * depth_mm))
        .collect();
    let tip = to_volume * camera.centre_mm();
    let colour = match device.kind {
        DeviceKind::Camera => "#0b5cad",
        DeviceKind::Projector => "#d97a00",
    };
    let style = format!("fill=\"{colour}\" fill-opacity=\"0.16\" stroke=\"{colour}\" stroke-width=\"1.2\"");
    let mut shapes = vec![Shape { points: base.clone(), style: style.clone(), label: None }];
    for i in 0..base.len() {
        let points = vec![tip, base[i], base[(i + 1) % base.len()]];
        shapes.push(Shape { points, style: style.clone(), label: None });
    }
    if let Some(first) = shapes.first_mut() {
        first.label = Some(device.name.clone());
    }
    shapes
}

fn draw(page: &mut Page, shapes: &[Shape], side: &Side) {
    let flat = |p: &Point3<f64>| [p.coords.dot(&side.axes[0]), p.coords.dot(&side.axes[1])];
    let bound = |start: f64, pick: fn(f64, f64) -> f64| {
        let all = shapes.iter().flat_map(|s| s.points.iter().map(flat));
        all.fold([start; 2], |b, p| [pick(b[0], p[0]), pick(b[1], p[1])])
    };
    let (low, high) = (bound(f64::INFINITY, f64::min), bound(f64::NEG_INFINITY, f64::max));
    let scale =
        ((WIDTH - 90.0) / (high[0] - low[0]).max(1e-9)).min((HEIGHT - 90.0) / (high[1] - low[1]).max(1e-9));
    if !scale.is_finite() {
        return;
    }
    let place = |p: &Point3<f64>| {
        let [x, y] = flat(p);
        let at = |v: f64, i: usize, size: f64| (v - 0.5 * (low[i] + high[i])) * scale + 0.5 * size;
        [at(x, 0, WIDTH), at(y, 1, HEIGHT - 20.0)]
    };
    let depth = |s: &Shape| {
        s.points.iter().map(|p| p.coords.dot(&side.axes[2])).sum::<f64>() / s.points.len().max(1) as f64
    };
    let mut order: Vec<&Shape> = shapes.iter().collect();
    order.sort_by(|a, b| depth(b).total_cmp(&depth(a)));
    page.put(format_args!("<figure>"));
    svg::open(page, "framed", [WIDTH, HEIGHT], &format!("cell, {}", side.name));
    for shape in order {
        page.put(format_args!("<path d=\""));
        for (i, point) in shape.points.iter().enumerate() {
            let [x, y] = place(point);
            page.put(format_args!("{}{x:.1} {y:.1}", if i == 0 { 'M' } else { 'L' }));
        }
        page.put(format_args!("Z\" {} stroke-linejoin=\"round\"/>\n", shape.style));
    }
    for shape in shapes.iter().filter(|s| s.points.len() == 4) {
        let Some(label) = &shape.label else { continue };
        let (mut x, mut y) = (0.0, f64::INFINITY);
        for point in &shape.points {
            let at = place(point);
            x += at[0] / 4.0;
            y = y.min(at[1]);
        }
        let halo = "font-weight=\"600\" stroke=\"#fff\" stroke-width=\"3\" paint-order=\"stroke\"";
        svg::styled_text(page, [x, y - 6.0], 15.0, Anchor::Middle, halo, label);
    }
    let bar_mm = round_up(60.0 / scale);
    svg::scale_bar(page, [14.0, HEIGHT - 12.0], bar_mm * scale, 14.0, &format!("{bar_mm} mm"));
    let axes = [0, 1, 2].map(|axis| [side.axes[0][axis], side.axes[1][axis]]);
    svg::triad(page, [WIDTH - 48.0, HEIGHT - 42.0], axes, 13.0);
    svg::close(page);
    page.put(format_args!("<figcaption>{}</figcaption></figure>\n", Text(side.name)));
}
