//! From the clouds of each position to the report.

use nalgebra::Point3;

use super::certificate::{diameter, record, u_test_value_mm};
use super::conform::{coverage as coverage_rules, violations};
use super::elements::{Group, groups};
use super::patches::{coverage, representative};
use super::plan::{Artefact, DecisionRule, Limit, PositionPlan, TestPlan};
use super::result::{PositionValue, TestReport, Violation, Volume};
use super::rules::{CharacteristicRule, CloudOf, RuleSet, Statistic};
use super::summary::{Value, summarise, test_verdict};
use super::{AcceptanceError, at};
use crate::fit::{FitSettings, PlaneFit, SphereFit, centre_distance_mm, plane, sphere};
use fringe::cloud::Point;

/// Evaluates positions one after another; the clouds of one need not stay in memory.
#[derive(Debug)]
pub struct Evaluator<'a> {
    plan: &'a TestPlan,
    rules: &'a RuleSet,
    violations: Vec<Violation>,
    /// One list per characteristic of the rule set.
    values: Vec<Vec<Value>>,
    worst_registration_mm: Option<f64>,
    beside: usize,
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
            let of_lengths = matches!(one.statistic, Statistic::Spacing | Statistic::SpacingAndSize);
            if matches!(limit, Limit::Length(_)) && !of_lengths {
                return Err(AcceptanceError::Plan {
                    place: format!("limits, {symbol}"),
                    message: "grows with the length (a_mm, k_um_per_m), but this characteristic is no length error; \
                              give one number in mm"
                        .into(),
                });
            }
        }
        let violations = violations(plan, rules);
        let values = vec![Vec::new(); rules.characteristics.len()];
        let evaluator = Self { plan, rules, violations, values, worst_registration_mm: None, beside: 0 };
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
    /// Elements that are not found or not fitted; views that cannot be registered.
    pub fn add(&mut self, position: &PositionPlan, clouds: &[Vec<Point>]) -> Result<(), AcceptanceError> {
        let Some(artefact) = self.plan.artefact_of(position) else {
            return Err(AcceptanceError::Plan {
                place: format!("position \"{}\"", position.name),
                message: format!("names the artefact \"{}\", which is not there", position.artefact),
            });
        };
        let found = groups(self.plan, position, artefact, clouds)?;
        self.beside += found.beside;
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
        let place = format!("position \"{}\", {}", position.name, group.views.join(" + "));
        let settings = FitSettings {
            max_reject_fraction: self.plan.reject_fraction(self.rules),
            ..FitSettings::default()
        };
        let fitted = Fitted::new(artefact, group, &settings).map_err(|source| at(&place, source))?;
        if let (CloudOf::Registered, Fitted::Spheres(fits), [points]) =
            (group.cloud, &fitted, group.elements.as_slice())
        {
            let share = coverage(&fits[0], points);
            let volume = Volume::new(self.plan.volume.total_mm);
            self.violations.extend(coverage_rules(self.rules, &volume, &position.name, share));
        }
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

    /// The report; `conditions` is added to the plan's.
    ///
    /// # Errors
    /// Rules that the points break without `allow_reduced`.
    pub fn finish(mut self, conditions: Vec<(String, String)>) -> Result<TestReport, AcceptanceError> {
        self.refuse()?;
        self.add_sizes();
        let characteristics: Vec<_> = self
            .rules
            .characteristics
            .iter()
            .zip(&self.values)
            .filter_map(|(one, values)| summarise(one, values, self.plan))
            .collect();
        let mut all = self.conditions();
        all.extend(conditions);
        Ok(TestReport {
            rule_set: self.rules.id(),
            verdict: test_verdict(&characteristics),
            reduced: self.violations,
            conditions: all,
            sensor_volume: Volume::new(self.plan.volume.sensor_mm),
            total_volume: Volume::new(self.plan.volume.total_mm),
            artefacts: self.plan.artefacts.iter().map(record).collect(),
            characteristics,
        })
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
        let rule = match decision.rule {
            DecisionRule::Simple => "simple acceptance, as agreed".to_owned(),
            DecisionRule::Iso14253 => {
                format!("ISO 14253-1, guard band {} u of the test value", decision.guard_factor)
            }
        };
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
        list.extend(conditions.warm_up.clone().map(|text| ("warm-up", text)));
        list.extend([
            ("decision rule", rule),
            ("rejected fraction", format!("{rejected} % of the points of each fit, largest residuals first")),
            (
                "segmentation",
                format!(
                    "points within {} mm of the surface of calibrated size; {} points lie beside, within three times that",
                    segmentation.margin_mm, self.beside
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

/// The elements of a group, fitted.
enum Fitted {
    Spheres(Vec<SphereFit>),
    Plane(Box<PlaneFit>),
}

impl Fitted {
    fn new(artefact: &Artefact, group: &Group, settings: &FitSettings) -> Result<Self, crate::fit::FitError> {
        if let ([points], true) = (group.elements.as_slice(), artefact.diameters_mm.is_empty()) {
            return Ok(Self::Plane(Box::new(plane(points, settings)?)));
        }
        Ok(Self::Spheres(
            group.elements.iter().map(|points| sphere(points, settings)).collect::<Result<_, _>>()?,
        ))
    }

    fn form(&self, element: usize) -> Option<&crate::fit::Form> {
        match self {
            Self::Spheres(fits) => fits.get(element).map(|fit| &fit.form),
            Self::Plane(fit) => Some(&fit.form),
        }
    }
}

/// Values of one group.
struct Job<'a> {
    plan: &'a TestPlan,
    position: &'a PositionPlan,
    artefact: &'a Artefact,
    group: &'a Group,
    place: &'a str,
}

impl Job<'_> {
    fn values(&self, one: &CharacteristicRule, fitted: &Fitted) -> Result<Vec<Value>, AcceptanceError> {
        let form = |pick: &dyn Fn(&crate::fit::Form) -> f64| {
            fitted.form(0).map(|form| self.value(one.statistic, 0, pick(form), &[form])).into_iter().collect()
        };
        Ok(match (one.statistic, fitted) {
            (Statistic::FormRange, _) => form(&|f| f.form_range_mm),
            (Statistic::FormSigma, _) => form(&|f| f.form_sigma_mm),
            (Statistic::FormD95, _) => form(&|f| f.form_d95_mm),
            (Statistic::Size, Fitted::Spheres(fits)) => fits
                .iter()
                .take(1)
                .map(|fit| self.value(one.statistic, 0, self.size(fit), &[&fit.form]))
                .collect(),
            (Statistic::Form25 | Statistic::Size25, Fitted::Spheres(fits)) => {
                self.of_25(one.statistic, fits)?.into_iter().collect()
            }
            (Statistic::Spacing | Statistic::SpacingAndSize, Fitted::Spheres(fits)) => {
                self.spacings(one.statistic, fits)
            }
            (_, Fitted::Plane(_)) => Vec::new(),
        })
    }

    fn size(&self, fit: &SphereFit) -> f64 {
        fit.diameter_mm - diameter(0, self.artefact, &self.plan.conditions).value_mm
    }

    fn spacings(&self, statistic: Statistic, fits: &[SphereFit]) -> Vec<Value> {
        let Some((first, others)) = fits.split_first() else { return Vec::new() };
        others
            .iter()
            .zip(&self.artefact.spacings_mm)
            .enumerate()
            .map(|(index, (other, nominal))| {
                let calibrated =
                    super::certificate::at_test(*nominal, 0.0, self.artefact, &self.plan.conditions).value_mm;
                let error = centre_distance_mm(first, other).value - calibrated;
                let mut value = self.value(statistic, index, error, &[&first.form, &other.form]);
                value.shown.length_mm = Some(calibrated);
                if others.len() > 1 {
                    value.shown.position = format!("{} 1–{}", value.shown.position, index + 2);
                }
                value
            })
            .collect()
    }

    fn of_25(&self, statistic: Statistic, fits: &[SphereFit]) -> Result<Option<Value>, AcceptanceError> {
        let (Some(fit), Some(points)) = (fits.first(), self.group.elements.first()) else { return Ok(None) };
        let used: Vec<Point3<f64>> =
            points.iter().zip(&fit.residuals.used).filter(|(_, used)| **used).map(|(p, _)| *p).collect();
        let chosen = representative(fit, &used).map_err(|missing| AcceptanceError::NotFound {
            place: self.place.to_owned(),
            message: format!(
                "{missing} of the 25 directions of the sphere show no points: measure it from more sides"
            ),
        })?;
        let small = sphere(&chosen, &FitSettings::default()).map_err(|source| at(self.place, source))?;
        let value = if statistic == Statistic::Form25 { small.form.form_range_mm } else { self.size(&small) };
        Ok(Some(self.value(statistic, 0, value, &[&fit.form])))
    }

    fn value(&self, statistic: Statistic, length: usize, value: f64, forms: &[&crate::fit::Form]) -> Value {
        Value {
            shown: PositionValue {
                position: self.position.name.clone(),
                repeat: self.position.repeat,
                value,
                length_mm: None,
                limit: None,
                points: forms.iter().map(|form| form.points).sum(),
                rejected: forms.iter().map(|form| form.rejected).sum(),
                views: self.group.views.clone(),
            },
            u_mm: u_test_value_mm(statistic, length, self.artefact, &self.plan.conditions),
        }
    }
}
