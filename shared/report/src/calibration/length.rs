//! A certified length against what the rig measures.

use super::super::number::signed;
use super::super::page::{Page, Text};
use super::super::statistics;

/// Measurement of the length in one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedLength {
    /// Name of the pose.
    pub pose: String,
    /// Name of the pair.
    pub pair: String,
    /// Length measured in the pose, mm.
    pub measured_mm: f64,
    /// Predicted standard uncertainty by calibration and noise, mm.
    pub u_mm: f64,
}

/// A length and how it was measured all over the volume.
#[derive(Debug, Clone, PartialEq)]
pub struct LengthCheck {
    /// Names of its two points.
    pub name: String,
    /// Certified value of the length, mm.
    pub certified_mm: f64,
    /// Its standard uncertainty, mm.
    pub u_certified_mm: f64,
    /// Whether the poses measured were left out of the calibration.
    pub held_out: bool,
    /// Each measurement; at least one.
    pub rows: Vec<CheckedLength>,
}

/// Statistics of the deviations measured − certified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LengthSummary {
    /// Number of measurements summarised.
    pub count: usize,
    /// Mean deviation from the certified value, mm.
    pub mean_mm: f64,
    /// Sample standard deviation (n − 1), mm; 0 of one.
    pub sd_mm: f64,
    /// Expanded uncertainty (k = 2) of the mean deviation, mm.
    pub expanded_mm: f64,
    /// Deviation of largest magnitude, mm.
    pub largest_mm: f64,
    /// Predicted standard uncertainty of one measurement, root mean square, mm.
    pub u_mm: f64,
}

impl LengthCheck {
    /// The statistics.
    ///
    /// The uncertainty of the mean takes the larger of its scatter and its prediction over √n, and the certificate.
    pub fn summary(&self) -> LengthSummary {
        let deviations = || self.rows.iter().map(|r| r.measured_mm - self.certified_mm);
        let count = self.rows.len().max(1) as f64;
        let all = statistics::summary(deviations());
        let u_mm = (self.rows.iter().map(|r| r.u_mm * r.u_mm).sum::<f64>() / count).sqrt();
        let sd_mm = all.sd.unwrap_or(0.0);
        let of_mean = sd_mm.max(u_mm) / count.sqrt();
        let largest_mm = deviations().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(f64::NAN);
        LengthSummary {
            count: self.rows.len(),
            mean_mm: all.mean.unwrap_or(f64::NAN),
            sd_mm,
            expanded_mm: 2.0 * (of_mean * of_mean + self.u_certified_mm * self.u_certified_mm).sqrt(),
            largest_mm,
            u_mm,
        }
    }

    /// What follows for the scale, in a sentence. Nothing is corrected.
    pub fn verdict(&self) -> String {
        let s = self.summary();
        let ppm = |mm: f64| mm / self.certified_mm * 1e6;
        let (off, u) = (ppm(s.mean_mm), ppm(s.expanded_mm));
        if s.mean_mm.abs() <= s.expanded_mm {
            return format!(
                "the scale agrees with the certificate ({off:+.0} ppm, U = {u:.0} ppm); nothing to correct"
            );
        }
        let word = if off > 0.0 { "long" } else { "short" };
        format!(
            "the rig measures {:.0} ppm too {word} (U = {u:.0} ppm): pitch_mm of the target and the certificate contradict each \
             other; the rig was not scaled; multiply pitch_mm by {:.6} and calibrate again if the certificate is the better one",
            off.abs(),
            self.certified_mm / (self.certified_mm + s.mean_mm)
        )
    }
}

/// The section of the report.
pub fn section(page: &mut Page, checks: &[LengthCheck]) {
    if checks.is_empty() {
        return;
    }
    page.section("Certified lengths");
    page.put(format_args!(
        "<div class=\"scroll\"><table><thead><tr><th>Points</th><th class=\"n\">Certified, mm</th><th class=\"n\">Measured</th>\
         <th class=\"n\">Mean deviation, µm</th><th class=\"n\">U (k = 2), µm</th><th class=\"n\">Scatter, µm</th>\
         <th class=\"n\">Largest, µm</th><th class=\"n\">Predicted u of one, µm</th></tr></thead><tbody>\n"
    ));
    for check in checks {
        let s = check.summary();
        let um = |mm: f64| signed(mm * 1e3, 1);
        page.put(format_args!(
            "<tr><td>{}</td><td class=\"n\">{:.4}</td><td class=\"n\">{} ×</td><td class=\"n\">{}</td><td class=\"n\">{:.1}</td>\
             <td class=\"n\">{:.1}</td><td class=\"n\">{}</td><td class=\"n\">{:.1}</td></tr>\n",
            Text(&check.name),
            check.certified_mm,
            s.count,
            um(s.mean_mm),
            s.expanded_mm * 1e3,
            s.sd_mm * 1e3,
            um(s.largest_mm),
            s.u_mm * 1e3
        ));
    }
    page.put(format_args!("</tbody></table></div>\n"));
    for check in checks {
        let known = if check.held_out {
            "by rigs calibrated without the pose"
        } else {
            "by the rig calibrated with the pose"
        };
        page.small(&format!(
            "{}: measured in each pose by each pair, {known}. Result: {}.",
            check.name,
            check.verdict()
        ));
    }
    page.end_section();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(deviations_mm: &[f64], u_mm: f64) -> LengthCheck {
        let row = |d: &f64| CheckedLength {
            pose: "pose".into(),
            pair: "pair1".into(),
            measured_mm: 100.0 + d,
            u_mm,
        };
        LengthCheck {
            name: "0,0:8,5".into(),
            certified_mm: 100.0,
            u_certified_mm: 0.001,
            held_out: true,
            rows: deviations_mm.iter().map(row).collect(),
        }
    }

    #[test]
    fn the_mean_is_tested_by_its_own_uncertainty_and_the_certificate() {
        let s = check(&[0.004, -0.004], 0.001).summary();
        assert!((s.sd_mm - 0.004 * 2.0_f64.sqrt()).abs() < 1e-12 && s.mean_mm.abs() < 1e-12, "{s:?}");
        assert!((s.expanded_mm - 2.0 * (0.004_f64.powi(2) + 1e-6).sqrt()).abs() < 1e-12, "{s:?}");
        assert!((check(&[0.01], 0.02).summary().expanded_mm - 2.0 * (4e-4_f64 + 1e-6).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_contradiction_names_the_factor_and_agreement_names_none() {
        assert!(check(&[0.001, -0.001, 0.002], 0.002).verdict().contains("nothing to correct"));
        let long = check(&[0.1, 0.101, 0.099], 0.001).verdict();
        assert!(
            long.contains("1000 ppm too long") && long.contains("0.999001") && long.contains("not scaled"),
            "{long}"
        );
    }
}
