//! What a drift of a view does to the lengths that a pair measures.

use super::matches::Match;
use super::state::{Partner, UNKNOWNS, stepped};
use fringe::geometry::camera::Camera;
use fringe::geometry::triangulate::triangulate;
use fringe::math::linear::Dense;
use nalgebra::Point3;

/// So many places tell the lengths of an object.
const PLACES: usize = 300;
/// Steps of the derivatives: rad, mm, relative.
const STEPS: [f64; UNKNOWNS] = [1e-5, 1e-5, 1e-5, 5e-3, 5e-3, 5e-3, 1e-5];

/// Mean of r rᵀ over lengths between places all over the object, r the derivatives of a length by the drift over the length; `None`
/// where no places meet.
pub(super) fn length_form(partner: &Partner, view: &Camera) -> Option<Dense> {
    let stride = partner.matches.len().div_ceil(PLACES).max(1);
    let places: Vec<_> = partner.matches.iter().step_by(stride).collect();
    let seen = |camera: &Camera| -> Vec<Option<Point3<f64>>> {
        let meet = |m: &&Match| triangulate((partner.fixed, m.left), (camera, m.right));
        places.iter().map(|m| Some(meet(m)?.position_mm)).collect()
    };
    let here = seen(view);
    let there: Vec<_> = (0..UNKNOWNS)
        .map(|k| {
            let mut step = [0.0; UNKNOWNS];
            step[k] = STEPS[k];
            seen(&stepped(view, &step))
        })
        .collect();
    let (mut form, mut count) = (Dense::zeros(UNKNOWNS, UNKNOWNS), 0.0);
    for i in 0..places.len() {
        // Across the object, and in another direction.
        for j in [(i + places.len() / 2) % places.len(), (i + places.len() / 3) % places.len()] {
            let Some(by) = relative(&here, &there, (i, j)) else { continue };
            count += 1.0;
            for (a, va) in by.iter().enumerate() {
                for (b, vb) in by.iter().enumerate() {
                    form.add(a, b, va * vb);
                }
            }
        }
    }
    (count > 0.0).then(|| Dense::from_fn(UNKNOWNS, UNKNOWNS, |i, j| form.at(i, j) / count))
}

/// Derivatives of the length between two places over the length; `None` where they do not meet, or lie together.
fn relative(
    here: &[Option<Point3<f64>>],
    there: &[Vec<Option<Point3<f64>>>],
    (i, j): (usize, usize),
) -> Option<[f64; UNKNOWNS]> {
    let length = |at: &[Option<Point3<f64>>]| Some((at[i]? - at[j]?).norm());
    let from = length(here)?;
    let mut by = [0.0; UNKNOWNS];
    for (k, by) in by.iter_mut().enumerate() {
        *by = (length(&there[k])? / from - 1.0) / STEPS[k];
    }
    // A tenth of a millimetre is no length of an object.
    (from > 0.1).then_some(by)
}
