//! A part as QIF 3.0 (ISO 23952): the plan as definitions, nominals and items of its characteristics, and the results.
//!
//! Each feature is a user-defined characteristic, linear or angular, with its nominal as target and its tolerance as
//! deviations. `combinedUncertainty` is the standard uncertainty. A feature that was not measured has an item and no
//! measurement.

use super::PartInput;
use crate::acceptance::qif::uuid;
use crate::acceptance::words::verdict_word;
use crate::acceptance::xml::Xml;
use metrology::inspection::{FeatureResult, Unit};
use metrology::verdict::Verdict;
use quick_xml::events::{BytesText, Event};

const STANDARD_ID: &str = "1";
const RESULTS_ID: usize = 2;
/// First of the numbers of features, and how many each takes: definition, nominal, item, measurement.
const FIRST_ID: usize = 3;
const IDS: usize = 4;

fn id(index: usize, which: usize) -> usize {
    FIRST_ID + IDS * index + which
}

fn kind(f: &FeatureResult) -> &'static str {
    if f.unit == Unit::Deg { "UserDefinedAngular" } else { "UserDefinedLinear" }
}

/// The whole document, UTF-8.
pub fn render(input: &PartInput<'_>) -> Vec<u8> {
    let features = &input.result.features;
    let last = id(features.len(), 0).to_string();
    let root =
        [("xmlns", "http://qifstandards.org/xsd/qif3"), ("idMax", last.as_str()), ("versionQIF", "3.0.0")];
    let mut xml = Xml::document();
    xml.within("QIFDocument", &root, |xml| {
        xml.leaf("QPId", &uuid(input.sha256));
        xml.within("Header", &[], |xml| {
            xml.within("Application", &[], |xml| xml.leaf("Name", "fringecell"));
            let part = input.part.map_or_else(String::new, |part| format!(", part {part}"));
            xml.leaf("Description", &format!("{}{part}, measured on {}", input.result.plan, input.date));
        });
        xml.list("StandardsDefinitions", 1, standard);
        units(xml);
        xml.within("Characteristics", &[], |xml| {
            xml.leaf("FormalStandardId", STANDARD_ID);
            characteristics(xml, features);
        });
        xml.within("Results", &[], |xml| {
            xml.list("MeasurementResultsSet", 1, |xml| results(xml, input));
        });
    });
    xml.into_bytes()
}

fn standard(xml: &mut Xml) {
    xml.within("Standard", &[("id", STANDARD_ID)], |xml| {
        xml.within("Organization", &[], |xml| xml.leaf("StandardsOrganizationEnum", "ISO"));
        xml.leaf("Designator", "ISO 1101");
        xml.leaf("Year", "2017");
        xml.leaf("Title", "Geometrical tolerancing");
    });
}

fn units(xml: &mut Xml) {
    xml.within("FileUnits", &[], |xml| {
        xml.within("PrimaryUnits", &[], |xml| {
            xml.within("AngularUnit", &[], |xml| {
                xml.leaf("SIUnitName", "radian");
                xml.leaf("UnitName", "degree");
                xml.within("UnitConversion", &[], |xml| xml.leaf("Factor", "0.017453292519943295"));
            });
            xml.within("LinearUnit", &[], |xml| {
                xml.leaf("SIUnitName", "meter");
                xml.leaf("UnitName", "mm");
                xml.within("UnitConversion", &[], |xml| xml.leaf("Factor", "0.001"));
            });
        });
    });
}

fn characteristics(xml: &mut Xml, features: &[FeatureResult]) {
    xml.list("CharacteristicDefinitions", features.len(), |xml| {
        for (index, f) in features.iter().enumerate() {
            xml.element(kind(f), "CharacteristicDefinition", id(index, 0), |xml| definition(xml, f));
        }
    });
    xml.list("CharacteristicNominals", features.len(), |xml| {
        for (index, f) in features.iter().enumerate() {
            xml.element(kind(f), "CharacteristicNominal", id(index, 1), |xml| {
                xml.leaf("CharacteristicDefinitionId", &id(index, 0).to_string());
                xml.leaf("TargetValue", &f.nominal.to_string());
            });
        }
    });
    xml.list("CharacteristicItems", features.len(), |xml| {
        for (index, f) in features.iter().enumerate() {
            xml.element(kind(f), "CharacteristicItem", id(index, 2), |xml| {
                xml.leaf("Name", &f.name);
                xml.leaf("CharacteristicNominalId", &id(index, 1).to_string());
            });
        }
    });
}

fn definition(xml: &mut Xml, f: &FeatureResult) {
    let words = f.detail.as_deref().unwrap_or(&f.name);
    xml.leaf("Description", words);
    xml.leaf("Name", &f.name);
    match (f.lower, f.upper) {
        (Some(lower), Some(upper)) => xml.within("Tolerance", &[], |xml| {
            xml.leaf("MaxValue", &(upper - f.nominal).to_string());
            xml.leaf("MinValue", &(lower - f.nominal).to_string());
            xml.leaf("DefinedAsLimit", "false");
        }),
        _ => xml.leaf("NonTolerance", "MEASURED"),
    }
    xml.leaf("WhatToMeasure", words);
}

fn results(xml: &mut Xml, input: &PartInput<'_>) {
    let measured: Vec<(usize, &FeatureResult, f64)> =
        input.result.features.iter().enumerate().filter_map(|(i, f)| Some((i, f, f.value?))).collect();
    xml.within("MeasurementResults", &[("id", &RESULTS_ID.to_string())], |xml| {
        if !measured.is_empty() {
            xml.within("MeasuredCharacteristics", &[], |xml| {
                xml.list("CharacteristicMeasurements", measured.len(), |xml| {
                    for (index, f, value) in &measured {
                        measurement(xml, *index, f, *value);
                    }
                });
            });
        }
        xml.within("InspectionStatus", &[], |xml| {
            let verdict = input.result.verdict;
            // QIF has no word for "indeterminate" of a whole inspection.
            let word =
                if verdict == Verdict::Indeterminate { "UNKNOWN" } else { verdict_word(Some(verdict)) };
            xml.leaf("InspectionStatusEnum", word);
        });
    });
}

fn measurement(xml: &mut Xml, index: usize, f: &FeatureResult, value: f64) {
    xml.element(kind(f), "CharacteristicMeasurement", id(index, 3), |xml| {
        let status = f.verdict.map_or("NOT_ANALYZED", |verdict| verdict_word(Some(verdict)));
        xml.within("Status", &[], |xml| xml.leaf("CharacteristicStatusEnum", status));
        xml.leaf("CharacteristicItemId", &id(index, 2).to_string());
        let u = f.u.map(|u| u.to_string());
        // The schema asks for both or none.
        let both = u.as_ref().map(|u| [("combinedUncertainty", u.as_str()), ("meanError", "0")]);
        let value = value.to_string();
        xml.within("Value", both.as_ref().map_or(&[], |both| &both[..]), |xml| {
            xml.event(Event::Text(BytesText::new(&value)));
        });
    });
}
