//! Prints a fit in a few lines.

use super::region::Left;
use metrology::fit::{
    CircleFit, ConeFit, CylinderFit, Form, LineFit, PlaneFit, SphereFit, Support, TorusFit,
};

/// Properties of a fit that are printed.
pub trait Describe {
    /// Its parameters with uncertainties.
    fn parameters(&self) -> String;
    /// Form deviation of the fit.
    fn form(&self) -> &Form;
    /// What its uncertainties rest on.
    fn support(&self) -> &Support;
}

/// Prints a fit and the points left out.
pub fn print(fit: &impl Describe, left: &Left, minimum_zone_mm: Option<f64>) {
    println!("{}", fit.parameters());
    let form = fit.form();
    println!(
        "  {} points, {} rejected; form: range {:.5} mm, sigma {:.5} mm, 95 % within {:.5} mm",
        form.points, form.rejected, form.form_range_mm, form.form_sigma_mm, form.form_d95_mm
    );
    if let Some(outside) = left.outside_margin {
        println!("  {outside} points of the region are outside the margin");
    }
    if let Some(width) = minimum_zone_mm {
        println!("  minimum zone {width:.5} mm");
    }
    println!("  uncertainties: {}", words(fit.support()));
}

fn words(support: &Support) -> String {
    match (support.cells, support.correlation_reach_mm) {
        (0, _) => "points taken as independent".into(),
        (cells, None) => format!("noise correlated within {cells} cells"),
        (cells, Some(reach)) if reach > 0.0 => {
            format!("noise correlated over {reach:.2} mm as estimated from the residuals ({cells} cells)")
        }
        (cells, Some(_)) => format!("no correlation between {cells} cells in the residuals"),
    }
}

fn axis([x, y, z]: [f64; 3], [u, v, w]: [f64; 3]) -> String {
    format!("axis through ({x:.5}, {y:.5}, {z:.5}) mm along ({u:.7}, {v:.7}, {w:.7})")
}

macro_rules! describe {
    ($kind:ty, $fit:ident => $text:expr) => {
        impl Describe for $kind {
            fn parameters(&self) -> String {
                let $fit = self;
                $text
            }
            fn form(&self) -> &Form {
                &self.form
            }
            fn support(&self) -> &Support {
                &self.support
            }
        }
    };
}

describe!(SphereFit, s => {
    let [x, y, z] = s.center_mm;
    let (d, u) = (s.diameter_mm, s.u_diameter_mm);
    format!("sphere: centre ({x:.5}, {y:.5}, {z:.5}) mm, diameter {d:.5} mm, u {u:.5} mm")
});
describe!(PlaneFit, p => {
    let [x, y, z] = p.normal;
    let (offset, u) = (p.offset_mm, p.u_offset_mm);
    format!("plane: normal ({x:.7}, {y:.7}, {z:.7}), offset {offset:.5} mm, u {u:.5} mm")
});
describe!(CylinderFit, c => {
    let axis = axis(c.axis_point_mm, c.axis_direction);
    format!("cylinder: diameter {:.5} mm, u {:.5} mm\n  {axis}", c.diameter_mm, c.u_diameter_mm)
});
describe!(ConeFit, c => {
    let axis = axis(c.axis_point_mm, c.axis_direction);
    format!("cone: half angle {:.5}°, u {:.5}°\n  {axis}", c.half_angle_deg, c.u_half_angle_deg)
});
describe!(CircleFit, c => {
    let [x, y, z] = c.center_mm;
    let (d, u) = (c.diameter_mm, c.u_diameter_mm);
    format!("circle: centre ({x:.5}, {y:.5}, {z:.5}) mm, diameter {d:.5} mm, u {u:.5} mm")
});
describe!(LineFit, l => {
    format!("line: {}\n  straightness {:.5} mm", axis(l.axis_point_mm, l.axis_direction), l.straightness_mm)
});
describe!(TorusFit, t => {
    let axis = axis(t.center_mm, t.axis_direction);
    let (ring, u_ring) = (t.ring_diameter_mm, t.u_ring_diameter_mm);
    let (tube, u_tube) = (t.tube_diameter_mm, t.u_tube_diameter_mm);
    format!("torus: ring diameter {ring:.5} mm, u {u_ring:.5} mm; tube diameter {tube:.5} mm, u {u_tube:.5} mm\n  {axis}")
});
