//! Form, orientation, profile and run-out of a plan, from as written to as meant.

use nalgebra::Vector3;

use super::characteristic::{Characteristic, Kind};
use super::check_characteristics::{Checked, plain};
use super::criterion::Criterion;
use super::plan::{Feature, PlanError};
use super::raw_features::{RawForm, RawOrientation, RawProfile};
use super::substitute::Shape;

/// Sine of the angle by which nominal directions may miss what a characteristic says of them: digits of the plan.
const NOMINAL_SINE: f64 = 1e-4;

/// How far a nominal element may lie from its datum where they are meant to coincide, mm.
const NOMINAL_MM: f64 = 1e-3;

impl Checked<'_> {
    pub(super) fn form(
        self,
        name: &'static str,
        raw: &RawForm,
        wanted: &str,
        fits: impl Fn(Shape) -> bool,
    ) -> Result<Feature, PlanError> {
        let index = self.element_of(&raw.element, wanted, fits)?;
        self.with_points(index, &raw.element)?;
        let filter_mm = self.filter(raw.filter_mm)?;
        let shape = self.shape(index)?.shape;
        match raw.reference {
            Criterion::LeastSquares => {}
            Criterion::MinimumZone if filter_mm.is_none() || matches!(shape, Shape::Plane | Shape::Line) => {}
            Criterion::MinimumZone => {
                return Err(self.place.refuse(format!(
                    "filter_mm with reference = \"minimum-zone\" is for planes and lines, not for a {}: leave one out",
                    shape.words()
                )));
            }
            other => {
                return Err(self.place.refuse(format!(
                    "reference = \"{}\"; a form knows least-squares and minimum-zone",
                    other.key()
                )));
            }
        }
        let one = Characteristic { filter_mm, ..plain(name, Kind::Form(raw.reference), vec![index]) };
        self.limited(one, raw.limit_mm, raw.u_system_mm)
    }

    /// Refuses elements made of others where points are meant.
    pub(super) fn with_points(&self, index: usize, name: &str) -> Result<(), PlanError> {
        if index < self.plan.elements.len() {
            return Ok(());
        }
        Err(self
            .place
            .refuse(format!("element \"{name}\" is made of others and has no points; name a measured one")))
    }

    pub(super) fn orientation(
        mut self,
        name: &'static str,
        raw: &RawOrientation,
    ) -> Result<Feature, PlanError> {
        let index = self.element_of(&raw.element, "plane or axis", |s| s == Shape::Plane || s.is_axis())?;
        let datums = self.datums(&raw.datums, &[index])?;
        self.nominal_angle(name, index, datums)?;
        let one = Characteristic {
            datums: Some(datums),
            filter_mm: self.filter(raw.filter_mm)?,
            zone_direction: self.zone_direction(raw.zone_direction)?,
            ..plain(name, Kind::Orientation(raw.of), vec![index])
        };
        self.limited(one, raw.limit_mm, raw.u_system_mm)
    }

    /// Parallelism and perpendicularity say what the nominal angle to the first datum is.
    pub(super) fn nominal_angle(&self, name: &str, index: usize, datums: usize) -> Result<(), PlanError> {
        let first = self.plan.datum_systems[datums].steps[0][0];
        let (element, datum) = (self.shape(index)?, self.shape(first)?);
        if datum.direction == Vector3::zeros() {
            let first = self.plan.element_name(first);
            return Err(self.place.refuse(format!(
                "datums begin with \"{first}\", a {}, which has no direction; begin with a plane or an axis",
                datum.shape.words()
            )));
        }
        let (cosine, sine) =
            (element.direction.dot(&datum.direction).abs(), element.direction.cross(&datum.direction).norm());
        let alike = (element.shape == Shape::Plane) == (datum.shape == Shape::Plane);
        let off = match name {
            "parallelism" => {
                if alike {
                    sine
                } else {
                    cosine
                }
            }
            "perpendicularity" => {
                if alike {
                    cosine
                } else {
                    sine
                }
            }
            _ => 0.0,
        };
        if off <= NOMINAL_SINE {
            return Ok(());
        }
        let degrees = fringe::math::asin(off.min(1.0)).to_degrees();
        Err(self.place.refuse(format!(
            "kind = \"{name}\", but the nominal directions miss that by {degrees:.3}°; correct them, or take angularity"
        )))
    }

    /// Location on the datum itself: the nominal element must lie there.
    pub(super) fn coincident(
        mut self,
        name: &'static str,
        index: usize,
        datums: &str,
        limit_mm: f64,
        u: f64,
    ) -> Result<Feature, PlanError> {
        let datums = self.datums(datums, &[index])?;
        let element = self.shape(index)?;
        let first = self.plan.datum_systems[datums].steps[0][0];
        let datum = self.shape(first)?;
        let off = match (element.shape, datum.shape) {
            (Shape::Plane, Shape::Plane) => datum.direction.dot(&(element.point - datum.point)).abs(),
            (_, d) if d.is_axis() || (d == Shape::Circle && element.shape.is_axis()) => {
                (element.point - datum.point).cross(&datum.direction).norm()
            }
            (_, Shape::Circle) => {
                let off = element.point - datum.point;
                (off - datum.direction * datum.direction.dot(&off)).norm()
            }
            (_, d) if d.is_point() => (element.point - datum.point).norm(),
            (_, d) => {
                let name = self.plan.element_name(first);
                return Err(self.place.refuse(format!(
                    "datums begin with \"{name}\", a {}; begin with what the element shall coincide with",
                    d.words()
                )));
            }
        };
        if off > NOMINAL_MM {
            return Err(self.place.refuse(format!(
                "kind = \"{name}\", but the element lies nominally {off:.4} mm from its datum, limit {NOMINAL_MM} mm; correct the nominal places, or take position"
            )));
        }
        let one = Characteristic { datums: Some(datums), ..plain(name, Kind::Position(None), vec![index]) };
        self.limited(one, limit_mm, u)
    }

    pub(super) fn profile(
        mut self,
        name: &'static str,
        raw: &RawProfile,
        wanted: &str,
    ) -> Result<Feature, PlanError> {
        let line = name == "line-profile";
        let index = self.element(&raw.element)?;
        self.with_points(index, &raw.element)?;
        let kind = self.plan.elements[index].geometry.kind();
        let fits = if line {
            kind == "line"
        } else {
            matches!(kind, "sphere" | "plane" | "cylinder" | "cone" | "torus" | "surface")
        };
        if !fits {
            return Err(self
                .place
                .refuse(format!("element names \"{}\", a {kind}; name a {wanted}", raw.element)));
        }
        let datums = raw.datums.as_ref().map(|d| self.datums(d, &[index])).transpose()?;
        let one = Characteristic {
            datums,
            filter_mm: self.filter(raw.filter_mm)?,
            ..plain(name, Kind::Profile, vec![index])
        };
        self.limited(one, raw.limit_mm, raw.u_system_mm)
    }

    pub(super) fn runout(
        mut self,
        name: &'static str,
        section_mm: Option<f64>,
        (element, datums): (&str, &str),
        filter_mm: Option<f64>,
        [limit_mm, u_system]: [f64; 2],
    ) -> Result<Feature, PlanError> {
        let turned = |s| matches!(s, Shape::Cylinder | Shape::Cone | Shape::Plane);
        let index = self.element_of(element, "cylinder, cone or plane", turned)?;
        self.with_points(index, element)?;
        let system = self.datums(datums, &[index])?;
        let step = &self.plan.datum_systems[system].steps[0];
        let datum = self.shape(step[0])?;
        if step.len() != 1 || !datum.shape.is_axis() {
            return Err(self.place.refuse(format!(
                "datums \"{datums}\" begin with a {}; run-out needs one axis first: cylinder, cone or line",
                datum.shape.words()
            )));
        }
        let one = Characteristic {
            datums: Some(system),
            filter_mm: self.filter(filter_mm)?,
            ..plain(name, Kind::Runout(section_mm), vec![index])
        };
        self.limited(one, limit_mm, u_system)
    }
}
