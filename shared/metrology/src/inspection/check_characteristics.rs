//! Geometrical characteristics and datum systems of a plan, from as written to as meant.

use nalgebra::Vector3;

use super::characteristic::{Characteristic, Kind, MaximumMaterial};
use super::criterion::Criterion;
use super::datum::{carried, fix};
use super::joint::{Part, nominal_parts};
use super::location::{largest_offset_mm, nominal_angle_deg, value_of};
use super::plan::{Feature, Plan, PlanError, Quantity, Unit};
use super::raw::RawFeature;
use super::raw_features::{RawDatum, RawDatumSystem, RawForm, RawOrientation, RawProfile, SizeName};
use super::references::DatumSystem;
use super::substitute::{Shape, Substitute};
use super::within::{Within, tolerated, unique};

/// Sine of the angle by which nominal directions may miss what a characteristic says of them: digits of the plan.
const NOMINAL_SINE: f64 = 1e-4;

/// How far a nominal element may lie from its datum where they are meant to coincide, mm.
const NOMINAL_MM: f64 = 1e-3;

/// Names of all elements, in the order of their indices.
pub(super) struct Names(Vec<String>);

impl Names {
    /// Names of the measured elements.
    pub fn new<'a>(names: impl Iterator<Item = &'a str>) -> Self {
        Self(names.map(str::to_owned).collect())
    }

    /// Of all elements of a plan.
    fn of(plan: &Plan) -> Self {
        let made = plan.constructed.iter().map(|c| c.name.as_str());
        Self::new(plan.elements.iter().map(|e| e.name.as_str()).chain(made))
    }

    /// Takes in a further name.
    pub fn push(&mut self, name: &str) {
        self.0.push(name.to_owned());
    }

    /// All names in their order.
    pub fn all(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(String::as_str)
    }

    fn one(&self, place: &Within, key: &'static str, name: &str) -> Result<usize, PlanError> {
        self.0.iter().position(|n| n == name).ok_or_else(|| PlanError::Reference {
            place: place.0.clone(),
            key,
            name: name.into(),
            kind: "measured or earlier",
            known: if self.0.is_empty() { "none".into() } else { self.0.join(", ") },
        })
    }

    /// Different names as indices.
    pub fn several(
        &self,
        place: &Within,
        key: &'static str,
        names: &[String],
    ) -> Result<Vec<usize>, PlanError> {
        let mut found = Vec::with_capacity(names.len());
        for name in names {
            let index = self.one(place, key, name)?;
            if found.contains(&index) {
                return Err(
                    place.refuse(format!("{key} names \"{name}\" twice: an element and itself fix nothing"))
                );
            }
            found.push(index);
        }
        if found.is_empty() {
            return Err(place.refuse(format!("{key} is empty; name at least one element")));
        }
        Ok(found)
    }
}

/// Checks the datum systems.
pub(super) fn datum_systems(raw: Vec<RawDatumSystem>, plan: &Plan) -> Result<Vec<DatumSystem>, PlanError> {
    let names = Names::of(plan);
    let mut systems = Vec::with_capacity(raw.len());
    for system in raw {
        let place = Within(format!("datum_system \"{}\"", system.name));
        let mut steps = Vec::new();
        for datum in &system.datums {
            steps.push(match datum {
                RawDatum::One(name) => vec![names.one(&place, "datums", name)?],
                RawDatum::Common(list) => names.several(&place, "datums", list)?,
            });
        }
        let mut all: Vec<usize> = steps.iter().flatten().copied().collect();
        all.sort_unstable();
        if let Some(twice) = all.windows(2).find(|w| w[0] == w[1]) {
            let name = plan.element_name(twice[0]);
            return Err(
                place.refuse(format!("datums names \"{name}\" twice: it fixes nothing the second time"))
            );
        }
        if steps.is_empty() {
            return Err(place.refuse("datums is empty; name at least one element".into()));
        }
        systems.push(DatumSystem { name: system.name, steps });
    }
    unique("datum system", systems.iter().map(|s| s.name.as_str()))?;
    Ok(systems)
}

/// What the checks of a feature look at.
struct Checked<'p> {
    plan: &'p mut Plan,
    names: Names,
    nominal: Vec<Part>,
    place: Within,
    name: String,
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
            checked.profile("surface-profile", &r, "sphere, plane, cylinder, cone or torus")
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

fn plain(name: &'static str, kind: Kind, elements: Vec<usize>) -> Characteristic {
    Characteristic { name, kind, elements, datums: None, filter_mm: None, zone_direction: None }
}

impl Checked<'_> {
    fn element(&self, name: &str) -> Result<usize, PlanError> {
        self.names.one(&self.place, "element", name)
    }

    fn shape(&self, index: usize) -> Result<Substitute, PlanError> {
        self.nominal[index].clone().map_err(|why| self.place.refuse(why))
    }

    fn element_of(&self, name: &str, wanted: &str, fits: impl Fn(Shape) -> bool) -> Result<usize, PlanError> {
        let index = self.element(name)?;
        let shape = self.shape(index)?.shape;
        if fits(shape) {
            return Ok(index);
        }
        Err(self.place.refuse(format!("element names \"{name}\", a {}; name a {wanted}", shape.words())))
    }

    fn two(&self, names: &[String; 2]) -> Result<Vec<usize>, PlanError> {
        self.names.several(&self.place, "elements", names)
    }

    /// The datum system of a name, or that of one element.
    fn datums(&mut self, name: &str, toleranced: &[usize]) -> Result<usize, PlanError> {
        let known = self.plan.datum_systems.iter().position(|s| s.name == name);
        let system = if let Some(known) = known {
            known
        } else {
            let Some(index) = self.names.0.iter().position(|n| n == name) else {
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
        if let Some(own) = toleranced.iter().find(|i| steps.iter().flatten().any(|s| s == *i)) {
            let own = self.plan.element_name(*own);
            return Err(self.place.refuse(format!(
                "datums \"{name}\" hold \"{own}\", which is toleranced: a deviation from itself is none; take it out"
            )));
        }
        Ok(system)
    }

    fn zone_direction(&self, given: Option<[f64; 3]>) -> Result<Option<Vector3<f64>>, PlanError> {
        given.map(|v| self.place.unit("zone_direction", v)).transpose()
    }

    fn filter(&self, given: Option<f64>) -> Result<Option<f64>, PlanError> {
        given.map(|edge| self.place.positive("filter_mm", edge)).transpose()
    }

    fn size_index(&self, index: usize, name: Option<SizeName>) -> Result<usize, PlanError> {
        use SizeName::{Diameter, Length, RingDiameter, TubeDiameter, Width};
        let shape = self.shape(index)?.shape;
        let found = match (shape, name) {
            (Shape::Sphere | Shape::Cylinder | Shape::Circle | Shape::Cone, None | Some(Diameter)) => Some(0),
            (Shape::Torus, Some(RingDiameter)) | (Shape::Oblong, Some(Length)) => Some(0),
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
    fn material(&self, element: usize, size: &str) -> Result<MaximumMaterial, PlanError> {
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

    fn measured(
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

    fn limited(self, one: Characteristic, limit_mm: f64, u_system: f64) -> Result<Feature, PlanError> {
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

    fn form(
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
    fn with_points(&self, index: usize, name: &str) -> Result<(), PlanError> {
        if index < self.plan.elements.len() {
            return Ok(());
        }
        Err(self
            .place
            .refuse(format!("element \"{name}\" is made of others and has no points; name a measured one")))
    }

    fn orientation(mut self, name: &'static str, raw: &RawOrientation) -> Result<Feature, PlanError> {
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
    fn nominal_angle(&self, name: &str, index: usize, datums: usize) -> Result<(), PlanError> {
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
    fn coincident(
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

    fn profile(mut self, name: &'static str, raw: &RawProfile, wanted: &str) -> Result<Feature, PlanError> {
        let line = name == "line-profile";
        let index = self.element(&raw.element)?;
        self.with_points(index, &raw.element)?;
        let kind = self.plan.elements[index].geometry.kind();
        let fits = if line {
            kind == "line"
        } else {
            matches!(kind, "sphere" | "plane" | "cylinder" | "cone" | "torus")
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

    fn runout(
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

/// Refuses characteristics that depend on a motion which their datums leave open.
pub(super) fn check_open_motions(plan: &Plan) -> Result<(), PlanError> {
    let nominal = nominal_parts(plan);
    for feature in &plan.features {
        let Quantity::Characteristic { index, .. } = feature.quantity else { continue };
        let one = &plan.characteristics[index];
        let (Some(system), Kind::Position(_) | Kind::Profile) = (one.datums, &one.kind) else {
            continue;
        };
        let place = Within(format!("feature \"{}\"", feature.name));
        let system = &plan.datum_systems[system];
        let steps: Result<Vec<Vec<Substitute>>, String> =
            system.steps.iter().map(|step| super::joint::pick(&nominal, step)).collect();
        let steps = steps.map_err(|why| place.refuse(why))?;
        let frame = fix(&steps, &steps).map_err(|why| place.refuse(why))?;
        let element = nominal[one.elements[0]].clone().map_err(|why| place.refuse(why))?;
        for motion in &frame.open {
            let there = carried(&element, &frame.motion(&motion.map(|m| 1e-3 * m)));
            let turned = (there.direction - element.direction).norm() * frame.extent_mm;
            let flat = if element.shape == Shape::Plane { turned } else { 0.0 };
            let moved = largest_offset_mm(one, &element, &there).max(flat);
            if moved > 1e-5 {
                return Err(place.refuse(format!(
                    "datums {} leave open: {}; the {} of \"{}\" depends on it; add a datum that fixes it",
                    system.letters(&|i| plan.element_name(i)),
                    frame.open_words(),
                    one.name,
                    plan.element_name(one.elements[0])
                )));
            }
        }
    }
    Ok(())
}
