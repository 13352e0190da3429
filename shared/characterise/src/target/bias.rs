//! Where the centre of a circle is not the centre of its image.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

/// Centre of the ellipse that a circle of the plane is seen as, less the image of the circle's centre (unit of the
/// image side of the homography). `None` when the circle reaches the horizon.
///
/// `image_from_board` maps (x mm, y mm, 1) of the board to the image, of a camera without distortion (normalised
/// coordinates or undistorted pixels). Exact: the dual conic of the circle, C* = r²·diag(1, 1, 0) − c·cᵀ, maps to
/// H·C*·Hᵀ, whose last column is the centre (Hartley and Zisserman, section 2.3). A detected centre is corrected by
/// subtracting this.
///
/// ```
/// use nalgebra::{Matrix3, Point2};
/// // Seen straight on, a circle is a circle.
/// let bias = characterise::target::projected_circle_center_bias(&Matrix3::identity(), Point2::new(3.0, 4.0), 1.0);
/// assert_eq!(bias.map(|b| b.norm()), Some(0.0));
/// ```
pub fn projected_circle_center_bias(
    image_from_board: &Matrix3<f64>,
    centre_mm: Point2<f64>,
    radius_mm: f64,
) -> Option<Vector2<f64>> {
    let centre = image_from_board * Vector3::new(centre_mm.x, centre_mm.y, 1.0);
    // H·diag(1, 1, 0)·Hᵀ, last column.
    let horizon = image_from_board.fixed_view::<1, 2>(2, 0).transpose();
    let spread = image_from_board.fixed_view::<3, 2>(0, 0) * horizon;
    let squared = radius_mm * radius_mm;
    let weight = centre.z * centre.z - squared * spread.z;
    // At the horizon w² = r²(h₃₁² + h₃₂²).
    if weight.is_nan() || weight <= 1e-12 * centre.z * centre.z {
        return None;
    }
    let ellipse = (centre.xy() * centre.z - spread.xy() * squared) / weight;
    Some(ellipse - centre.xy() / centre.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn the_bias_is_that_of_a_conic_through_projected_points() {
        let h = Matrix3::new(820.0, -40.0, 300.0, 60.0, 790.0, 200.0, 0.004, -0.003, 1.0);
        let (centre, radius) = (Point2::new(7.0, -5.0), 12.0);
        let project = |p: Point2<f64>| {
            let q = h * Vector3::new(p.x, p.y, 1.0);
            q.xy() / q.z
        };
        // Extremes of x of the ellipse are symmetric about its centre; so are those of y.
        let mut least = Vector2::repeat(f64::INFINITY);
        let mut most = Vector2::repeat(f64::NEG_INFINITY);
        for i in 0..400_000 {
            let (sin, cos) = fringe::math::sincos(TAU * f64::from(i) / 400_000.0);
            let p = project(centre + Vector2::new(cos, sin) * radius);
            least = least.inf(&p);
            most = most.sup(&p);
        }
        let brute = (least + most) * 0.5 - project(centre);
        let bias = projected_circle_center_bias(&h, centre, radius).expect("in front");
        assert!(brute.norm() > 1.0 && (bias - brute).norm() < 1e-4, "{bias:?} {brute:?}");
    }

    #[test]
    fn a_circle_that_reaches_the_horizon_has_no_centre() {
        let h = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.01, 0.0, 1.0);
        assert!(projected_circle_center_bias(&h, Point2::origin(), 99.0).is_some());
        assert_eq!(projected_circle_center_bias(&h, Point2::origin(), 101.0), None);
        assert_eq!(projected_circle_center_bias(&h, Point2::origin(), f64::NAN), None);
    }
}
