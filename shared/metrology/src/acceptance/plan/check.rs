//! What must hold in a plan whatever its rules.

use super::{
    Artefact, LengthLimit, Limit, PositionPlan, RegisterBy, TEST_FORMAT, TestPlan, ViewPlan, Volumes,
};
use crate::acceptance::AcceptanceError;
use crate::acceptance::rules::Kind;

/// Fewest reference spheres that fix a motion.
const LEAST_REFERENCES: usize = 3;

impl TestPlan {
    /// Checks everything that needs no rules.
    ///
    /// # Errors
    /// Another format, numbers out of range, names that do not fit together.
    pub fn check(&self) -> Result<(), AcceptanceError> {
        if self.format != TEST_FORMAT {
            return Err(AcceptanceError::Format { found: self.format.clone(), reads: TEST_FORMAT });
        }
        self.check_numbers()?;
        for (index, artefact) in self.artefacts.iter().enumerate() {
            if self.artefacts[..index].iter().any(|other| other.id == artefact.id) {
                return Err(AcceptanceError::Twice { what: "artefact", name: artefact.id.clone() });
            }
            artefact.check()?;
        }
        if self.positions.is_empty() {
            return Err(fault("position", "the plan has none: nothing would be tested; add [[position]]"));
        }
        let mut sources: Vec<String> = Vec::new();
        for (index, position) in self.positions.iter().enumerate() {
            if self.positions[..index]
                .iter()
                .any(|p| (&p.name, p.repeat) == (&position.name, position.repeat))
            {
                let name = format!("{} repeat {}", position.name, position.repeat);
                return Err(AcceptanceError::Twice { what: "position", name });
            }
            if self.positions[..index]
                .iter()
                .any(|p| p.name == position.name && p.artefact != position.artefact)
            {
                let message = "its repeats name different artefacts; give each artefact positions of its own";
                return Err(fault(&format!("position \"{}\"", position.name), message));
            }
            self.check_position(position, &mut sources)?;
        }
        Ok(())
    }

    fn check_numbers(&self) -> Result<(), AcceptanceError> {
        let Self { conditions, volume, decision, segmentation, .. } = self;
        let place = |name: &str, key, value, limits| {
            Err(AcceptanceError::Value { place: name.to_owned(), key, value, limits })
        };
        volume.check()?;
        if !(-50.0..=100.0).contains(&conditions.temperature_c) {
            return place("conditions", "temperature_c", conditions.temperature_c, "-50 … 100 °C");
        }
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let not_negative = |value: f64| value >= 0.0 && value.is_finite();
        if !not_negative(conditions.u_temperature_k) {
            return place("conditions", "u_temperature_k", conditions.u_temperature_k, "0 or more");
        }
        if let Some(length) = conditions.lateral_resolution_mm.filter(|length| !positive(*length)) {
            return place("conditions", "lateral_resolution_mm", length, "above 0 mm");
        }
        let zero = [("u_temperature_k", conditions.u_temperature_k, LEAST_U_K)];
        check_zeros("conditions", &zero, conditions.zero_reason.as_deref())?;
        if !(not_negative(decision.guard_factor) && decision.guard_factor <= 10.0) {
            return place("decision", "guard_factor", decision.guard_factor, "0 … 10");
        }
        for (key, value) in [("margin_mm", segmentation.margin_mm), ("gap_mm", segmentation.gap_mm)] {
            if !(positive(value) && value <= 100.0) {
                return place("segmentation", key, value, "0 … 100 mm, zero excluded");
            }
        }
        if let Some(zone) = segmentation.zone_mm.filter(|z| !(*z >= segmentation.margin_mm && z.is_finite()))
        {
            return place("segmentation", "zone_mm", zone, "at least margin_mm");
        }
        if let Some(fraction) = self.reject_fraction.filter(|f| !(0.0..=0.5).contains(f)) {
            return place("plan", "reject_fraction", fraction, "0 … 0.5");
        }
        for (symbol, limit) in &self.limits {
            limit.check(&format!("limits, {symbol}"))?;
        }
        for (index, reference) in self.references.iter().enumerate() {
            if !positive(reference.diameter_mm) {
                return place(
                    &format!("reference {}", index + 1),
                    "diameter_mm",
                    reference.diameter_mm,
                    "above 0",
                );
            }
        }
        Ok(())
    }

    fn check_position(
        &self,
        position: &PositionPlan,
        sources: &mut Vec<String>,
    ) -> Result<(), AcceptanceError> {
        let place = format!("position \"{}\"", position.name);
        let Some(artefact) = self.artefact_of(position) else {
            let known: Vec<&str> = self.artefacts.iter().map(|a| a.id.as_str()).collect();
            let (name, known) = (position.artefact.clone(), known.join(", "));
            return Err(AcceptanceError::Unknown { place, key: "artefact", name, known });
        };
        if position.views.is_empty() {
            return Err(fault(&place, "has no [[position.view]]; add the recordings or clouds that show it"));
        }
        if position.register == RegisterBy::References {
            self.check_references(&place)?;
        }
        let needed = artefact.elements();
        for (index, view) in position.views.iter().enumerate() {
            let place = format!("{place}, view \"{}\"", view.name);
            if position.views[..index].iter().any(|other| other.name == view.name) {
                return Err(AcceptanceError::Twice {
                    what: "view",
                    name: format!("{}/{}", position.name, view.name),
                });
            }
            if view.recording.is_some() == view.cloud.is_some() {
                return Err(fault(&place, "name a recording or a cloud, one of them"));
            }
            if view.recording.is_some() && self.measurement.is_none() {
                return Err(fault(
                    &place,
                    "names a recording, but the plan has no [measurement] with rig and method",
                ));
            }
            // Counted twice, one measurement would pass for two positions.
            let source = view.plain_source();
            if sources.contains(&source) {
                return Err(fault(&place, &format!("{} is named by another view too", view.source())));
            }
            sources.push(source);
            view.check(&place, needed, position.register)?;
        }
        Ok(())
    }

    /// Reference spheres are distinguished by their diameters alone.
    fn check_references(&self, place: &str) -> Result<(), AcceptanceError> {
        if self.references.len() < LEAST_REFERENCES {
            let found = self.references.len();
            let message = format!(
                "registered by {found} reference spheres, needs at least {LEAST_REFERENCES}: add [[reference]]"
            );
            return Err(fault(place, &message));
        }
        let apart_mm = 2.0 * self.segmentation.margin_mm;
        let own = self.artefacts.iter().flat_map(|a| &a.diameters_mm).copied();
        for (index, reference) in self.references.iter().enumerate() {
            let others = self.references[..index].iter().map(|r| r.diameter_mm).chain(own.clone());
            if let Some(near) = others.into_iter().find(|d| (d - reference.diameter_mm).abs() < apart_mm) {
                let message = format!(
                    "reference spheres are distinguished by their diameters: {} and {near} mm differ by less than twice \
                     margin_mm, {apart_mm} mm",
                    reference.diameter_mm
                );
                return Err(fault(place, &message));
            }
        }
        Ok(())
    }
}

impl Limit {
    fn check(&self, place: &str) -> Result<(), AcceptanceError> {
        let value =
            |key, value, limits| Err(AcceptanceError::Value { place: place.to_owned(), key, value, limits });
        let positive = |value: f64| value > 0.0 && value.is_finite();
        match *self {
            Self::Constant(limit) if !positive(limit) => {
                value("limit", limit, "above 0 (mm; it holds for both signs)")
            }
            Self::Length(LengthLimit { a_mm, .. }) if !positive(a_mm) => value("a_mm", a_mm, "above 0"),
            Self::Length(LengthLimit { k_um_per_m: k, .. }) if !(k >= 0.0 && k.is_finite()) => {
                value("k_um_per_m", k, "0 or more")
            }
            Self::Length(LengthLimit { a_mm, b_mm: Some(b), .. }) if !(b >= a_mm && b.is_finite()) => {
                value("b_mm", b, "at least a_mm")
            }
            _ => Ok(()),
        }
    }
}

impl Volumes {
    fn check(&self) -> Result<(), AcceptanceError> {
        for (key, edges) in [("sensor_mm", self.sensor_mm), ("total_mm", self.total_mm)] {
            if let Some(value) = edges.iter().copied().find(|e| !(*e > 0.0 && e.is_finite())) {
                return Err(AcceptanceError::Value { place: "volume".into(), key, value, limits: "above 0" });
            }
        }
        if self.center_mm.iter().flatten().any(|v| !v.is_finite()) {
            return Err(fault("volume", "center_mm: three finite numbers, mm"));
        }
        let sorted = |mut edges: [f64; 3]| {
            edges.sort_unstable_by(f64::total_cmp);
            edges
        };
        let (sensor, total) = (sorted(self.sensor_mm), sorted(self.total_mm));
        match sensor.iter().zip(&total).find(|(sensor, total)| sensor > total) {
            None => Ok(()),
            Some(_) => Err(fault(
                "volume",
                &format!(
                    "sensor_mm = {:?} does not fit into total_mm = {:?}: one view cannot see more than all views together; \
                     correct one of them",
                    self.sensor_mm, self.total_mm
                ),
            )),
        }
    }
}

/// Below these nobody calibrates: lengths and forms, mm; temperatures, K; coefficients of expansion, 1/K.
const LEAST_U_MM: f64 = 1e-6;
const LEAST_U_K: f64 = 1e-4;
const LEAST_U_PER_K: f64 = 1e-10;

/// A standard uncertainty of 0 narrows the guard band to nothing, and so does one that no laboratory reaches: each needs a
/// reason. The third number of a value is the least that needs none.
fn check_zeros(
    place: &str,
    values: &[(&str, f64, f64)],
    reason: Option<&str>,
) -> Result<(), AcceptanceError> {
    if reason.is_some_and(|text| !text.trim().is_empty()) {
        return Ok(());
    }
    let Some((key, value, least)) = values.iter().find(|(_, value, least)| value < least) else {
        return Ok(());
    };
    let states = if *value == 0.0 {
        "states that there is none".to_owned()
    } else {
        format!("is less than any laboratory reaches ({least:e})")
    };
    Err(fault(
        place,
        &format!("{key} = {value} {states}: give zero_reason = \"why\", or the value of the certificate"),
    ))
}

impl ViewPlan {
    fn check(&self, place: &str, needed: usize, register: RegisterBy) -> Result<(), AcceptanceError> {
        if !self.near_mm.is_empty() && self.near_mm.len() != needed {
            let found = self.near_mm.len();
            return Err(fault(
                place,
                &format!("near_mm has {found} balls, the artefact has {needed} elements"),
            ));
        }
        for (key, balls) in [("near_mm", &self.near_mm), ("exclude_mm", &self.exclude_mm)] {
            if let Some(ball) = balls.iter().find(|b| b.iter().any(|v| !v.is_finite()) || b[3] <= 0.0) {
                let message = format!("{key} = {ball:?}: four finite numbers x, y, z, r, r above 0");
                return Err(fault(place, &message));
            }
        }
        if self.near_mm.is_empty() && needed > 2 {
            let message = format!(
                "needs near_mm: the {needed} spheres of its artefact have the same size, so that their order is unknown"
            );
            return Err(fault(place, &message));
        }
        let Some(rows) = &self.transform else { return Ok(()) };
        if register == RegisterBy::References {
            return Err(fault(
                place,
                "has a transform, but its position is registered by references; drop one",
            ));
        }
        let rotation = nalgebra::Matrix3::from_fn(|r, c| rows[r][c]);
        let off = (rotation * rotation.transpose() - nalgebra::Matrix3::identity()).amax();
        let rigid = off <= 1e-6 && rotation.determinant() > 0.0;
        if !rigid || rows.iter().any(|row| !row[3].is_finite()) {
            return Err(fault(
                place,
                "transform: is no rigid motion; its left three columns must be a rotation within 1e-6",
            ));
        }
        Ok(())
    }
}

impl Artefact {
    fn check(&self) -> Result<(), AcceptanceError> {
        let place = format!("artefact \"{}\"", self.id);
        let (diameters, spacings) = (self.diameters_mm.len(), self.spacings_mm.len());
        let fits = match self.kind {
            Kind::Sphere => diameters == 1 && spacings == 0 && self.size_mm.is_none(),
            Kind::BallBar => diameters >= 2 && spacings == diameters - 1 && self.size_mm.is_none(),
            Kind::Plane => diameters == 0 && spacings == 0 && self.size_mm.is_some(),
        };
        if !fits {
            let message = "a sphere has one of diameters_mm; a ball-bar n ≥ 2 of diameters_mm and n − 1 of spacings_mm \
                           (from the first sphere); a plane size_mm";
            return Err(fault(&place, message));
        }
        if self.id.trim().is_empty() || self.certificate.trim().is_empty() {
            return Err(fault(&place, "id and certificate must not be empty: a report names them"));
        }
        let lengths = self.diameters_mm.iter().chain(&self.spacings_mm).chain(self.size_mm.iter().flatten());
        if let Some(bad) = lengths.copied().find(|v| !(*v > 0.0 && v.is_finite())) {
            return Err(AcceptanceError::Value { place, key: "a length", value: bad, limits: "above 0 mm" });
        }
        self.check_uncertainties(&place)?;
        let (expansion, at) = (self.expansion_per_k, self.calibrated_at_c);
        if !(-1e-3..=1e-3).contains(&expansion) {
            return Err(AcceptanceError::Value {
                place,
                key: "expansion_per_k",
                value: expansion,
                limits: "-1e-3 … 1e-3 1/K",
            });
        }
        if !(-50.0..=100.0).contains(&at) {
            return Err(AcceptanceError::Value {
                place,
                key: "calibrated_at_c",
                value: at,
                limits: "-50 … 100 °C",
            });
        }
        Ok(())
    }
}

impl Artefact {
    /// Uncertainties of the certificate: all there, none negative, none 0 without a reason.
    fn check_uncertainties(&self, place: &str) -> Result<(), AcceptanceError> {
        let needed = |key: &str, value: Option<f64>, of: &str| {
            value.ok_or_else(|| {
                let message = format!(
                    "{key} is missing: write {key} = 0.0005, the standard uncertainty (k = 1) of {of} from its certificate, \
                     mm; 0 needs zero_reason = \"why\""
                );
                fault(place, &message)
            })
        };
        let mut amounts = vec![
            ("form_mm", self.form_mm, LEAST_U_MM),
            ("u_form_mm", self.u_form_mm, LEAST_U_MM),
            ("u_expansion_per_k", self.u_expansion_per_k, LEAST_U_PER_K),
        ];
        if self.kind != Kind::Plane {
            let u = needed("u_diameter_mm", self.u_diameter_mm, "a diameter")?;
            amounts.push(("u_diameter_mm", u, LEAST_U_MM));
        }
        if self.kind == Kind::BallBar {
            let u = needed("u_spacing_mm", self.u_spacing_mm, "a sphere spacing")?;
            amounts.push(("u_spacing_mm", u, LEAST_U_MM));
        }
        let others = [
            ("rod_diameter_mm", self.rod_diameter_mm),
            ("u_diameter_mm", self.u_diameter_mm),
            ("u_spacing_mm", self.u_spacing_mm),
        ];
        let others = others.iter().filter_map(|(key, value)| Some((*key, (*value)?)));
        for (key, value) in amounts.iter().map(|(key, value, _)| (*key, *value)).chain(others) {
            if !(value >= 0.0 && value.is_finite()) {
                let place = place.to_owned();
                return Err(AcceptanceError::Value { place, key, value, limits: "0 or more" });
            }
        }
        check_zeros(place, &amounts, self.zero_reason.as_deref())
    }
}

fn fault(place: &str, message: &str) -> AcceptanceError {
    AcceptanceError::Plan { place: place.to_owned(), message: message.to_owned() }
}
