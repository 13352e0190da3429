//! Diagrams of a response.

use super::Waveform;
use super::fringes::FringeResult;
use super::levels::LevelResult;
use fringe::math::pow;
use fringe::pattern::LevelTable;
use report::plot::{Mark, Plot, Series, Sheet};

/// Diagrams of a response from grey levels.
pub fn of_levels(source: &str, result: &LevelResult) -> Sheet {
    let (low, high) = (result.levels[0].mean_dn, result.levels[result.levels.len() - 1].mean_dn);
    let law = &result.power_law;
    let residual = |i: usize| (result.levels[i].level, result.polynomial.residuals[i]);
    let residuals = (0..result.levels.len()).map(residual).collect();
    let measured = result.levels.iter().map(|g| (g.level, g.mean_dn)).collect();
    let power = grid(|x| law.offset_dn + law.gain_dn * pow(x, law.gamma));
    let polynomial =
        grid(|y| y).into_iter().map(|(y, _)| (result.polynomial.level(y), low + (high - low) * y)).collect();
    let mut facts = facts(result.projector.as_ref(), result.camera.as_ref(), result.gamma, result.u_gamma);
    facts.push(("Region (x, y, width, height)".into(), format!("{} px", result.roi)));
    facts.push((
        "Saturated pixels left out".into(),
        format!("{} of {}", result.saturated_pixels, result.pixels),
    ));
    facts.extend(errors(&result.before, &result.after));
    let mut bars = vec![
        harmonics("as drawn, predicted", &result.before.harmonics),
        harmonics("table of the response, predicted", &result.after_response.harmonics),
        harmonics("table of the polynomial, predicted", &result.after_polynomial.harmonics),
    ];
    if let Some(recorded) = &result.recorded {
        let points = (2..).zip(&recorded.harmonics).filter_map(|(order, h)| Some((f64::from(order), (*h)?)));
        let name = if result.corrected { "recorded, drawn corrected" } else { "recorded, as drawn" };
        bars.push(Series { name: name.into(), mark: Mark::Bars, points: points.collect() });
    }
    let response = plot(
        "Response",
        ["Drawn level, 0 … 1", "Mean grey value, DN"],
        vec![
            line("power law (eq. 3.1)", power),
            line("inverse polynomial of order 7 (eq. 3.2)", polynomial),
            Series { name: "measured".into(), mark: Mark::Dots, points: measured },
        ],
    );
    let residuals = Series { name: "drawn less fitted level".into(), mark: Mark::Dots, points: residuals };
    let residuals = plot(
        "Residuals of the inverse polynomial",
        ["Drawn level, 0 … 1", "Residual, level 0 … 1"],
        vec![residuals],
    );
    let plots = vec![response, residuals, bars_plot(bars), table(&result.lut)];
    Sheet { title: "Projector response".into(), subtitle: source.into(), facts, plots, notes: notes() }
}

/// Diagrams of a response from fringes.
pub fn of_fringes(source: &str, result: &FringeResult) -> Sheet {
    let mut facts = facts(result.projector.as_ref(), result.camera.as_ref(), result.gamma, result.u_gamma);
    facts.push(("Pixels".into(), result.fringes.pixels.to_string()));
    facts.extend(errors(&result.before, &result.after));
    let light = grid(|x| result.fringes.offset + result.fringes.gain * pow(x, result.gamma));
    let response = plot(
        "Response, from fringes",
        ["Drawn level, 0 … 1", "Light, fraction of white less black"],
        vec![line("fitted power law (eq. 3.1)", light)],
    );
    let bars = vec![
        harmonics("as drawn", &result.before.harmonics),
        harmonics("with the table", &result.after.harmonics),
    ];
    let plots = vec![response, bars_plot(bars), table(&result.lut)];
    Sheet { title: "Projector response".into(), subtitle: source.into(), facts, plots, notes: notes() }
}

fn facts(
    projector: Option<&String>,
    camera: Option<&String>,
    gamma: f64,
    u_gamma: f64,
) -> Vec<(String, String)> {
    let named = |what: &str, name: Option<&String>| name.map(|n| (what.to_owned(), n.clone()));
    let gamma = ("Gamma (eq. 3.1), standard uncertainty".to_owned(), format!("{gamma:.4}, {u_gamma:.4}"));
    [named("Projector", projector), named("Camera", camera), Some(gamma)].into_iter().flatten().collect()
}

fn errors(before: &Waveform, after: &Waveform) -> [(String, String); 2] {
    let text = |wave: &Waveform| {
        format!("{:.4} rad rms, {:.4} rad peak", wave.phase_error.rms_rad, wave.phase_error.peak_rad)
    };
    let name = |when: &str| format!("{}-step phase error {when}", before.phase_error.steps);
    [(name("as drawn"), text(before)), (name("with the table"), text(after))]
}

fn harmonics(name: &str, values: &[f64; 4]) -> Series {
    let points = (2..).zip(values).map(|(order, h)| (f64::from(order), *h)).collect();
    Series { name: name.into(), mark: Mark::Bars, points }
}

fn bars_plot(series: Vec<Series>) -> Plot {
    let mut plot = plot("Harmonics", ["Order", "Amplitude relative to the first"], series);
    plot.log_y = true;
    plot
}

fn table(lut: &LevelTable) -> Plot {
    let last = lut.values().len().saturating_sub(1).max(1) as f64;
    let points = lut.values().iter().enumerate().map(|(i, v)| (i as f64 / last, *v));
    let step = lut.values().len().div_ceil(512);
    plot(
        "Correction table",
        ["Wanted level, 0 … 1", "Level to draw, 0 … 1"],
        vec![line("table", points.step_by(step).collect())],
    )
}

fn plot(title: &str, [x, y]: [&str; 2], series: Vec<Series>) -> Plot {
    Plot {
        title: title.into(),
        x_label: x.into(),
        y_label: y.into(),
        log_y: false,
        series,
        marks: Vec::new(),
        note: String::new(),
    }
}

fn line(name: &str, points: Vec<(f64, f64)>) -> Series {
    Series { name: name.into(), mark: Mark::Line, points }
}

fn grid(function: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    (0..=256).map(|i| f64::from(i) / 256.0).map(|x| (x, function(x))).collect()
}

fn notes() -> Vec<String> {
    vec![
        "Harmonics: amplitudes of the 2nd to 5th harmonic of a sinusoid that is drawn from black to white, relative to its \
         first. Predicted: through the measured response, levels rounded as the projector rounds them. Recorded: from \
         fringes in fine steps, averaged in phase over the pixels of the region."
            .into(),
        "Phase error: measured less true phase of N steps over one fringe, root mean square and largest magnitude.".into(),
        "The camera counts as linear; pixels that saturate at any level are left out of all.".into(),
    ]
}
