//! Geometrical characteristics and datum systems of a plan, from as written to as meant.

use nalgebra::Vector3;

use super::characteristic::{Characteristic, Kind, MaximumMaterial};
use super::check_datums::Names;
use super::joint::{Part, nominal_parts};
use super::location::{nominal_angle_deg, value_of};
use super::plan::{Feature, Plan, PlanError, Quantity, Unit};
use super::raw::RawFeature;
use super::raw_features::SizeName;
use super::references::DatumSystem;
use super::substitute::{Shape, Substitute};
use super::within::{Within, tolerated};

/// What the checks of a feature look at.
pub(super) struct Checked<'p> {
    pub(super) plan: &'p mut Plan,
    pub(super) names: Names,
    pub(super) nominal: Vec<Part>,
    pub(super) place: Within,
    pub(super) name: String,
}

/// Checks a feature of a geometrical characteristic, which joins those of the plan.
#[allow(clippy::too_many_lines, reason = "one arm for each kind of feature")]
pub(super) fn characteristic(raw: RawFeature, plan: &mut Plan) -> Result<Feature, PlanError> {
    let name = written_name(&raw).to_owned();
    let (names, nominal) = (Names::of(plan), nominal_parts(plan));
    let mut checked = Checked { plan, names, nominal, place: Within(format!("feature \"{name}\"")), name };
    match raw {
        RawFeature::Size(r) => {
            let index = checked.element(&r.element)?;
            let size = checked.size_index(index, r.size)?;
            let one = plain("size", Kind::Size(size), vec![index]);
            checked.measured(one, r.nominal_mm, r.tolerance_mm, r.u_system_mm, Unit::Mm)
        }
        RawFeature::HalfAngle(r) => {
            let index = checked.element_of(&r.element, "cone", |s| s == Shape::Cone)?;
            let one = plain("half-angle", Kind::HalfAngle, vec![index]);
            checked.measured(one, r.nominal_deg, r.tolerance_deg, r.u_system_deg, Unit::Deg)
        }
        RawFeature::Distance(r) => {
            let elements = checked.two(&r.elements)?;
            let along = r.along.map(|v| checked.place.unit("along", v)).transpose()?;
            let datums = r.datums.map(|d| checked.datums(&d, &elements)).transpose()?;
            let one = Characteristic { datums, ..plain("distance", Kind::Distance(along), elements) };
            checked.measured(one, r.nominal_mm, r.tolerance_mm, r.u_system_mm, Unit::Mm)
        }
        RawFeature::Angle(r) => {
            let elements = checked.two(&r.elements)?;
            let one = plain("angle", Kind::Angle, elements);
            checked.measured(one, r.nominal_deg, r.tolerance_deg, r.u_system_deg, Unit::Deg)
        }
        RawFeature::Straightness(r) => checked.form("straightness", &r, "line or edge", |s| s == Shape::Line),
        RawFeature::Flatness(r) => checked.form("flatness", &r, "plane", |s| s == Shape::Plane),
        RawFeature::Roundness(r) => {
            checked.form("roundness", &r, "circle or sphere", |s| matches!(s, Shape::Circle | Shape::Sphere))
        }
        RawFeature::Cylindricity(r) => checked.form("cylindricity", &r, "cylinder", |s| s == Shape::Cylinder),
        RawFeature::Parallelism(r) => checked.orientation("parallelism", &r),
        RawFeature::Perpendicularity(r) => checked.orientation("perpendicularity", &r),
        RawFeature::Angularity(r) => checked.orientation("angularity", &r),
        RawFeature::Position(r) => {
            let index = checked.element(&r.element)?;
            checked.no_freeform(index)?;
            let datums = Some(checked.datums(&r.datums, &[index])?);
            let material = r.maximum_material.map(|size| checked.material(index, &size)).transpose()?;
            let zone_direction = checked.zone_direction(r.zone_direction)?;
            let one = plain("position", Kind::Position(material), vec![index]);
            checked.limited(Characteristic { datums, zone_direction, ..one }, r.limit_mm, r.u_system_mm)
        }
        RawFeature::Coaxiality(r) => {
            let index = checked.element_of(&r.element, "axis (cylinder, cone, line)", Shape::is_axis)?;
            checked.coincident("coaxiality", index, &r.datums, r.limit_mm, r.u_system_mm)
        }
        RawFeature::Concentricity(r) => {
            let index = checked.element_of(&r.element, "centre (circle, sphere, point)", Shape::is_point)?;
            checked.coincident("concentricity", index, &r.datums, r.limit_mm, r.u_system_mm)
        }
        RawFeature::Symmetry(r) => {
            let index = checked.element_of(&r.element, "plane", |s| s == Shape::Plane)?;
            checked.coincident("symmetry", index, &r.datums, r.limit_mm, r.u_system_mm)
        }
        RawFeature::LineProfile(r) => checked.profile("line-profile", &r, "line"),
        RawFeature::SurfaceProfile(r) => {
            checked.profile("surface-profile", &r, "sphere, plane, cylinder, cone, torus or surface")
        }
        RawFeature::CircularRunout(r) => {
            let section = Some(checked.place.positive("section_mm", r.section_mm)?);
            checked.runout(
                "circular-runout",
                section,
                (&r.element, &r.datums),
                r.filter_mm,
                [r.limit_mm, r.u_system_mm],
            )
        }
        RawFeature::TotalRunout(r) => checked.runout(
            "total-runout",
            None,
            (&r.element, &r.datums),
            r.filter_mm,
            [r.limit_mm, r.u_system_mm],
        ),
        _ => Err(checked.place.refuse("is no geometrical characteristic".into())),
    }
}

fn written_name(raw: &RawFeature) -> &str {
    match raw {
        RawFeature::Size(r) => &r.name,
        RawFeature::HalfAngle(r) => &r.name,
        RawFeature::Distance(r) => &r.name,
        RawFeature::Angle(r) => &r.name,
        RawFeature::Straightness(r)
        | RawFeature::Flatness(r)
        | RawFeature::Roundness(r)
        | RawFeature::Cylindricity(r) => &r.name,
        RawFeature::Parallelism(r) | RawFeature::Perpendicularity(r) | RawFeature::Angularity(r) => &r.name,
        RawFeature::Position(r) => &r.name,
        RawFeature::Coaxiality(r) | RawFeature::Concentricity(r) | RawFeature::Symmetry(r) => &r.name,
        RawFeature::LineProfile(r) | RawFeature::SurfaceProfile(r) => &r.name,
        RawFeature::CircularRunout(r) => &r.name,
        RawFeature::TotalRunout(r) => &r.name,
        _ => "",
    }
}

pub(super) fn plain(name: &'static str, kind: Kind, elements: Vec<usize>) -> Characteristic {
    Characteristic { name, kind, elements, datums: None, filter_mm: None, zone_direction: None }
}

impl Checked<'_> {
    pub(super) fn element(&self, name: &str) -> Result<usize, PlanError> {
        self.names.one(&self.place, "element", name)
    }

    pub(super) fn shape(&self, index: usize) -> Result<Substitute, PlanError> {
        self.nominal[index].clone().map_err(|why| self.place.refuse(why))
    }

    pub(super) fn element_of(
        &self,
        name: &str,
        wanted: &str,
        fits: impl Fn(Shape) -> bool,
    ) -> Result<usize, PlanError> {
        let index = self.element(name)?;
        let shape = self.shape(index)?.shape;
        if fits(shape) {
            return Ok(index);
        }
        let article = if wanted.starts_with(['a', 'e']) { "an" } else { "a" };
        Err(self
            .place
            .refuse(format!("element names \"{name}\", a {}; name {article} {wanted}", shape.words())))
    }

    pub(super) fn two(&self, names: &[String; 2]) -> Result<Vec<usize>, PlanError> {
        let found = self.names.several(&self.place, "elements", names)?;
        found.iter().try_for_each(|index| self.no_freeform(*index))?;
        Ok(found)
    }

    /// Refuses a freeform surface where a place or direction is meant.
    fn no_freeform(&self, index: usize) -> Result<(), PlanError> {
        if self.shape(index)?.shape != Shape::Surface {
            return Ok(());
        }
        let name = self.plan.element_name(index);
        Err(self.place.refuse(format!("\"{name}\" is a freeform surface: it has a surface-profile alone")))
    }

    /// The datum system of a name, or that of one element.
    pub(super) fn datums(&mut self, name: &str, toleranced: &[usize]) -> Result<usize, PlanError> {
        let known = self.plan.datum_systems.iter().position(|s| s.name == name);
        let system = if let Some(known) = known {
            known
        } else {
            let Some(index) = self.names.all().position(|n| n == name) else {
                let systems = self.plan.datum_systems.iter().map(|s| s.name.as_str());
                let known: Vec<&str> = systems.chain(self.names.all()).collect();
                return Err(PlanError::Reference {
                    place: self.place.0.clone(),
                    key: "datums",
                    name: name.into(),
                    kind: "datum systems and",
                    known: known.join(", "),
                });
            };
            self.plan.datum_systems.push(DatumSystem { name: name.to_owned(), steps: vec![vec![index]] });
            self.plan.datum_systems.len() - 1
        };
        let steps = &self.plan.datum_systems[system].steps;
        steps.iter().flatten().try_for_each(|index| self.no_freeform(*index))?;
        if let Some(own) = toleranced.iter().find(|i| steps.iter().flatten().any(|s| s == *i)) {
            let own = self.plan.element_name(*own);
            return Err(self.place.refuse(format!(
                "datums \"{name}\" hold \"{own}\", which is toleranced: a deviation from itself is none; take it out"
            )));
        }
        Ok(system)
    }

    pub(super) fn zone_direction(&self, given: Option<[f64; 3]>) -> Result<Option<Vector3<f64>>, PlanError> {
        given.map(|v| self.place.unit("zone_direction", v)).transpose()
    }

    pub(super) fn filter(&self, given: Option<f64>) -> Result<Option<f64>, PlanError> {
        given.map(|edge| self.place.positive("filter_mm", edge)).transpose()
    }

    pub(super) fn size_index(&self, index: usize, name: Option<SizeName>) -> Result<usize, PlanError> {
        use SizeName::{Diameter, Length, RingDiameter, TubeDiameter, Width};
        let shape = self.shape(index)?.shape;
        let found = match (shape, name) {
            (Shape::Sphere | Shape::Cylinder | Shape::Circle | Shape::Cone, None | Some(Diameter))
            | (Shape::Torus, Some(RingDiameter))
            | (Shape::Oblong, Some(Length)) => Some(0),
            (Shape::Torus, Some(TubeDiameter)) | (Shape::Oblong, Some(Width)) => Some(1),
            _ => None,
        };
        found.ok_or_else(|| {
            let words = match shape {
                Shape::Torus => "give size = \"ring-diameter\" or \"tube-diameter\"",
                Shape::Oblong => "give size = \"length\" or \"width\"",
                Shape::Sphere | Shape::Cylinder | Shape::Circle | Shape::Cone => {
                    "its only size is \"diameter\""
                }
                _ => "it has no size; name a sphere, circle, cylinder, cone, torus, slot or rectangle",
            };
            self.place.refuse(format!(
                "element \"{}\" is a {}: {words}",
                self.plan.element_name(index),
                shape.words()
            ))
        })
    }

    /// The maximum material size from a size feature of the same element.
    pub(super) fn material(&self, element: usize, size: &str) -> Result<MaximumMaterial, PlanError> {
        let of = |f: &&Feature| match f.quantity {
            Quantity::Characteristic { index, .. } => {
                let one = &self.plan.characteristics[index];
                f.name == size && matches!(one.kind, Kind::Size(_)) && one.elements == [element]
            }
            _ => false,
        };
        let name = self.plan.element_name(element);
        let Some(feature) = self.plan.features.iter().find(of) else {
            return Err(self.place.refuse(format!(
                "maximum_material = \"{size}\": no earlier feature of kind \"size\" of element \"{name}\" has this name; its limits give the maximum material size, so name one"
            )));
        };
        let Quantity::Characteristic { index, .. } = feature.quantity else {
            return Err(self.place.refuse("maximum_material names no size".into()));
        };
        let Kind::Size(which) = self.plan.characteristics[index].kind else {
            return Err(self.place.refuse("maximum_material names no size".into()));
        };
        let internal = match self.plan.elements.get(element).map(|e| &e.geometry) {
            Some(super::geometry::Geometry::Outline { internal, .. }) => *internal,
            Some(geometry) => geometry.is_internal(),
            None => true,
        };
        let [size_mm, least_mm] =
            if internal { [feature.lower, feature.upper] } else { [feature.upper, feature.lower] };
        Ok(MaximumMaterial { size_mm, least_mm, internal, index: which })
    }

    pub(super) fn measured(
        self,
        one: Characteristic,
        nominal: Option<f64>,
        deviations: [f64; 2],
        u_system: f64,
        unit: Unit,
    ) -> Result<Feature, PlanError> {
        let elements: Vec<Substitute> =
            one.elements.iter().map(|i| self.shape(*i)).collect::<Result<_, _>>()?;
        let found = match one.kind {
            Kind::Angle => nominal_angle_deg(&elements),
            _ => value_of(&one, &elements, &|v| Ok(*v)),
        };
        let found = found.map_err(|why| self.place.refuse(format!("at the nominal places: {why}")))?;
        let nominal = nominal.unwrap_or(found);
        let quantity =
            Quantity::Characteristic { index: self.plan.characteristics.len(), unit, one_sided: false };
        self.plan.characteristics.push(one);
        tolerated(&self.place, self.name, quantity, nominal, deviations, u_system)
    }

    pub(super) fn limited(
        self,
        one: Characteristic,
        limit_mm: f64,
        u_system: f64,
    ) -> Result<Feature, PlanError> {
        let limit = match one.kind {
            // At maximum material a tolerance of zero is meaningful.
            Kind::Position(Some(_)) => self.place.not_negative("limit_mm", limit_mm)?,
            _ => self.place.positive("limit_mm", limit_mm)?,
        };
        let index = self.plan.characteristics.len();
        let quantity = Quantity::Characteristic { index, unit: Unit::Mm, one_sided: true };
        self.plan.characteristics.push(one);
        tolerated(&self.place, self.name, quantity, 0.0, [0.0, limit], u_system)
    }
}
