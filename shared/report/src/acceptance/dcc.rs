//! Test report in the format of digital calibration certificates: DCC 3.1.2 with D-SI 2.1.0 (PTB).
//!
//! The format is that of a certificate; the content is a test report, and a statement says so: only an accredited laboratory
//! issues certificates. Each characteristic has its worst value with U (k = 2) and limits, and the value at each position.
//! `indeterminate` is `noPass`: conformity is not proven. What nobody stated stands as "not stated". No clock is read.

use super::qif::uuid;
use super::words::{differing_limits, verdict_word};
use super::xml::Xml;
use super::{AcceptanceReportError, Parties};
use metrology::acceptance::{Characteristic, Day, TestReport};
use metrology::verdict::Verdict;

/// What stands for a text that nobody gave.
pub(super) const NOT_STATED: &str = "not stated";

/// Country code of ISO 3166-1 for users' own meaning: here that none is stated.
const NO_COUNTRY: &str = "ZZ";

/// Coverage probability that k = 2 stands for in this field (JCGM 100, 6.2.2).
const PROBABILITY: &str = "0.95";

/// The whole document, UTF-8.
///
/// # Errors
/// The result has no day of the test, or the country is no code.
pub fn render(
    report: &TestReport,
    parties: &Parties<'_>,
    sha256: &str,
) -> Result<Vec<u8>, AcceptanceReportError> {
    let date = condition(report, "date").unwrap_or_default();
    let date = check_day(date, "date of the test", "YYYY-MM-DD, from conditions.date of the plan")?;
    let country = check_country(parties)?;
    Ok(certificate(&Certificate {
        software: condition(report, "software").unwrap_or(env!("CARGO_PKG_VERSION")),
        country,
        sha256: (sha256, "SHA-256 of the result of the test (JSON)"),
        date,
        parties,
        items: &|xml| item(xml, report),
        person: condition(report, "operator").unwrap_or(NOT_STATED),
        role: Some("operator"),
        statements: &|xml| statements(xml, report),
        result: &|xml| result(xml, report),
    }))
}

/// What differs from certificate to certificate.
pub(super) struct Certificate<'a> {
    /// Version of the software that made the result.
    pub software: &'a str,
    /// Country of the test, two capital letters.
    pub country: &'a str,
    /// SHA-256 that identifies the document, and of what it is.
    pub sha256: (&'a str, &'static str),
    /// Day of the test or calibration.
    pub date: &'a str,
    /// Who tested for whom.
    pub parties: &'a Parties<'a>,
    /// Writes what was tested.
    pub items: &'a dyn Fn(&mut Xml),
    /// Name of the person who is responsible.
    pub person: &'a str,
    /// Role of that person, where it is known.
    pub role: Option<&'a str>,
    /// Writes the statements of the certificate.
    pub statements: &'a dyn Fn(&mut Xml),
    /// Writes the results of the measurement.
    pub result: &'a dyn Fn(&mut Xml),
}

/// The document around what differs, UTF-8.
pub(super) fn certificate(of: &Certificate<'_>) -> Vec<u8> {
    let root =
        [("xmlns:dcc", "https://ptb.de/dcc"), ("xmlns:si", "https://ptb.de/si"), ("schemaVersion", "3.1.2")];
    let mut xml = Xml::document();
    xml.within("dcc:digitalCalibrationCertificate", &root, |xml| {
        xml.within("dcc:administrativeData", &[], |xml| {
            software(xml, of.software);
            core(xml, of.country, of.sha256, of.date);
            (of.items)(xml);
            xml.within("dcc:calibrationLaboratory", &[], |xml| {
                contact(xml, "dcc:contact", of.parties.laboratory, of.country);
            });
            xml.within("dcc:respPersons", &[], |xml| {
                xml.within("dcc:respPerson", &[], |xml| {
                    xml.within("dcc:person", &[], |xml| text(xml, "dcc:name", of.person));
                    if let Some(role) = of.role {
                        xml.leaf("dcc:role", role);
                    }
                });
            });
            contact(xml, "dcc:customer", of.parties.customer, of.country);
            xml.within("dcc:statements", &[], |xml| (of.statements)(xml));
        });
        xml.within("dcc:measurementResults", &[], |xml| {
            xml.within("dcc:measurementResult", &[], |xml| (of.result)(xml));
        });
    });
    xml.into_bytes()
}

/// A condition of the test by its label.
fn condition<'a>(report: &'a TestReport, label: &str) -> Option<&'a str> {
    report.conditions.iter().find(|(name, _)| name == label).map(|(_, text)| text.as_str())
}

/// A day of the calendar as the schema wants it, without a time.
///
/// # Errors
/// It is none: `what` and `limit` say of what and where from.
pub(super) fn check_day<'a>(
    day: &'a str,
    what: &'static str,
    limit: &'static str,
) -> Result<&'a str, AcceptanceReportError> {
    if day.len() == 10 && Day::parse(day).is_some() {
        return Ok(day);
    }
    Err(AcceptanceReportError::Missing { what, found: day.to_owned(), limit })
}

/// The country of the test as the schema wants it.
///
/// # Errors
/// It is no code of two capital letters.
pub(super) fn check_country<'a>(parties: &Parties<'a>) -> Result<&'a str, AcceptanceReportError> {
    let code = parties.country.unwrap_or(NO_COUNTRY);
    if code.len() == 2 && code.bytes().all(|b| b.is_ascii_uppercase()) {
        return Ok(code);
    }
    Err(AcceptanceReportError::Missing {
        what: "--country",
        found: code.to_owned(),
        limit: "two capital letters of ISO 3166-1, such as DE",
    })
}

/// An element with a text in English.
pub(super) fn text(xml: &mut Xml, name: &str, content: &str) {
    xml.within(name, &[], |xml| {
        xml.within("dcc:content", &[("lang", "en")], |xml| xml.words(content));
    });
}

/// A party of the document by its name.
fn contact(xml: &mut Xml, element: &str, name: Option<&str>, country: &str) {
    xml.within(element, &[], |xml| {
        text(xml, "dcc:name", name.unwrap_or(NOT_STATED));
        xml.leaf("dcc:eMail", NOT_STATED);
        xml.within("dcc:location", &[], |xml| xml.leaf("dcc:countryCode", country));
    });
}

/// The software that made the document, by its release.
fn software(xml: &mut Xml, release: &str) {
    xml.within("dcc:dccSoftware", &[], |xml| {
        xml.within("dcc:software", &[], |xml| {
            text(xml, "dcc:name", "fringecell");
            xml.leaf("dcc:release", release);
        });
    });
}

/// Language, identification and day; the document is named after a hash, which a text explains.
fn core(xml: &mut Xml, country: &str, (sha256, what): (&str, &str), date: &str) {
    xml.within("dcc:coreData", &[], |xml| {
        xml.leaf("dcc:countryCodeISO3166_1", country);
        xml.leaf("dcc:usedLangCodeISO639_1", "en");
        xml.leaf("dcc:mandatoryLangCodeISO639_1", "en");
        xml.leaf("dcc:uniqueIdentifier", &uuid(sha256));
        xml.within("dcc:identifications", &[], |xml| {
            identification(xml, "calibrationLaboratory", sha256, what);
        });
        xml.leaf("dcc:beginPerformanceDate", date);
        xml.leaf("dcc:endPerformanceDate", date);
        xml.leaf("dcc:performanceLocation", "other");
    });
}

/// What an issuer calls something.
pub(super) fn identification(xml: &mut Xml, issuer: &str, value: &str, name: &str) {
    xml.within("dcc:identification", &[], |xml| {
        xml.leaf("dcc:issuer", issuer);
        xml.leaf("dcc:value", value);
        text(xml, "dcc:name", name);
    });
}

fn item(xml: &mut Xml, report: &TestReport) {
    let instrument = condition(report, "instrument").unwrap_or(NOT_STATED);
    xml.within("dcc:items", &[], |xml| {
        xml.within("dcc:item", &[], |xml| {
            text(xml, "dcc:name", "optical coordinate measuring system, fringe projection");
            xml.within("dcc:manufacturer", &[], |xml| text(xml, "dcc:name", instrument));
            xml.within("dcc:identifications", &[], |xml| {
                identification(xml, "owner", instrument, "maker, type, serial number");
            });
        });
    });
}

fn statements(xml: &mut Xml, report: &TestReport) {
    let claim = "Test report, not a calibration certificate of an accredited laboratory.";
    statement(xml, claim, None);
    if report.simulated {
        statement(xml, "SIMULATED: no instrument was tested.", None);
    }
    for broken in &report.reduced {
        statement(xml, &format!("REDUCED TEST, {}: {}", broken.rule, broken.text), None);
    }
    for assumed in &report.rule_set.assumed {
        statement(xml, &format!("Assumed: {assumed}"), None);
    }
    let verdict = format!("{}: verdict {}", report.rule_set.wording, verdict_word(Some(report.verdict)));
    // A reduced or simulated test proves no conformity.
    let proves = report.reduced.is_empty() && !report.simulated;
    let conformity = if proves { conformity(report.verdict) } else { "noPass" };
    statement(xml, &verdict, Some(conformity));
}

/// A statement, with its conformity where it decides one.
pub(super) fn statement(xml: &mut Xml, declaration: &str, conformity: Option<&str>) {
    xml.within("dcc:statement", &[], |xml| {
        text(xml, "dcc:declaration", declaration);
        if let Some(conformity) = conformity {
            xml.leaf("dcc:conformity", conformity);
        }
    });
}

/// The word of the schema: conformity that is not proven is no pass.
fn conformity(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "pass",
        Verdict::Indeterminate => "noPass",
        Verdict::Fail => "fail",
    }
}

fn result(xml: &mut Xml, report: &TestReport) {
    let set = &report.rule_set;
    text(xml, "dcc:name", &set.wording);
    xml.within("dcc:usedMethods", &[], |xml| {
        xml.within("dcc:usedMethod", &[], |xml| {
            text(xml, "dcc:name", &set.wording);
            xml.leaf("dcc:norm", &format!("{}:{}", set.standard, set.edition));
        });
    });
    if !report.artefacts.is_empty() {
        xml.within("dcc:measuringEquipments", &[], |xml| {
            for artefact in &report.artefacts {
                xml.within("dcc:measuringEquipment", &[], |xml| {
                    text(xml, "dcc:name", &format!("{} ({})", artefact.id, artefact.kind));
                    xml.within("dcc:identifications", &[], |xml| {
                        identification(xml, "calibrationLaboratory", &artefact.certificate, "certificate");
                    });
                });
            }
        });
    }
    if !report.conditions.is_empty() {
        xml.within("dcc:influenceConditions", &[], |xml| {
            for (label, value) in &report.conditions {
                xml.within("dcc:influenceCondition", &[], |xml| {
                    text(xml, "dcc:name", label);
                    xml.within("dcc:data", &[], |xml| text(xml, "dcc:text", value));
                });
            }
        });
    }
    xml.within("dcc:results", &[], |xml| {
        report.characteristics.iter().for_each(|one| characteristic(xml, one));
    });
}

fn characteristic(xml: &mut Xml, one: &Characteristic) {
    let limits = differing_limits(one).map_or_else(String::new, |limits| format!("; {limits}"));
    xml.within("dcc:result", &[], |xml| {
        text(xml, "dcc:name", &format!("{} {}", one.symbol, one.name));
        text(xml, "dcc:description", &format!("{}{limits}", one.definition));
        xml.within("dcc:data", &[], |xml| {
            let worst = "worst over all positions";
            let verdict = one.verdict.filter(|_| one.decides || one.limit.is_some());
            quantity(xml, worst, one.value, one.test_value_u, verdict, one.limit);
            for position in &one.positions {
                let again = if position.replaced { ", replaced by a retest" } else { "" };
                let place = format!("{} repeat {}{again}", position.position, position.repeat);
                let limit = one.limit_of(position);
                quantity(xml, &place, position.value, position.test_value_u, position.verdict, limit);
            }
        });
    });
}

fn quantity(
    xml: &mut Xml,
    name: &str,
    value: f64,
    expanded_u: Option<f64>,
    verdict: Option<Verdict>,
    limit: Option<f64>,
) {
    xml.within("dcc:quantity", &[], |xml| {
        text(xml, "dcc:name", name);
        xml.within("si:real", &[], |xml| {
            xml.leaf("si:value", &value.to_string());
            xml.leaf("si:unit", "\\milli\\metre");
            if let Some(u) = expanded_u {
                expanded(xml, u);
            }
        });
        if let Some(verdict) = verdict {
            xml.within("dcc:measurementMetaData", &[], |xml| {
                xml.within("dcc:metaData", &[], |xml| {
                    let limit = limit.map_or("no limit".to_owned(), |limit| format!("limit ± {limit} mm"));
                    text(xml, "dcc:declaration", &format!("{limit}: {}", verdict_word(Some(verdict))));
                    xml.leaf("dcc:conformity", conformity(verdict));
                });
            });
        }
    });
}

/// An expanded uncertainty with k = 2.
pub(super) fn expanded(xml: &mut Xml, u: f64) {
    xml.within("si:expandedUnc", &[], |xml| {
        xml.leaf("si:uncertainty", &u.to_string());
        xml.leaf("si:coverageFactor", "2");
        xml.leaf("si:coverageProbability", PROBABILITY);
    });
}
