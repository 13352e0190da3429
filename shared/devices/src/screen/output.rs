//! Outputs of an X11 display, and whether one of them shows pixels as they are.

use super::Fault;
use cell::configuration::{ScreenPlace, ScreenSettings};
use x11rb::connection::RequestConnection;
use x11rb::protocol::randr::{self, ConnectionExt as _};
use x11rb::protocol::xproto::Window;
use x11rb::rust_connection::RustConnection;

/// A refresh rate of the display that differs by more than this part from the one of the configuration is another one.
const REFRESH_TOLERANCE: f64 = 0.01;

/// An output that is on.
pub(super) struct Output {
    /// Its name, as `xrandr` lists it.
    pub name: String,
    crtc: randr::Crtc,
    /// Place on the desktop, px.
    pub corner: [i32; 2],
    size_px: [u32; 2],
    /// Refreshes in a second, where the display states them.
    refresh_hz: Option<f64>,
    upright: bool,
}

/// All outputs of the display that are on.
pub(super) fn outputs(connection: &RustConnection, root: Window) -> Result<Vec<Output>, Fault> {
    if connection.extension_information(randr::X11_EXTENSION_NAME)?.is_none() {
        return Err("it has no RandR extension, which names the outputs".into());
    }
    connection.randr_query_version(1, 3)?.reply()?;
    let resources = connection.randr_get_screen_resources_current(root)?.reply()?;
    let mut found = Vec::new();
    for output in &resources.outputs {
        let info = connection.randr_get_output_info(*output, resources.config_timestamp)?.reply()?;
        if info.crtc == 0 {
            continue;
        }
        let crtc = connection.randr_get_crtc_info(info.crtc, resources.config_timestamp)?.reply()?;
        let mode = resources.modes.iter().find(|mode| mode.id == crtc.mode);
        let total = mode.map_or(0.0, |mode| f64::from(mode.htotal) * f64::from(mode.vtotal));
        let clock_hz = mode.map_or(0.0, |mode| f64::from(mode.dot_clock));
        found.push(Output {
            name: String::from_utf8_lossy(&info.name).into_owned(),
            crtc: info.crtc,
            corner: [crtc.x.into(), crtc.y.into()],
            size_px: [crtc.width.into(), crtc.height.into()],
            refresh_hz: (total > 0.0 && clock_hz > 0.0).then(|| clock_hz / total),
            upright: crtc.rotation == randr::Rotation::ROTATE0,
        });
    }
    Ok(found)
}

/// The output that the configuration names.
pub(super) fn choose<'a>(outputs: &'a [Output], place: &ScreenPlace) -> Result<&'a Output, String> {
    let chosen = outputs.iter().find(|output| match place {
        ScreenPlace::Output(name) => output.name == *name,
        ScreenPlace::Corner(corner) => output.corner == *corner,
    });
    chosen.ok_or_else(|| {
        let listed = outputs.iter().map(|output| {
            let ([x, y], [width, height]) = (output.corner, output.size_px);
            format!("{} ({width} × {height} px at {x}, {y})", output.name)
        });
        let wanted = match place {
            ScreenPlace::Output(name) => format!("output = \"{name}\""),
            ScreenPlace::Corner([x, y]) => format!("position_px = [{x}, {y}]"),
        };
        let listed: Vec<String> = listed.collect();
        let listed = if listed.is_empty() { "none".to_owned() } else { listed.join(", ") };
        format!("the display has no such output that is on: {wanted}; it has: {listed}; `xrandr` switches outputs on")
    })
}

/// Size, refresh rate and rotation are those that the configuration states.
pub(super) fn check_output(
    output: &Output,
    size_px: [u32; 2],
    settings: &ScreenSettings,
) -> Result<(), String> {
    let name = &output.name;
    let ([width, height], [columns, rows]) = (output.size_px, size_px);
    if output.size_px != size_px {
        return Err(format!(
            "output {name} has {width} × {height} px, the projector of the configuration {columns} × {rows}; set the mode: \
             xrandr --output {name} --mode {columns}x{rows}"
        ));
    }
    if !output.upright {
        return Err(format!(
            "output {name} is rotated; set it upright: xrandr --output {name} --rotate normal"
        ));
    }
    let wanted_hz = settings.refresh_hz;
    match output.refresh_hz {
        Some(found_hz) if (found_hz / wanted_hz - 1.0).abs() > REFRESH_TOLERANCE => Err(format!(
            "output {name} refreshes at {found_hz:.2} Hz, refresh_hz = {wanted_hz}; correct it, or set the mode: \
             xrandr --output {name} --mode {columns}x{rows} --rate {wanted_hz}"
        )),
        _ => Ok(()),
    }
}

/// Nothing between the picture and the output scales it or changes its grey values.
pub(super) fn check_picture_path(
    connection: &RustConnection,
    output: &Output,
) -> Result<Result<(), String>, Fault> {
    let name = &output.name;
    let transform = connection.randr_get_crtc_transform(output.crtc)?.reply()?.current_transform;
    let rows = [
        [transform.matrix11, transform.matrix12, transform.matrix13],
        [transform.matrix21, transform.matrix22, transform.matrix23],
        [transform.matrix31, transform.matrix32, transform.matrix33],
    ];
    // Fixed-point numbers with 16 bits behind the point.
    let one_to_one = [[1 << 16, 0, 0], [0, 1 << 16, 0], [0, 0, 1 << 16]];
    if rows != one_to_one {
        return Ok(Err(format!(
            "output {name} is scaled; show it one to one: xrandr --output {name} --scale 1x1"
        )));
    }
    let gamma = connection.randr_get_crtc_gamma(output.crtc)?.reply()?;
    if let Some((level, value)) =
        [&gamma.red, &gamma.green, &gamma.blue].into_iter().find_map(|table| bent(table))
    {
        return Ok(Err(format!(
            "output {name} changes grey values: level {level} becomes {value} of 65535; set its gamma table straight: \
             xrandr --output {name} --gamma 1 --brightness 1; switch off night light and colour profiles"
        )));
    }
    Ok(Ok(()))
}

/// The first entry of a gamma table that is not on the straight line, beyond rounding to eight bits. A display without a table gives
/// zeros alone.
fn bent(table: &[u16]) -> Option<(usize, u16)> {
    let last = table.len().checked_sub(1).filter(|last| *last > 0)?;
    if table.iter().all(|value| *value == 0) {
        return None;
    }
    let straight = |level: usize| (level * 65_535 / last) as i64;
    table
        .iter()
        .enumerate()
        .find(|(level, value)| (i64::from(**value) - straight(*level)).abs() > 256)
        .map(|(l, v)| (l, *v))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gamma_table_is_straight_absent_or_bent() {
        let table = |function: &dyn Fn(f64) -> f64| -> Vec<u16> {
            (0..256).map(|level| (65_535.0 * function(f64::from(level) / 255.0)) as u16).collect()
        };
        assert_eq!(bent(&table(&|level| level)), None);
        // Eight bits of each entry, as some drivers keep.
        let coarse: Vec<u16> = (0..256_u16).map(|level| level << 8).collect();
        assert_eq!(bent(&coarse), None);
        assert_eq!((bent(&[]), bent(&[0]), bent(&[0; 1024])), (None, None, None));
        assert_eq!(bent(&table(&|level| level * 0.9)).map(|(level, _)| level), Some(10));
        assert!(bent(&table(&|level| level.sqrt())).is_some());
    }

    #[test]
    fn an_output_with_another_mode_is_refused_with_the_command_that_mends_it() {
        let output = |size_px, refresh_hz, upright| Output {
            name: "HDMI-1".into(),
            crtc: 1,
            corner: [1920, 0],
            size_px,
            refresh_hz,
            upright,
        };
        let settings = |place| ScreenSettings { display: None, place, refresh_hz: 60.0, delay_refreshes: 0 };
        let corner = settings(ScreenPlace::Corner([1920, 0]));
        let check = |output: Output| check_output(&output, [912, 1140], &corner);
        assert_eq!(check(output([912, 1140], Some(59.94), true)), Ok(()));
        assert_eq!(check(output([912, 1140], None, true)), Ok(()));
        for (found, said) in [
            (output([1920, 1080], None, true), "--mode 912x1140"),
            (output([912, 1140], Some(59.94), false), "--rotate normal"),
            (output([912, 1140], Some(50.0), true), "refreshes at 50.00 Hz, refresh_hz = 60"),
        ] {
            let error = check(found).unwrap_err();
            assert!(error.contains(said), "{error} lacks {said}");
        }
        let all = [output([912, 1140], None, true)];
        assert!(
            choose(&all, &corner.place).is_ok()
                && choose(&all, &ScreenPlace::Output("HDMI-1".into())).is_ok()
        );
        let absent = choose(&all, &ScreenPlace::Output("DP-1".into())).err().unwrap();
        assert!(absent.contains("HDMI-1 (912 × 1140 px at 1920, 0)"), "{absent}");
    }
}
