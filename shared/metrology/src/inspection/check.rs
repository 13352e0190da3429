//! From the plan as written to the plan as meant: names become indices, degrees radians, deviations limits.

use nalgebra::Isometry3;

use super::cad_face::CadParts;
use super::check_characteristics::characteristic;
use super::check_datums::{Names, check_open_motions, datum_systems};
use super::check_elements::{Written, element};
use super::geometry::Geometry;
use super::joint::nominal_parts;
use super::nominal_surface::Surfaces;
use super::plan::{Datums, Element, Feature, PLAN_FORMAT, Plan, PlanError, Quantity};
use super::raw::{RawAlignment, RawElement, RawFeature, RawPlacement, RawPlan};
use super::references::Constructed;
use super::within::{Within, printable, tolerated, unique};

impl Plan {
    /// Checks a plan as it is written.
    ///
    /// # Errors
    /// See [`PlanError`].
    pub fn new(raw: RawPlan) -> Result<Self, PlanError> {
        Self::with_surfaces(raw, &Surfaces::new())
    }

    /// Checks a plan as it is written, with the meshes of the files that it names ([`RawPlan::surface_files`]).
    ///
    /// # Errors
    /// See [`PlanError`].
    pub fn with_surfaces(raw: RawPlan, surfaces: &Surfaces) -> Result<Self, PlanError> {
        Self::with_nominals(raw, surfaces, &CadParts::new())
    }

    /// As [`Self::with_surfaces`], with the elements of the CAD files whose faces the plan names.
    ///
    /// # Errors
    /// See [`PlanError`].
    pub fn with_nominals(raw: RawPlan, surfaces: &Surfaces, cad: &CadParts) -> Result<Self, PlanError> {
        if raw.format != PLAN_FORMAT {
            return Err(PlanError::Format(raw.format));
        }
        printable("plan", &raw.name)?;
        let within = Within("settings".into());
        raw.settings.cluster_mm.map(|edge| within.positive("cluster_mm", edge)).transpose()?;
        within.check("guard_factor", raw.settings.guard_factor, 0.0..=10.0, "0 … 10")?;
        let (elements, constructed) = elements(raw.element, surfaces, cad)?;
        let mut plan = Self {
            name: raw.name,
            settings: raw.settings,
            world_from_part: Isometry3::identity(),
            datums: None,
            elements,
            constructed,
            datum_systems: Vec::new(),
            characteristics: Vec::new(),
            features: Vec::new(),
            rims_left_out_px: None,
            viewpoints: Vec::new(),
        };
        check_constructed(&plan)?;
        plan.datum_systems = datum_systems(raw.datum_system, &plan)?;
        for written in raw.feature {
            let found = feature(written, &mut plan)?;
            plan.features.push(found);
        }
        unique("feature", plan.features.iter().map(|f| f.name.as_str()))?;
        if plan.elements.is_empty() {
            return Err(PlanError::Empty("element"));
        }
        if plan.features.is_empty() {
            return Err(PlanError::Empty("feature"));
        }
        check_open_motions(&plan)?;
        plan.datums = raw.alignment.map(|a| datums(&a, &Lookup(&plan.elements))).transpose()?;
        plan.world_from_part = placement(raw.placement)?;
        Ok(plan)
    }
}

/// Measured elements, and those made of others that stand before them.
fn elements(
    raw: Vec<RawElement>,
    surfaces: &Surfaces,
    cad: &CadParts,
) -> Result<(Vec<Element>, Vec<Constructed>), PlanError> {
    let (mut measured, mut made) = (Vec::new(), Vec::new());
    for one in raw {
        match element(one, surfaces, cad)? {
            Written::Measured(element) => measured.push(element),
            Written::Made(raw, construction) => made.push((raw, construction)),
        }
    }
    let mut names = Names::new(measured.iter().map(|e| e.name.as_str()));
    let mut constructed = Vec::with_capacity(made.len());
    for (raw, construction) in made {
        let place = Within(format!("element \"{}\"", raw.name));
        let elements = names.several(&place, "elements", &raw.elements)?;
        names.push(&raw.name);
        constructed.push(Constructed { name: raw.name, construction, elements });
    }
    unique("element", names.all())?;
    Ok((measured, constructed))
}

/// Elements made of others must exist where the elements are nominally.
fn check_constructed(plan: &Plan) -> Result<(), PlanError> {
    let parts = nominal_parts(plan);
    let freeform = |index: &&usize| {
        plan.elements.get(**index).is_some_and(|element| matches!(element.geometry, Geometry::Surface(_)))
    };
    for one in &plan.constructed {
        if let Some(index) = one.elements.iter().find(freeform) {
            let place = Within(format!("element \"{}\"", one.name));
            let name = plan.element_name(*index);
            return Err(place
                .refuse(format!("elements names \"{name}\", a freeform surface: it has a profile alone")));
        }
    }
    for (one, part) in plan.constructed.iter().zip(&parts[plan.elements.len()..]) {
        if let Err(why) = part {
            let place = Within(format!("element \"{}\"", one.name));
            return Err(place.refuse(format!("elements: at their nominal places: {why}")));
        }
    }
    Ok(())
}

/// Nominal pose of the part.
fn placement(raw: Option<RawPlacement>) -> Result<Isometry3<f64>, PlanError> {
    let Some(raw) = raw else { return Ok(Isometry3::identity()) };
    let place = Within("placement".into());
    for value in raw.translation_mm {
        place.coordinate("translation_mm", value)?;
    }
    fringe::geometry::camera::pose(raw.rotation, raw.translation_mm)
        .map_err(|error| PlanError::Part { place: place.0, message: error.to_string() })
}

/// Finds elements of a plan by name.
struct Lookup<'a>(&'a [Element]);

impl Lookup<'_> {
    fn find(
        &self,
        place: &Within,
        key: &'static str,
        kind: &'static str,
        name: &str,
    ) -> Result<usize, PlanError> {
        let fits = |e: &&Element| e.geometry.kind() == kind;
        self.0.iter().position(|e| e.name == name && fits(&e)).ok_or_else(|| {
            let known: Vec<&str> = self.0.iter().filter(fits).map(|e| e.name.as_str()).collect();
            let known = if known.is_empty() { "none".into() } else { known.join(", ") };
            PlanError::Reference { place: place.0.clone(), key, name: name.into(), kind, known }
        })
    }

    fn two(&self, place: &Within, kind: &'static str, names: &[String; 2]) -> Result<[usize; 2], PlanError> {
        let [a, b] = names;
        if a == b {
            let message =
                format!("elements names \"{a}\" twice: a value between an element and itself proves nothing");
            return Err(PlanError::Part { place: place.0.clone(), message });
        }
        Ok([self.find(place, "elements", kind, a)?, self.find(place, "elements", kind, b)?])
    }
}

fn feature(raw: RawFeature, plan: &mut Plan) -> Result<Feature, PlanError> {
    let elements = Lookup(&plan.elements);
    let within = |name: &str| Within(format!("feature \"{name}\""));
    match raw {
        RawFeature::SphereDiameter { name, element, nominal_mm, tolerance_mm, u_system_mm } => {
            let place = within(&name);
            let quantity = Quantity::SphereDiameter(elements.find(&place, "element", "sphere", &element)?);
            let nominal_mm = place.positive("nominal_mm", nominal_mm)?;
            tolerated(&place, name, quantity, nominal_mm, tolerance_mm, u_system_mm)
        }
        RawFeature::CentreDistance { name, elements: names, nominal_mm, tolerance_mm, u_system_mm } => {
            let place = within(&name);
            let quantity = Quantity::CentreDistance(elements.two(&place, "sphere", &names)?);
            let nominal_mm = place.positive("nominal_mm", nominal_mm)?;
            tolerated(&place, name, quantity, nominal_mm, tolerance_mm, u_system_mm)
        }
        RawFeature::PlaneFlatness { name, element, limit_mm, filter_mm, u_system_mm } => {
            let place = within(&name);
            let plane = elements.find(&place, "element", "plane", &element)?;
            let filter_mm = filter_mm.map(|edge| place.positive("filter_mm", edge)).transpose()?;
            let quantity = Quantity::PlaneFlatness { plane, filter_mm };
            let limit = place.positive("limit_mm", limit_mm)?;
            tolerated(&place, name, quantity, 0.0, [0.0, limit], u_system_mm)
        }
        RawFeature::PlaneDistance { name, elements: names, nominal_mm, tolerance_mm, u_system_mm } => {
            let place = within(&name);
            let quantity = Quantity::PlaneDistance(elements.two(&place, "plane", &names)?);
            tolerated(&place, name, quantity, nominal_mm, tolerance_mm, u_system_mm)
        }
        RawFeature::PlaneAngle {
            name,
            elements: names,
            supplement,
            nominal_deg,
            tolerance_deg,
            u_system_deg,
        } => {
            let place = within(&name);
            let planes = elements.two(&place, "plane", &names)?;
            place.angle_rad("nominal_deg", nominal_deg)?;
            let quantity = Quantity::PlaneAngle { planes, supplement };
            tolerated(&place, name, quantity, nominal_deg, tolerance_deg, u_system_deg)
        }
        RawFeature::HemisphereHeight { name, sphere, plane, nominal_mm, tolerance_mm, u_system_mm } => {
            let place = within(&name);
            let sphere = elements.find(&place, "sphere", "sphere", &sphere)?;
            let plane = elements.find(&place, "plane", "plane", &plane)?;
            let quantity = Quantity::HemisphereHeight { sphere, plane };
            tolerated(&place, name, quantity, nominal_mm, tolerance_mm, u_system_mm)
        }
        other => characteristic(other, plan),
    }
}

fn datums(raw: &RawAlignment, elements: &Lookup) -> Result<Datums, PlanError> {
    let place = Within("alignment".into());
    let [a, b] = &raw.line;
    let datums = Datums {
        plane: elements.find(&place, "plane", "plane", &raw.plane)?,
        line: [elements.find(&place, "line", "sphere", a)?, elements.find(&place, "line", "sphere", b)?],
        origin: elements.find(&place, "origin", "sphere", &raw.origin)?,
        search_mm: place.positive("search_mm", raw.search_mm)?,
        search_rad: place
            .check("search_deg", raw.search_deg, 0.0..=45.0, "an angle of 0 … 45°")?
            .to_radians(),
    };
    let center = |index: usize| elements.0[index].geometry.place();
    let Geometry::Plane { normal, .. } = &elements.0[datums.plane].geometry else {
        return Err(PlanError::Datum("the plane is none"));
    };
    let along = center(datums.line[1]) - center(datums.line[0]);
    let across = along - normal * along.dot(normal);
    // Below a tenth the turn about the normal would hang on the height of the spheres.
    if across.norm() <= 0.1 * along.norm() {
        return Err(PlanError::Datum(
            "the line runs along the plane's normal (or has no length); choose two spheres apart across it",
        ));
    }
    Ok(datums)
}
