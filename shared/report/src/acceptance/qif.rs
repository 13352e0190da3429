//! QIF 3.0 results (ISO 23952): definitions, nominals, items and measurements of all characteristics.
//!
//! The values of an acceptance test are errors, nominally zero, not sizes: a range of radial distances is a QIF sphericity,
//! every other error a user-defined linear characteristic with target 0 and the limits ±MPE, named and described as in the
//! report. Each characteristic has an item for its worst value, with the verdict over all positions, and one a position, with
//! its own. A limit that differs with the length is no tolerance of one definition: the description states it. `combinedUncertainty` is the standard uncertainty, half of U (k = 2). No time stamp: no clock is read; the
//! id of the document comes from the SHA-256 of the master.

use super::words::{differing_limits, verdict_word};
use super::xml::{Xml, clean};
use metrology::acceptance::{Characteristic, TestReport};
use metrology::verdict::Verdict;
use quick_xml::events::{BytesStart, BytesText, Event};

/// The QIF names of a kind of characteristic.
const SPHERICITY: &str = "Sphericity";
const LINEAR: &str = "UserDefinedLinear";

/// Symbols that are ranges of radial distances from a sphere.
const RANGES: [&str; 2] = ["PF_range", "P_Form.Sph.1x25"];

/// The whole document, UTF-8.
pub fn render(report: &TestReport, sha256: &str) -> Vec<u8> {
    let plan = Plan::new(report);
    let mut xml = Xml::document();
    let last = plan.last.to_string();
    let root =
        [("xmlns", "http://qifstandards.org/xsd/qif3"), ("idMax", last.as_str()), ("versionQIF", "3.0.0")];
    xml.within("QIFDocument", &root, |xml| {
        xml.leaf("QPId", &uuid(sha256));
        header(xml, report);
        xml.list("StandardsDefinitions", 1, |xml| standard(xml, report));
        units(xml);
        xml.within("Characteristics", &[], |xml| {
            xml.leaf("FormalStandardId", STANDARD_ID);
            definitions(xml, &plan);
        });
        xml.within("Results", &[], |xml| {
            xml.list("MeasurementResultsSet", 1, |xml| results(xml, report, &plan));
        });
    });
    xml.into_bytes()
}

const STANDARD_ID: &str = "1";
const RESULTS_ID: &str = "2";
/// First of the numbers of characteristics.
const FIRST_ID: usize = 3;

/// One thing measured: the worst value or that of a position.
struct Item {
    name: String,
    value: f64,
    expanded_u: Option<f64>,
    status: &'static str,
    id: usize,
    measurement_id: usize,
}

struct Entry<'a> {
    one: &'a Characteristic,
    kind: &'static str,
    definition_id: usize,
    nominal_id: usize,
    items: Vec<Item>,
}

/// Numbers of all elements.
struct Plan<'a> {
    entries: Vec<Entry<'a>>,
    last: usize,
}

impl<'a> Plan<'a> {
    fn new(report: &'a TestReport) -> Self {
        let mut ids = FIRST_ID..;
        let mut next = || ids.next().unwrap_or_default();
        let mut last = 0;
        let mut entries = Vec::new();
        for one in &report.characteristics {
            let kind = if one.common_limit().is_some() && RANGES.contains(&one.symbol.as_str()) {
                SPHERICITY
            } else {
                LINEAR
            };
            let (definition_id, nominal_id) = (next(), next());
            let mut items = Vec::new();
            let positions = one.positions.iter().map(|p| {
                let again = if p.replaced { ", replaced by a retest" } else { "" };
                let name = format!("{} {} repeat {}{again}", one.symbol, p.position, p.repeat);
                (name, p.value, p.test_value_u, p.verdict)
            });
            let worst = (
                format!("{} worst over all positions", one.symbol),
                one.value,
                one.test_value_u,
                one.verdict,
            );
            for (name, value, expanded_u, verdict) in [worst].into_iter().chain(positions) {
                let status = status(verdict);
                let (id, measurement_id) = (next(), next());
                last = measurement_id;
                items.push(Item { name, value, expanded_u, status, id, measurement_id });
            }
            entries.push(Entry { one, kind, definition_id, nominal_id, items });
        }
        Self { entries, last }
    }

    fn items(&self) -> usize {
        self.entries.iter().map(|e| e.items.len()).sum()
    }
}

fn status(verdict: Option<Verdict>) -> &'static str {
    verdict.map_or("NOT_ANALYZED", |verdict| verdict_word(Some(verdict)))
}

/// The first 16 bytes of a SHA-256 as a UUID of version 8 (RFC 9562).
pub(crate) fn uuid(sha256: &str) -> String {
    let part = |from: usize, to: usize| sha256.get(from..to).unwrap_or_default();
    format!("{}-{}-8{}-a{}-{}", part(0, 8), part(8, 12), part(13, 16), part(17, 20), part(20, 32))
}

fn header(xml: &mut Xml, report: &TestReport) {
    xml.within("Header", &[], |xml| {
        xml.within("Application", &[], |xml| xml.leaf("Name", "fringecell"));
        xml.leaf("Description", &report.rule_set.wording);
        let scope = if report.reduced.is_empty() {
            "full test"
        } else {
            "REDUCED TEST: breaks conditions of its rule set"
        };
        let simulated = if report.simulated { "; SIMULATED: no instrument was tested" } else { "" };
        xml.leaf("Scope", &format!("{scope}{simulated}"));
    });
}

fn standard(xml: &mut Xml, report: &TestReport) {
    let set = &report.rule_set;
    xml.within("Standard", &[("id", STANDARD_ID)], |xml| {
        xml.within("Organization", &[], |xml| {
            let organisation = set.standard.split_whitespace().next().unwrap_or(&set.standard);
            match organisation {
                "ISO" => xml.leaf("StandardsOrganizationEnum", "ISO"),
                other => xml.leaf("OtherStandardsOrganization", other),
            }
        });
        xml.leaf("Designator", &set.standard);
        xml.leaf("Year", &set.edition);
        xml.leaf("Title", &set.wording);
    });
}

fn units(xml: &mut Xml) {
    xml.within("FileUnits", &[], |xml| {
        xml.within("PrimaryUnits", &[], |xml| {
            xml.within("LinearUnit", &[], |xml| {
                xml.leaf("SIUnitName", "meter");
                xml.leaf("UnitName", "mm");
                xml.within("UnitConversion", &[], |xml| xml.leaf("Factor", "0.001"));
            });
        });
    });
}

fn definitions(xml: &mut Xml, plan: &Plan<'_>) {
    xml.list("CharacteristicDefinitions", plan.entries.len(), |xml| {
        plan.entries.iter().for_each(|entry| definition(xml, entry));
    });
    xml.list("CharacteristicNominals", plan.entries.len(), |xml| {
        for entry in &plan.entries {
            xml.element(entry.kind, "CharacteristicNominal", entry.nominal_id, |xml| {
                xml.leaf("CharacteristicDefinitionId", &entry.definition_id.to_string());
                if entry.kind == LINEAR {
                    xml.leaf("TargetValue", "0");
                }
            });
        }
    });
    xml.list("CharacteristicItems", plan.items(), |xml| {
        for entry in &plan.entries {
            for item in &entry.items {
                xml.element(entry.kind, "CharacteristicItem", item.id, |xml| {
                    xml.leaf("Name", &item.name);
                    xml.leaf("CharacteristicNominalId", &entry.nominal_id.to_string());
                });
            }
        }
    });
}

fn definition(xml: &mut Xml, entry: &Entry<'_>) {
    let one = entry.one;
    xml.element(entry.kind, "CharacteristicDefinition", entry.definition_id, |xml| {
        let limits = differing_limits(one).map_or_else(String::new, |limits| format!("; {limits}"));
        xml.leaf("Description", &format!("{}: {}{limits}", one.name, one.definition));
        xml.leaf("Name", &one.symbol);
        match (entry.kind, one.common_limit()) {
            (SPHERICITY, Some(limit)) => xml.leaf("ToleranceValue", &limit.to_string()),
            (_, Some(limit)) => xml.within("Tolerance", &[], |xml| {
                xml.leaf("MaxValue", &limit.to_string());
                xml.leaf("MinValue", &(-limit).to_string());
                xml.leaf("DefinedAsLimit", "false");
            }),
            (_, None) => xml.leaf("NonTolerance", "MEASURED"),
        }
        if entry.kind == LINEAR {
            xml.leaf("WhatToMeasure", &one.definition);
        }
    });
}

fn results(xml: &mut Xml, report: &TestReport, plan: &Plan<'_>) {
    xml.within("MeasurementResults", &[("id", RESULTS_ID)], |xml| {
        attributes(xml, report);
        xml.within("MeasuredCharacteristics", &[], |xml| {
            xml.list("CharacteristicMeasurements", plan.items(), |xml| {
                for entry in &plan.entries {
                    entry.items.iter().for_each(|item| measurement(xml, entry, item));
                }
            });
        });
        xml.within("InspectionStatus", &[], |xml| {
            // QIF has no word for "indeterminate" of a whole inspection.
            let word = if report.verdict == Verdict::Indeterminate {
                "UNKNOWN"
            } else {
                status(Some(report.verdict))
            };
            xml.leaf("InspectionStatusEnum", word);
        });
    });
}

fn measurement(xml: &mut Xml, entry: &Entry<'_>, item: &Item) {
    xml.element(entry.kind, "CharacteristicMeasurement", item.measurement_id, |xml| {
        xml.within("Status", &[], |xml| xml.leaf("CharacteristicStatusEnum", item.status));
        xml.leaf("CharacteristicItemId", &item.id.to_string());
        // The schema asks for both or none.
        let u = item.expanded_u.map(|expanded| (expanded / 2.0).to_string());
        let both = u.as_ref().map(|u| [("combinedUncertainty", u.as_str()), ("meanError", "0")]);
        let value = item.value.to_string();
        xml.within("Value", both.as_ref().map_or(&[], |both| &both[..]), |xml| {
            xml.event(Event::Text(BytesText::new(&value)));
        });
    });
}

/// Conditions, broken rules, artefacts and volumes: what QIF has no element for.
fn attributes(xml: &mut Xml, report: &TestReport) {
    let mut pairs: Vec<(String, String)> = report.conditions.clone();
    pairs.extend(report.reduced.iter().map(|v| {
        let text =
            format!("{} (required {} {unit}, actual {} {unit})", v.text, v.required, v.actual, unit = v.unit);
        (format!("reduced test: {}", v.rule), text)
    }));
    pairs.push(("guard factor".to_owned(), report.guard_factor.to_string()));
    pairs.extend(report.inputs.iter().map(|input| {
        let name = format!("input {} repeat {} {}", input.position, input.repeat, input.view);
        (name, format!("{} sha256 {}", input.source, input.sha256))
    }));
    pairs.extend(report.rule_set.assumed.iter().map(|text| ("assumed".to_owned(), text.clone())));
    pairs
        .extend(report.artefacts.iter().map(|a| (format!("certificate of {}", a.id), a.certificate.clone())));
    for (name, volume) in [("sensor", &report.sensor_volume), ("total", &report.total_volume)] {
        let [x, y, z] = volume.size_mm;
        pairs.push((format!("{name} measuring volume, mm"), format!("{x} {y} {z}")));
    }
    xml.list("Attributes", pairs.len(), |xml| {
        for (name, value) in &pairs {
            let (name, value) = (clean(name), clean(value));
            let start = BytesStart::new("AttributeStr");
            let both = [("name", name.as_str()), ("value", value.as_str())];
            xml.event(Event::Empty(start.with_attributes(both)));
        }
    });
}
