//! The text of a new configuration, with comments for the person who goes on with it.

use super::ask::Answers;
use super::{Args, NewCamera};
use anyhow::{Context, Result};
use fringe::geometry::rig::Rig;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Stripes of the code, projector px: half a period, so that blur makes no jump.
const STRIPE_PX: u32 = 8;

/// The configuration of the cameras under one projector.
pub(super) fn configuration(
    args: &Args,
    answers: &Answers,
    cameras: &[NewCamera],
    rig: &Rig,
    rig_path: &Path,
) -> Result<String> {
    let names: Vec<String> = (1..=cameras.len()).map(|number| format!("\"cam{number}\"")).collect();
    let mut text = format!(
        "# A cell of {} camera(s) on the network, made by `fringetool new-cell`. Every key: docs/formats.md#configuration\n\
         format = \"fringecell-config/1\"\nname = \"{}\"\n",
        cameras.len(),
        args.name
    );
    let _ = writeln!(text, "rig = {}", relative(rig_path, &args.out)?);
    if args.rig.is_none() {
        text.push_str(
            "# The rig is as it is meant. Calibrate it before the first measurement: fringetool calibrate\n",
        );
    }
    match &args.plan {
        Some(plan) => {
            let _ = writeln!(text, "plan = {}", relative(plan, &args.out)?);
        }
        None => text.push_str("# plan = \"part.plan.toml\"       # what is inspected; a draft of a first cloud: fringetool new-plan\n"),
    }
    // Pairs of views that this cell lacks stay out.
    let here = |view: &str| names.contains(&format!("{view:?}")) || view == "proj1";
    let pairs =
        rig.pairs.iter().filter(|pair| here(&pair.left) && here(&pair.right) && pair.projector == "proj1");
    let pairs: Vec<String> = pairs.map(|pair| format!("{:?}", pair.name)).collect();
    let _ = writeln!(text, "pairs = [{}]\n\n[[projector]]\nname = \"proj1\"", pairs.join(", "));
    let _ = writeln!(
        text,
        "driver = \"network\"               # another program shows the patterns: docs/hardware.md#projectors"
    );
    let _ = writeln!(text, "address = \"{}\"", args.projector);
    let [width_px, height_px] = answers.projector_px;
    let _ =
        writeln!(text, "width_px = {width_px}\nheight_px = {height_px}\ncameras = [{}]", names.join(", "));
    match answers.period_ms {
        Some(period_ms) => {
            let _ = writeln!(text, "trigger = \"sequenced\"            # the projector fires the cameras, one pattern every period_ms\nperiod_ms = {period_ms:?}");
        }
        None => text.push_str("# trigger = \"sequenced\"          # for a projector that fires the cameras, with period_ms = 20.0\n"),
    }
    text.push_str(&sequence(width_px));
    for (number, camera) in cameras.iter().enumerate() {
        text.push_str(&camera_text(number, camera));
    }
    text.push_str(
        "\n# [schedule]\n# cores = 4                       # of this computer: fringetool doctor\n",
    );
    Ok(text)
}

fn sequence(width_px: u32) -> String {
    let bits = width_px.div_ceil(STRIPE_PX).next_power_of_two().trailing_zeros().max(1);
    format!(
        "sequence = [\n\
         \x20 {{ set = \"white\" }},\n\
         \x20 {{ set = \"black\" }},\n\
         \x20 {{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 10 }},     # fringetool plan-patterns finds what suits the part\n\
         \x20 {{ set = \"gray\", axis = \"x\", bits = {bits}, stripe_px = {STRIPE_PX}.0 }},\n\
         \x20 {{ set = \"check\", axis = \"x\", stripe_px = {STRIPE_PX}.0 }},          # proves in every cycle that each frame shows its pattern\n]\n"
    )
}

fn camera_text(number: usize, camera: &NewCamera) -> String {
    let NewCamera { place, probed, format } = camera;
    let mut text = format!(
        "\n[[camera]]                        # {} {} at {place}\nname = \"cam{}\"\n",
        probed.model,
        probed.serial,
        number + 1
    );
    text.push_str("driver = \"genicam\"\n");
    match place.address() {
        None => {
            let _ = writeln!(text, "transport = \"usb3\"\nserial = {:?}", probed.serial);
        }
        Some(address) if probed.serial.is_empty() => {
            let _ = writeln!(text, "address = \"{address}\"");
        }
        Some(address) if address.is_loopback() => {
            let _ = writeln!(
                text,
                "address = \"{address}\"           # simulated; of a real camera the serial number is the safer choice"
            );
        }
        Some(_) => {
            let _ = writeln!(text, "serial = {:?}", probed.serial);
        }
    }
    let _ = writeln!(text, "pixel_format = \"{}\"", format.name());
    match probed.exposure_us {
        Some(us) => {
            let _ =
                writeln!(text, "exposure_us = {us:?}             # fringetool expose finds the right one");
        }
        None => text.push_str("# exposure_us = 10000.0           # the camera did not tell its own\n"),
    }
    text
}

/// The path of a file as the configuration writes it: relative to its folder where that is plain, else absolute.
fn relative(path: &Path, config: &Path) -> Result<toml::Value> {
    let folder = |path: &Path| path.parent().map(Path::to_owned).unwrap_or_default();
    let written = if folder(path) == folder(config) {
        path.file_name().map(PathBuf::from).context("a path without a name")?
    } else {
        std::path::absolute(path)?
    };
    Ok(toml::Value::String(written.display().to_string()))
}
