//! What a new cell needs to know: from the options, or asked at a terminal.

use super::Args;
use anyhow::{Context, Result, bail, ensure};
use std::io::{BufRead, IsTerminal};

/// Sides of a projector, px.
const SIDE_PX: std::ops::RangeInclusive<u32> = 16..=16_384;

/// Distances and fields, mm.
const LENGTH_MM: std::ops::RangeInclusive<f64> = 1.0..=1e5;

/// Times between patterns, ms.
const PERIOD_MS: std::ops::RangeInclusive<f64> = 0.1..=60_000.0;

/// Answers that were checked.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Answers {
    /// Columns and rows of the projector, px.
    pub projector_px: [u32; 2],
    /// From one pattern to the next, ms, where the projector shows them by itself.
    pub period_ms: Option<f64>,
    /// From the devices to the part, mm.
    pub distance_mm: f64,
    /// Width of what a camera sees there, mm.
    pub field_mm: f64,
}

impl Answers {
    /// Takes the options; asks for them where a person is at a terminal.
    ///
    /// # Errors
    /// A value that no cell can have, with its option.
    pub(super) fn of(args: &Args) -> Result<Self> {
        let asks = !args.yes && std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
        let mut lines = std::io::stdin().lock().lines();
        let mut ask = |question: &str, default: String| -> Result<String> {
            if !asks {
                return Ok(default);
            }
            eprintln!("{question} [{default}]:");
            let line = lines.next().transpose().context("standard input")?.unwrap_or_default();
            Ok(if line.trim().is_empty() { default } else { line.trim().to_owned() })
        };
        let projector_px = size(&ask("columns and rows of the projector, px", args.projector_size.clone())?)?;
        let period = args.period_ms.map_or_else(|| "0".to_owned(), |period_ms| period_ms.to_string());
        let question = "time from pattern to pattern, ms, if the projector fires the cameras; 0: the cell steps the patterns";
        let period_ms = number("--period-ms", &ask(question, period)?)?;
        let distance_mm = ask("distance from the devices to the part, mm", args.distance_mm.to_string())?;
        let field_mm = ask("width of what a camera sees there, mm", args.field_mm.to_string())?;
        let answers = Self {
            projector_px,
            period_ms: (period_ms != 0.0 || args.period_ms.is_some()).then_some(period_ms),
            distance_mm: number("--distance-mm", &distance_mm)?,
            field_mm: number("--field-mm", &field_mm)?,
        };
        for (key, value, limits) in [
            ("--distance-mm", Some(answers.distance_mm), LENGTH_MM),
            ("--field-mm", Some(answers.field_mm), LENGTH_MM),
            ("--period-ms", answers.period_ms, PERIOD_MS),
        ] {
            let Some(value) = value else { continue };
            ensure!(limits.contains(&value), "{key} {value}: must be {} to {}", limits.start(), limits.end());
        }
        Ok(answers)
    }
}

fn size(text: &str) -> Result<[u32; 2]> {
    let sides = text
        .split_once(['x', '×'])
        .map(|(width, height)| [width, height].map(|side| side.trim().parse::<u32>().ok()));
    match sides {
        Some([Some(width), Some(height)]) if SIDE_PX.contains(&width) && SIDE_PX.contains(&height) => {
            Ok([width, height])
        }
        _ => bail!(
            "--projector-size {text:?}: must be columns and rows of {} to {} px, such as 1920x1080",
            SIDE_PX.start(),
            SIDE_PX.end()
        ),
    }
}

fn number(key: &str, text: &str) -> Result<f64> {
    text.parse::<f64>()
        .ok()
        .filter(|value| value.is_finite())
        .with_context(|| format!("{key} {text:?}: is no number"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_numbers_are_read_or_refused_with_their_option() {
        assert_eq!(size("912x1140").unwrap(), [912, 1140]);
        assert_eq!(size("912 × 1140").unwrap(), [912, 1140]);
        for wrong in ["", "912", "0x5", "x", "1920x99999999999", "-4x4", "15x100"] {
            assert!(size(wrong).unwrap_err().to_string().contains("--projector-size"), "{wrong}");
        }
        assert!(number("--field-mm", "nan").is_err() && number("--field-mm", "1e400").is_err());
    }
}
