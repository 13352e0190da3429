//! From the clouds of each position to the report.

use nalgebra::Point3;

use super::arrangement::{Arrangement, Placed};
use super::certificate::record;
use super::conform::{measured, violations};
use super::elements::{Group, groups};
use super::fitted::Fitted;
use super::patches::coverage;
use super::plan::{Artefact, Limit, PositionPlan, TestPlan};
use super::result::{Input, LateralResolution, TestReport, Violation, Volume, decision_words};
use super::rules::{CharacteristicRule, CloudOf, Quantity, RuleSet, Statistic};
use super::summary::{Value, summarise};
use super::values::Job;
use super::{AcceptanceError, at};
use crate::fit::FitSettings;
use crate::verdict::Verdict;
use fringe::cloud::Point;

/// Standard deviation of residuals below which nobody measured, mm.
const LEAST_SCATTER_MM: f64 = 1e-6;

/// Evaluates positions one after another; the clouds of one need not stay in memory.
#[derive(Debug)]
pub struct Evaluator<'a> {
    plan: &'a TestPlan,
    rules: &'a RuleSet,
    violations: Vec<Violation>,
    /// One list per characteristic of the rule set.
    values: Vec<Vec<Value>>,
    arrangement: Arrangement,
    worst_registration_mm: Option<f64>,
    elsewhere: usize,
    excluded: usize,
}

impl<'a> Evaluator<'a> {
    /// Holds the plan against the rules.
    ///
    /// # Errors
    /// Rules that the plan breaks without `allow_reduced`, or limits of characteristics that the rule set does not have.
    pub fn new(plan: &'a TestPlan, rules: &'a RuleSet) -> Result<Self, AcceptanceError> {
        for (symbol, limit) in &plan.limits {
            let Some(one) = rules.characteristics.iter().find(|one| one.symbol == *symbol) else {
                let known: Vec<&str> = rules.characteristics.iter().map(|one| one.symbol.as_str()).collect();
                return Err(AcceptanceError::Unknown {
                    place: "limits".into(),
                    key: "a key",
                    name: symbol.clone(),
                    known: known.join(", "),
                });
            };
            if matches!(limit, Limit::Length(_)) && !one.statistic.of_length() {
                return Err(AcceptanceError::Plan {
                    place: format!("limits, {symbol}"),
                    message: "grows with the length (a_mm, k_um_per_m), but this characteristic is no length error; \
                              give one number in mm"
                        .into(),
                });
            }
        }
        super::retest::check(plan, rules)?;
        let evaluator = Self {
            plan,
            rules,
            violations: violations(plan, rules),
            values: vec![Vec::new(); rules.characteristics.len()],
            arrangement: Arrangement::default(),
            worst_registration_mm: None,
            elsewhere: 0,
            excluded: 0,
        };
        evaluator.refuse()?;
        Ok(evaluator)
    }

    fn refuse(&self) -> Result<(), AcceptanceError> {
        if self.plan.allow_reduced || self.violations.is_empty() {
            return Ok(());
        }
        Err(AcceptanceError::Rules(self.violations.clone()))
    }

    /// Adds a position: the cloud of each of its views, in their order.
    ///
    /// # Errors
    /// A measurement that counts twice, elements that are not found or not fitted, a form that reaches the margin; views that
    /// cannot be registered.
    pub fn add(&mut self, position: &PositionPlan, clouds: &[Vec<Point>]) -> Result<(), AcceptanceError> {
        let Some(artefact) = self.plan.artefact_of(position) else {
            return Err(AcceptanceError::Plan {
                place: format!("position \"{}\"", position.name),
                message: format!("names the artefact \"{}\", which is not there", position.artefact),
            });
        };
        for (view, cloud) in position.views.iter().zip(clouds) {
            let place =
                format!("position \"{}\" repeat {}, view \"{}\"", position.name, position.repeat, view.name);
            if !cloud.is_empty() {
                self.arrangement.cloud(&place, cloud)?;
            }
        }
        let found = groups(self.plan, position, artefact, clouds)?;
        self.elsewhere += found.elsewhere;
        self.worst_registration_mm = match (self.worst_registration_mm, found.registration_rms_mm) {
            (Some(worst), Some(rms)) => Some(worst.max(rms)),
            (worst, rms) => worst.or(rms),
        };
        for group in &found.groups {
            self.add_group(position, artefact, group)?;
        }
        Ok(())
    }

    fn add_group(
        &mut self,
        position: &PositionPlan,
        artefact: &Artefact,
        group: &Group,
    ) -> Result<(), AcceptanceError> {
        let place =
            format!("position \"{}\" repeat {}, {}", position.name, position.repeat, group.views.join(" + "));
        let settings = FitSettings {
            max_reject_fraction: self.plan.reject_fraction(self.rules),
            ..FitSettings::default()
        };
        let fitted = Fitted::new(artefact, group, &settings).map_err(|source| at(&place, source))?;
        fitted.check(&place, artefact, self.plan.segmentation.margin_mm)?;
        match group.cloud {
            CloudOf::Pair => {}
            CloudOf::View => self.add_view(&place, artefact, group, &fitted)?,
            CloudOf::Registered => self.arrangement.place(Placed {
                position: position.name.clone(),
                kind: artefact.kind,
                centres: fitted.centres(artefact),
            }),
        }
        self.cover(&place, artefact, group, &fitted);
        for (index, one) in self.rules.characteristics.iter().enumerate() {
            if one.artefact != artefact.kind || one.cloud != group.cloud {
                continue;
            }
            let job = Job { plan: self.plan, position, artefact, group, place: &place };
            let values = job.values(one, &fitted)?;
            self.values[index].extend(values);
        }
        Ok(())
    }

    /// What a view alone shows: points that are no copy, that scatter as measured ones do, and of which few are excluded.
    fn add_view(
        &mut self,
        place: &str,
        artefact: &Artefact,
        group: &Group,
        fitted: &Fitted,
    ) -> Result<(), AcceptanceError> {
        self.excluded += group.excluded;
        self.arrangement.forms(place, fitted.forms())?;
        for points in &group.elements {
            self.arrangement.points(place, points)?;
        }
        let volume = Volume::new(self.plan.volume.total_mm);
        let quantity = (artefact.kind, Quantity::ExcludedShare);
        self.violations.extend(measured(self.rules, &volume, quantity, place, group.excluded_share));
        let least = fitted.forms().iter().map(|form| form.form_sigma_mm).fold(f64::INFINITY, f64::min);
        if least <= LEAST_SCATTER_MM && !self.plan.conditions.simulated {
            let rule = "scatter of a measurement".to_owned();
            let text = format!(
                "{rule}: {place}: the points lie on a perfect element (standard deviation {least:.1e} mm): no instrument \
                 measures so; write simulated = true in [conditions] if they were computed"
            );
            let (required, unit) = (LEAST_SCATTER_MM, "mm".to_owned());
            self.violations.push(Violation { rule, required, actual: least, unit, text });
        }
        Ok(())
    }

    /// Compares how much of each sphere the points cover with the rules, for the clouds by which the rule set decides.
    fn cover(&mut self, place: &str, artefact: &Artefact, group: &Group, fitted: &Fitted) {
        let decides = |one: &CharacteristicRule| {
            one.decides && one.artefact == artefact.kind && one.cloud == group.cloud
        };
        let Fitted::Spheres(fits) = fitted else { return };
        if !self.rules.characteristics.iter().any(decides) {
            return;
        }
        let volume = Volume::new(self.plan.volume.total_mm);
        for (index, (fit, points)) in fits.iter().zip(&group.elements).enumerate() {
            let used: Vec<Point3<f64>> =
                points.iter().zip(&fit.residuals.used).filter(|(_, used)| **used).map(|(p, _)| *p).collect();
            let what =
                if fits.len() > 1 { format!("{place}, sphere {}", index + 1) } else { place.to_owned() };
            let share = coverage(fit, &used);
            self.violations.extend(measured(
                self.rules,
                &volume,
                (artefact.kind, Quantity::Coverage),
                &what,
                share,
            ));
        }
    }

    /// The report; `conditions` is added to those of the plan, `inputs` are what was read.
    ///
    /// # Errors
    /// Rules that the points break without `allow_reduced`.
    pub fn finish(
        mut self,
        conditions: Vec<(String, String)>,
        inputs: Vec<Input>,
    ) -> Result<TestReport, AcceptanceError> {
        self.violations.extend(self.arrangement.violations(self.plan, self.rules));
        self.add_sizes();
        self.not_measured();
        self.refuse()?;
        let characteristics: Vec<_> = self
            .rules
            .characteristics
            .iter()
            .zip(&self.values)
            .filter_map(|(one, values)| summarise(one, values, self.plan))
            .collect();
        let mut all = self.conditions();
        all.extend(conditions);
        let mut report = TestReport {
            rule_set: self.rules.id(),
            verdict: Verdict::Indeterminate,
            guard_factor: self.plan.decision.factor(),
            simulated: self.plan.conditions.simulated,
            inputs,
            reduced: self.violations,
            conditions: all,
            lateral_resolution: self.plan.conditions.lateral_resolution_mm.map(|step_mm| LateralResolution {
                step_mm,
                step_across_mm: None,
                hidden_step_mm: None,
                source: "stated by the operator".to_owned(),
            }),
            sensor_volume: Volume::new(self.plan.volume.sensor_mm),
            total_volume: Volume::new(self.plan.volume.total_mm),
            artefacts: self.plan.artefacts.iter().map(record).collect(),
            characteristics,
        };
        report.verdict = report.verdict_of_characteristics();
        Ok(report)
    }

    /// A characteristic that decides and of which there is no value.
    fn not_measured(&mut self) {
        let rules = self.rules.characteristics.iter().zip(&self.values);
        for (one, _) in rules.filter(|(one, values)| one.decides && values.is_empty()) {
            let text = format!(
                "{} ({}) was not measured: add positions of a {}",
                one.symbol,
                one.name,
                one.artefact.name()
            );
            let rule = "characteristics that decide".to_owned();
            self.violations.push(Violation { rule, required: 1.0, actual: 0.0, unit: "values".into(), text });
        }
    }

    /// Adds to each spacing error the size error, of all positions, that makes it worst.
    fn add_sizes(&mut self) {
        let rules = &self.rules.characteristics;
        for (index, one) in rules.iter().enumerate().filter(|(_, c)| c.statistic == Statistic::SpacingAndSize)
        {
            let size = rules.iter().position(|c| c.statistic == Statistic::Size && c.cloud == one.cloud);
            let sizes = size.map_or(&[][..], |size| &self.values[size]);
            let worst = |sign: f64| {
                sizes.iter().max_by(|a, b| (sign * a.shown.value).total_cmp(&(sign * b.shown.value)))
            };
            let (Some(largest), Some(smallest)) = (worst(1.0).cloned(), worst(-1.0).cloned()) else {
                // Without a size it would be the spacing error under another name.
                self.values[index].clear();
                continue;
            };
            for value in &mut self.values[index] {
                let sums = [&largest, &smallest].map(|s| (value.shown.value + s.shown.value, s.u_mm));
                let (sum, u_mm) = if sums[1].0.abs() > sums[0].0.abs() { sums[1] } else { sums[0] };
                value.shown.value = sum;
                value.u_mm = (value.u_mm * value.u_mm + u_mm * u_mm).sqrt();
            }
        }
    }

    fn conditions(&self) -> Vec<(String, String)> {
        let TestPlan { conditions, decision, segmentation, .. } = self.plan;
        let rule = decision_words(decision.factor());
        let rejected = 100.0 * self.plan.reject_fraction(self.rules);
        let mut list = vec![("test", self.plan.name.clone())];
        list.extend(conditions.instrument.clone().map(|text| ("instrument", text)));
        list.extend([
            ("operator", conditions.operator.clone()),
            ("date", conditions.date.clone()),
            (
                "temperature",
                format!(
                    "{} °C, standard uncertainty {} K",
                    conditions.temperature_c, conditions.u_temperature_k
                ),
            ),
            ("operating mode", conditions.operating_mode.clone()),
        ]);
        list.extend(conditions.zero_reason.clone().map(|text| ("temperature without uncertainty", text)));
        if conditions.simulated {
            list.push(("simulated", "yes: no instrument was tested".to_owned()));
        }
        list.extend(conditions.warm_up.clone().map(|text| ("warm-up", text)));
        list.extend(
            conditions.cloud_filters.clone().map(|text| ("left out of the clouds before this test", text)),
        );
        let views = || self.plan.positions.iter().flat_map(|position| &position.views);
        let (all, moved) = (views().count(), views().filter(|view| view.transform.is_some()).count());
        if moved > 0 {
            let text = format!("{moved} of {all} views stand where a transform of the plan puts them");
            list.push(("places of views", text));
        }
        list.extend([
            ("decision rule", rule),
            ("rejected fraction", format!("{rejected} % of the points of each fit, largest residuals first")),
            (
                "points of the artefact",
                format!(
                    "all within {} of a surface and all inside a sphere, {} excluded by the plan (stem, rod, fixture); {} points of \
                     other bodies; form deviations below {} mm can be evaluated",
                    segmentation.zone_mm.map_or("its radius".to_owned(), |zone| format!("{zone} mm")),
                    self.excluded,
                    self.elsewhere,
                    segmentation.margin_mm
                ),
            ),
        ]);
        if let Some(rms) = self.worst_registration_mm {
            list.push((
                "registration",
                format!("by reference spheres; worst rms of their centres {rms:.4} mm"),
            ));
        }
        list.into_iter().map(|(label, text)| (label.to_owned(), text)).collect()
    }
}
