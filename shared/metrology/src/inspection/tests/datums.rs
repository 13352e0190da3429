//! Datum systems by hand: what each datum takes, what it leaves, and what a best fit makes of points that do not fit.

use nalgebra::{Matrix3, Vector3};

use crate::inspection::datum::fix;
use crate::inspection::substitute::{Shape, Substitute, turned};

fn rest(at: [f64; 3], normal: Vector3<f64>) -> Substitute {
    Substitute { shape: Shape::SurfacePoint, direction: normal, ..Substitute::point(at.into()) }
}

fn plane(at: [f64; 3], normal: Vector3<f64>) -> Substitute {
    Substitute::plane(at.into(), normal, [10.0, 10.0])
}

/// A measured element that lies off by a shift and is turned.
fn off(element: &Substitute, shift: [f64; 3], turn: [f64; 3]) -> Substitute {
    let turn = Vector3::from(turn);
    Substitute {
        point: element.point + Vector3::from(shift),
        direction: turned(&element.direction, &turn),
        across: turned(&element.across, &turn),
        ..*element
    }
}

fn near(a: &Matrix3<f64>, b: &Matrix3<f64>) -> bool {
    (a - b).amax() < 1e-9
}

/// Planes A, B, C: A keeps its normal, B gives the turn about it, C the last shift. That B is not square to A by 2 mrad, and C
/// by 3 mrad, shows nowhere in the frame.
#[test]
fn each_datum_takes_what_those_before_left_open() {
    let nominal =
        [plane([0.0; 3], Vector3::z()), plane([0.0; 3], -Vector3::y()), plane([0.0; 3], -Vector3::x())];
    let measured = [
        off(&nominal[0], [0.0, 0.0, 0.1], [0.0; 3]),
        // Turned by 1 mrad about z, and tilted by 2 mrad about x.
        off(&off(&nominal[1], [0.0, 0.2, 0.0], [0.0, 0.0, 1e-3]), [0.0; 3], [2e-3, 0.0, 0.0]),
        off(&nominal[2], [0.3, 0.0, 0.0], [0.0, 3e-3, 0.0]),
    ];
    let steps = |list: &[Substitute]| list.iter().map(|one| vec![*one]).collect::<Vec<_>>();
    let frame = fix(&steps(&nominal), &steps(&measured)).unwrap();
    assert!(frame.open.is_empty(), "{:?}", frame.open);
    // The tilt about x shortens the projection of B's normal, not its direction.
    let (sin, cos) = fringe::math::sincos(1e-3);
    let about_z = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
    assert!((frame.pose.rotation.column(2) - Vector3::z()).norm() < 1e-9, "A keeps its normal");
    assert!((frame.pose.rotation - about_z).amax() < 3e-9, "{}", frame.pose.rotation - about_z);
    assert!((frame.pose.translation.z - 0.1).abs() < 1e-9, "{}", frame.pose.translation);
    // Planes as primary datum in another order: now A's squareness shows as a tilt of the frame.
    let other = |list: &[Substitute]| vec![vec![list[1]], vec![list[0]], vec![list[2]]];
    let frame = fix(&other(&nominal), &other(&measured)).unwrap();
    let tilt = frame.pose.rotation.column(2).dot(&Vector3::y());
    assert!((tilt + 2e-3).abs() < 1e-8, "B leads: {tilt}");
}

/// Rest points 3-2-1 (RPS): three in z, two in y, one in x, each pushed along its normal alone.
#[test]
fn six_rest_points_give_the_motion_of_their_pushes() {
    let z = Vector3::z();
    let (y, x) = (Vector3::y(), Vector3::x());
    let nominal = vec![
        vec![rest([-40.0, -30.0, 0.0], z), rest([40.0, -30.0, 0.0], z), rest([0.0, 30.0, 0.0], z)],
        vec![rest([-40.0, -30.0, 0.0], y), rest([40.0, -30.0, 0.0], y)],
        vec![rest([-50.0, 0.0, 0.0], x)],
    ];
    let mut measured = nominal.clone();
    // All of z lifted by 0.05; the right of y pushed by 0.08 over 80 mm: 1 mrad about z; x pushed by 0.02.
    measured[0].iter_mut().for_each(|p| p.point.z += 0.05);
    measured[1][1].point.y += 0.08;
    measured[2][0].point.x += 0.02;
    // What lies across a normal is not looked at.
    measured[0][0].point.x += 0.5;
    let frame = fix(&nominal, &measured).unwrap();
    assert!(frame.open.is_empty());
    let turn = frame.pose.rotation[(1, 0)];
    assert!((turn - 1e-3).abs() < 2e-6, "{turn}");
    let place = |at: [f64; 3]| frame.pose.point(&at.into());
    for (at, height) in [([-40.0, -30.0, 0.0], 0.05), ([0.0, 30.0, 0.0], 0.05)] {
        assert!((place(at).z - height).abs() < 1e-9);
    }
    assert!((place([-40.0, -30.0, 0.0]).y + 30.0).abs() < 1e-3);
    assert!((place([40.0, -30.0, 0.0]).y + 29.92).abs() < 1e-3);
}

/// Four points in one step are a best fit: of heights 4, 0, 0, 0 at the corners of a square the plane takes one everywhere, and
/// one more along each edge; a saddle shows nowhere.
#[test]
fn a_best_fit_shares_what_does_not_fit() {
    let corners = [[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0]];
    let step: Vec<Substitute> = corners.iter().map(|[x, y]| rest([*x, *y, 0.0], Vector3::z())).collect();
    let lifted = |heights: [f64; 4]| -> Vec<Substitute> {
        step.iter().zip(heights).map(|(p, h)| off(p, [0.0, 0.0, h], [0.0; 3])).collect()
    };
    let frame = fix(std::slice::from_ref(&step), &[lifted([0.0, 0.0, 0.004, 0.0])]).unwrap();
    for ([x, y], height) in corners.iter().zip([-0.001, 0.001, 0.003, 0.001]) {
        let found = frame.pose.point(&Vector3::new(*x, *y, 0.0)).z;
        assert!((found - height).abs() < 1e-6, "{x} {y}: {found} for {height}");
    }
    assert_eq!(frame.open.len(), 3, "two shifts and the turn about z");
    let saddle = fix(std::slice::from_ref(&step), &[lifted([0.004, -0.004, 0.004, -0.004])]).unwrap();
    assert!(near(&saddle.pose.rotation, &Matrix3::identity()));
    assert!(saddle.pose.translation.norm() < 1e-9);
}
