//! A turned part as points on exact places: what it has against its nominal geometry is known to the last digit.

use fringe::cloud::Point;
use fringe::math;
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Seat (datum), journal and end face on one axis, three balls around it, and a groove between two walls.
const ELEMENTS: &str = r#"
format = "fringecell-plan/1"
name = "turned"

[[datum_system]]
name = "AB"
datums = ["seat", "face"]

[[element]]
kind = "cylinder"
name = "seat"
point_mm = [0.0, 0.0, 20.0]
axis = [0.0, 0.0, 1.0]
diameter_mm = 20.0
length_mm = 40.0
margin_mm = 0.5
normal_tolerance_deg = 20.0
min_points = 100

[[element]]
kind = "cylinder"
name = "journal"
point_mm = [0.0, 0.0, 60.0]
axis = [0.0, 0.0, 1.0]
diameter_mm = 12.0
length_mm = 20.5
margin_mm = 0.5
normal_tolerance_deg = 20.0
min_points = 100

[[element]]
kind = "plane"
name = "face"
point_mm = [0.0, 0.0, 80.0]
normal = [0.0, 0.0, 1.0]
direction = [1.0, 0.0, 0.0]
size_mm = [8.0, 8.0]
margin_mm = 0.5
normal_tolerance_deg = 20.0
min_points = 50

[[element]]
kind = "plane"
name = "slope"
point_mm = [40.0, 0.0, 0.0]
normal = [0.5, 0.0, 0.8660254037844386]
direction = [0.0, 1.0, 0.0]
size_mm = [20.0, 10.0]
margin_mm = 0.5
normal_tolerance_deg = 20.0
min_points = 50

[[element]]
kind = "line"
name = "trace"
point_mm = [0.0, 0.0, -60.0]
normal = [0.0, 0.0, 1.0]
direction = [1.0, 0.0, 0.0]
length_mm = 30.0
width_mm = 2.0
margin_mm = 0.5
normal_tolerance_deg = 20.0
min_points = 50

[[element]]
kind = "symmetry-plane"
name = "body"
elements = ["left", "right"]

[[element]]
kind = "symmetry-plane"
name = "groove"
elements = ["groove_left", "groove_right"]

[[element]]
kind = "fit-circle"
name = "pitch"
elements = ["ball1", "ball2", "ball3"]
"#;

/// What the part has against its nominal geometry.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Turned {
    /// Shift of the journal across the axis, mm.
    pub(super) journal_off: [f64; 2],
    /// Slope of the journal's axis in the plane of x and z.
    pub(super) journal_slope: f64,
    /// Height of three lobes on the journal, mm.
    pub(super) lobes: f64,
    pub(super) journal_oversize: f64,
    /// Whether the journal is a hole.
    pub(super) hole: bool,
    /// Slope of the face along x.
    pub(super) face_slope: f64,
    pub(super) balls_off: [f64; 2],
    pub(super) groove_off: f64,
    /// Height of bumps on slope and trace, mm.
    pub(super) bumps: f64,
    /// Slope of the inclined plane beyond its nominal angle, along its fall.
    pub(super) slope: f64,
}

const BALLS: [[f64; 2]; 3] = [[30.0, 0.0], [-15.0, 25.980_762_113_533_16], [-15.0, -25.980_762_113_533_16]];

/// Walls of body and groove: name, place along x, side that the normal points to.
const WALLS: [(&str, f64, f64); 4] =
    [("left", -10.0, -1.0), ("right", 10.0, 1.0), ("groove_left", -3.0, 1.0), ("groove_right", 3.0, -1.0)];

pub(super) fn elements(hole: bool) -> String {
    let mut text = ELEMENTS.to_owned();
    if hole {
        text = text.replace("length_mm = 20.5\n", "length_mm = 20.5\ninternal = true\n");
    }
    let walls = WALLS.map(|(name, x, side)| {
        format!(
            "[[element]]\nkind = \"plane\"\nname = \"{name}\"\npoint_mm = [{x:?}, 0.0, -20.0]\nnormal = [{side:?}, 0.0, 0.0]\n\
             direction = [0.0, 1.0, 0.0]\nsize_mm = [20.0, 10.0]\nmargin_mm = 0.5\nnormal_tolerance_deg = 20.0\nmin_points = 50\n"
        )
    });
    let balls = BALLS.iter().enumerate().map(|(i, [x, y])| {
        format!(
            "[[element]]\nkind = \"sphere\"\nname = \"ball{}\"\ncenter_mm = [{x:?}, {y:?}, 30.0]\ndiameter_mm = 8.0\n\
             max_polar_deg = 88.0\nmargin_mm = 0.5\nnormal_tolerance_deg = 20.0\nmin_points = 50\n",
            i + 1
        )
    });
    let measured: String = walls.into_iter().chain(balls).collect();
    // Measured elements stand before those made of them.
    let (before, made) = text.split_at(text.find("[[element]]\nkind = \"symmetry-plane\"").unwrap());
    format!("{before}{measured}{made}")
}

pub(super) fn point(at: Vector3<f64>, normal: Vector3<f64>) -> Point {
    Point { position_mm: at.into(), normal: normal.map(|v| v as f32).into(), ..bytemuck::Zeroable::zeroed() }
}

impl Turned {
    pub(super) fn cloud(&self) -> Vec<Point> {
        [Self::seat(), self.journal(), self.face(), self.slope(), self.trace(), self.walls(), self.balls()]
            .concat()
    }

    pub(super) fn seat() -> Vec<Point> {
        rings(0..=40, |out, height| out * 10.0 + Vector3::z() * height, 1.0)
    }

    pub(super) fn journal(&self) -> Vec<Point> {
        let place = |out: Vector3<f64>, height: f64| {
            let around = math::atan2(out.y, out.x);
            let radius = 6.0 + 0.5 * self.journal_oversize + self.lobes * math::cos(3.0 * around);
            let [x, y] = self.journal_off;
            out * radius + Vector3::new(x + self.journal_slope * (height - 60.0), y, height)
        };
        rings(50..=70, place, if self.hole { -1.0 } else { 1.0 })
    }

    pub(super) fn face(&self) -> Vec<Point> {
        grid(7, 7, 0.5, |x, y| (Vector3::new(x, y, 80.0 + self.face_slope * x), Vector3::z()))
    }

    pub(super) fn slope(&self) -> Vec<Point> {
        let (normal, fall) =
            (Vector3::new(0.5, 0.0, 0.75f64.sqrt()), Vector3::new(0.75f64.sqrt(), 0.0, -0.5));
        grid(9, 19, 0.5, |x, y| {
            let bump = self.bumps * math::sin(1.7 * x) * math::cos(0.9 * y) + self.slope * x;
            (Vector3::new(40.0, 0.0, 0.0) + fall * x + Vector3::y() * y + normal * bump, normal)
        })
    }

    pub(super) fn trace(&self) -> Vec<Point> {
        grid(58, 3, 0.25, |x, y| (Vector3::new(x, y, -60.0 + self.bumps * math::sin(0.8 * x)), Vector3::z()))
    }

    fn walls(&self) -> Vec<Point> {
        let wall = |(name, x, side): (&str, f64, f64)| {
            let off = if name.starts_with("groove") { self.groove_off } else { 0.0 };
            grid(19, 9, 0.5, move |y, z| (Vector3::new(x + off, y, z - 20.0), Vector3::x() * side))
        };
        WALLS.into_iter().flat_map(wall).collect()
    }

    fn balls(&self) -> Vec<Point> {
        let ball = |[x, y]: [f64; 2]| {
            let centre = Vector3::new(x + self.balls_off[0], y + self.balls_off[1], 30.0);
            (0..300).map(move |i| {
                let z = 1.0 - 0.9 * (f64::from(i) + 0.5) / 300.0;
                let (sin, cos) = math::sincos(2.399_963 * f64::from(i));
                let across = (1.0 - z * z).sqrt();
                let out = Vector3::new(across * cos, across * sin, z);
                point(centre + out * 4.0, out)
            })
        };
        BALLS.into_iter().flat_map(ball).collect()
    }
}

/// Points every 5° and every millimetre around the axis.
pub(super) fn rings(
    heights: std::ops::RangeInclusive<i32>,
    place: impl Fn(Vector3<f64>, f64) -> Vector3<f64>,
    side: f64,
) -> Vec<Point> {
    let ring = |height: i32| {
        let place = &place;
        (0..72).map(move |i| {
            let (sin, cos) = math::sincos(TAU * f64::from(i) / 72.0);
            let out = Vector3::new(cos, sin, 0.0);
            point(place(out, f64::from(height)), out * side)
        })
    };
    heights.flat_map(ring).collect()
}

/// Points of a grid about the middle of two directions: from −half to half steps each.
pub(super) fn grid(
    first: i32,
    second: i32,
    step_mm: f64,
    place: impl Fn(f64, f64) -> (Vector3<f64>, Vector3<f64>),
) -> Vec<Point> {
    let both = (-first..=first).flat_map(|i| (-second..=second).map(move |j| (i, j)));
    both.map(|(i, j)| place(f64::from(i) * step_mm, f64::from(j) * step_mm))
        .map(|(p, n)| point(p, n))
        .collect()
}
