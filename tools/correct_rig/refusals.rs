//! Why no corrected rig is written, in words.

use super::shown::{Link, Shown};
use super::{Args, Judge, PairAfter, devices, length};
use anyhow::{Result, bail};
use characterise::health::{KNOWN_LENGTH, LengthReading, ThreeViews, ViewCorrection};
use files::rig_file::RigFile;

impl Judge<'_> {
    /// A rig that its own check would call unhealthy is none to write.
    pub(super) fn refuse_unhealthy(&self, args: &Args, after: &[PairAfter]) -> Result<()> {
        let Some(worst) =
            after.iter().filter(|pair| !pair.healthy).max_by(|a, b| a.rms_px.total_cmp(&b.rms_px))
        else {
            return Ok(());
        };
        let remedy = if args.length.is_empty() {
            "record the object in more places, or calibrate again"
        } else {
            "the certified lengths contradict the residuals: check the lengths in the plan against the certificate, and whether it is this standard"
        };
        bail!(
            "{}: with \"{}\" corrected pair \"{}\" would not be healthy ({:.4} px rms before, {:.4} px after), so that no rig is written; {remedy}",
            self.rig_file.path.display(),
            self.view,
            worst.name,
            worst.before_px,
            worst.rms_px
        );
    }

    /// A rig that does not measure the certified lengths that went into it is none to write: the certificate contradicts what the residuals, or pairs
    /// without the corrected view, say of the scale.
    pub(super) fn refuse_other_lengths(
        &self,
        args: &Args,
        shown: &[Shown],
        found: &ViewCorrection,
    ) -> Result<()> {
        if args.length.is_empty() {
            return Ok(());
        }
        let corrected = RigFile { rig: self.rig_with(&found.camera), ..self.rig_file.clone() };
        match length::wrong(args, shown, (&corrected, KNOWN_LENGTH.max(found.u_volume)))?.first() {
            None => Ok(()),
            Some(wrong) => bail!(
                "with \"{}\" corrected {wrong}, so that no rig is written: the certified lengths contradict the residuals; check the lengths in \
                 the plan against the certificate, and whether it is this standard, or calibrate again",
                self.view
            ),
        }
    }

    /// What to tell where the residuals leave lengths open.
    pub(super) fn lengths_open(
        &self,
        links: &[Link],
        models: &[ViewCorrection],
        (apart, u_scale): (f64, Option<f64>),
    ) -> String {
        let list: Vec<String> = models
            .iter()
            .map(|model| format!("{} (χ² {:.1} of {:.1})", model.name(), model.chi2, model.limit))
            .collect();
        let remedy = match u_scale {
            None => "record a length standard and name its plan with --length".to_owned(),
            Some(u) => format!(
                "the certified lengths show it to {:.1} µm in 100 mm (standard uncertainty): record the length standard in more places, tilted by \
                 30° between them, or a longer or better known one, or calibrate again",
                u * 1e5
            ),
        };
        format!(
            "{}: \"{}\" drifted by {}, but the residuals leave lengths open by {:.1} µm in 100 mm: how far it went along the baseline to \
             {} does not show; {remedy}",
            self.rig_file.path.display(),
            self.view,
            list.join(" or by "),
            apart * 1e5,
            devices(links).iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", "),
        )
    }

    /// What to tell where certified lengths contradict `what`.
    pub(super) fn lengths_contradict(&self, args: &Args, readings: &[LengthReading], what: &str) -> String {
        let off = |reading: &&LengthReading| {
            reading.error_mm.abs() / reading.u_mm.hypot(reading.u_certified_mm).max(1e-9)
        };
        let worst = readings.iter().max_by(|a, b| off(a).total_cmp(&off(b)));
        let told = worst.map_or_else(String::new, |reading| {
            let certified = reading.certified_mm;
            format!(": {certified:.4} mm are certified, {:.4} mm were measured", certified - reading.error_mm)
        });
        let plans: Vec<String> = args.length.iter().map(|path| path.display().to_string()).collect();
        format!(
            "{}: with \"{}\" corrected the certified lengths contradict {what}{told}; check the lengths in the plan against the certificate, \
             their unit, and whether it is this standard, or calibrate again",
            plans.join(", "),
            self.view
        )
    }
}

/// Whether certified lengths contradict places whose views have none in common: no single one that moved explains that.
pub(super) fn contradict_all(places: &[ThreeViews]) -> bool {
    let wrong: Vec<[usize; 2]> = places
        .iter()
        .filter(|three| !three.lengths_agree)
        .map(|three| [three.device, three.second])
        .collect();
    let Some(first) = wrong.first() else { return false };
    !first.iter().any(|device| wrong.iter().all(|other| other.contains(device)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Proves: one view that all contradicted places have in common may have moved; several without a common one have not all moved alike.
    #[test]
    fn a_certificate_against_all_views_is_refused() {
        let three = |(device, second, lengths_agree): (usize, usize, bool)| ThreeViews {
            device,
            second,
            used: 1000,
            chi2: 1.0,
            limit: 9.0,
            lengths_agree,
        };
        let refused = |all: &[(usize, usize, bool)]| {
            contradict_all(&all.iter().copied().map(three).collect::<Vec<_>>())
        };
        assert!(!refused(&[]) && !refused(&[(0, 5, true), (1, 6, true)]));
        assert!(!refused(&[(0, 5, false)]) && !refused(&[(0, 5, false), (1, 5, false)]));
        assert!(!refused(&[(0, 5, false), (1, 6, true)]));
        assert!(
            refused(&[(0, 5, false), (1, 6, false)])
                && refused(&[(0, 5, false), (1, 5, false), (0, 6, false)])
        );
    }
}
