//! The elements of a group, fitted: what their forms, centres and distances must hold to be values at all.

use nalgebra::{Point3, Vector3};

use super::AcceptanceError;
use super::elements::Group;
use super::plan::Artefact;
use crate::fit::{
    FitError, FitSettings, Form, PlaneFit, Residuals, SphereFit, centre_distance_mm, plane, sphere,
};

/// The elements of a group, fitted.
pub(super) enum Fitted {
    /// One sphere, or those of a ball bar.
    Spheres(Vec<SphereFit>),
    /// A plate, with the middle of its points.
    Plane(Box<PlaneFit>),
}

impl Fitted {
    /// Fits each element of the artefact.
    pub fn new(artefact: &Artefact, group: &Group, settings: &FitSettings) -> Result<Self, FitError> {
        if let ([points], true) = (group.elements.as_slice(), artefact.diameters_mm.is_empty()) {
            return Ok(Self::Plane(Box::new(plane(points, settings)?)));
        }
        Ok(Self::Spheres(
            group.elements.iter().map(|points| sphere(points, settings)).collect::<Result<_, _>>()?,
        ))
    }

    /// Form of an element.
    pub fn form(&self, element: usize) -> Option<&Form> {
        match self {
            Self::Spheres(fits) => fits.get(element).map(|fit| &fit.form),
            Self::Plane(fit) => Some(&fit.form),
        }
    }

    /// Forms of all elements.
    pub fn forms(&self) -> Vec<Form> {
        match self {
            Self::Spheres(fits) => fits.iter().map(|fit| fit.form).collect(),
            Self::Plane(fit) => vec![fit.form],
        }
    }

    fn residuals(&self) -> Vec<&Residuals> {
        match self {
            Self::Spheres(fits) => fits.iter().map(|fit| &fit.residuals).collect(),
            Self::Plane(fit) => vec![&fit.residuals],
        }
    }

    /// Centres of the spheres; of a plate the points above and below its middle by half its longer side, so that both its
    /// place and its normal distinguish it from another.
    pub fn centres(&self, artefact: &Artefact) -> Vec<Point3<f64>> {
        match self {
            Self::Spheres(fits) => fits.iter().map(SphereFit::center).collect(),
            Self::Plane(fit) => {
                let half = 0.5 * artefact.size_mm.map_or(0.0, |[a, b]| a.max(b));
                let normal: Vector3<f64> = fit.normal_vector();
                let middle = Point3::from(fit.centroid_mm);
                vec![middle - normal * half, middle + normal * half]
            }
        }
    }

    /// Refuses what is no value: a form that reaches the margin within which the element was looked for, and spheres that are
    /// not those of the bar.
    pub fn check(&self, place: &str, artefact: &Artefact, margin_mm: f64) -> Result<(), AcceptanceError> {
        for (index, residuals) in self.residuals().iter().enumerate() {
            let used: Vec<f64> = residuals.of_used().iter().map(|r| r.abs()).collect();
            let (largest, beyond) =
                (used.iter().copied().fold(0.0, f64::max), used.iter().filter(|r| **r >= margin_mm).count());
            if beyond > 0 {
                let message = format!(
                    "element {} of {}: {beyond} of {} points that count lie {margin_mm} mm (margin_mm) or more off the fit, the \
                     farthest {largest:.3} mm; such a form is not evaluated. Are they errors of the instrument, widen margin_mm \
                     and evaluate again; are they those of a stem, a rod or a fixture, name it in exclude_mm of the view or \
                     rod_diameter_mm of the artefact",
                    index + 1,
                    artefact.id,
                    used.len()
                );
                return Err(AcceptanceError::Plan { place: place.to_owned(), message });
            }
        }
        let Self::Spheres(fits) = self else { return Ok(()) };
        let Some((first, others)) = fits.split_first() else { return Ok(()) };
        for (index, (other, nominal)) in others.iter().zip(&artefact.spacings_mm).enumerate() {
            let found = centre_distance_mm(first, other).value;
            if (found - nominal).abs() > 0.5 * first.diameter_mm {
                let message = format!(
                    "spheres 1 and {} are {found:.3} mm apart, the certificate of {} states {nominal} mm: they are not the spheres \
                     of this bar; take other bodies out of the cloud, or give the places of its spheres in near_mm",
                    index + 2,
                    artefact.id
                );
                return Err(AcceptanceError::NotFound { place: place.to_owned(), message });
            }
        }
        Ok(())
    }
}
