//! Lists of numbers on the command line.

use anyhow::{Context, Result, bail};
use std::ops::RangeInclusive;

/// Largest number of values in a list.
const MOST: usize = 4096;

/// A number within limits, for an option of the command line.
///
/// # Errors
/// No number, or one outside; clap names the option and the value.
pub fn within(text: &str, limits: RangeInclusive<f64>) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    let outside = || format!("must lie within {} and {}", limits.start(), limits.end());
    if limits.contains(&value) { Ok(value) } else { Err(outside()) }
}

/// Numbers separated by commas; `first:last:step` is a series, `first:last` one with step 1.
pub fn list(flag: &str, text: &str) -> Result<Vec<f64>> {
    let mut numbers = Vec::new();
    for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
        let fields = part.split(':').map(|field| number(flag, field)).collect::<Result<Vec<f64>>>()?;
        match fields.as_slice() {
            [one] => numbers.push(*one),
            [first, last] => series(flag, part, [*first, *last, 1.0], &mut numbers)?,
            [first, last, step] => series(flag, part, [*first, *last, *step], &mut numbers)?,
            _ => bail!("{flag}: \"{part}\" is neither a number nor first:last:step"),
        }
        if numbers.len() > MOST {
            bail!("{flag}: more than {MOST} numbers; is the step right?");
        }
    }
    if numbers.is_empty() {
        bail!("{flag}: no numbers; separate them by commas, such as 0,5,10, or as 0:255:5");
    }
    Ok(numbers)
}

fn number(flag: &str, text: &str) -> Result<f64> {
    let value: f64 = text.trim().parse().with_context(|| format!("{flag}: \"{text}\" is not a number"))?;
    if !value.is_finite() {
        bail!("{flag}: {text} is not finite");
    }
    Ok(value)
}

fn series(flag: &str, part: &str, [first, last, step]: [f64; 3], numbers: &mut Vec<f64>) -> Result<()> {
    let count = (last - first) / step;
    if !count.is_finite() || !(0.0..MOST as f64).contains(&count) {
        bail!("{flag}: \"{part}\" is not a series of at most {MOST} numbers; write first:last:step");
    }
    // A step such as 0.1 has no exact binary value; the last one counts when it is met but for rounding.
    let steps = (count + 1e-9).floor() as usize;
    numbers.extend((0..=steps).map(|i| first + step * i as f64));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_series_are_read() {
        assert_eq!(list("--x", "0,5, 10").unwrap(), [0.0, 5.0, 10.0]);
        assert_eq!(list("--x", "0:255:5").unwrap().len(), 52);
        assert_eq!(list("--x", "-2:2,7").unwrap(), [-2.0, -1.0, 0.0, 1.0, 2.0, 7.0]);
        assert_eq!(list("--x", "0:1:0.1").unwrap().len(), 11);
        assert_eq!(list("--x", "3:1:-1").unwrap(), [3.0, 2.0, 1.0]);
        for bad in ["", "a", "1:2:0", "0:1e9", "1:2:-1", "1:2:3:4", "nan", "1e999"] {
            assert!(list("--x", bad).is_err(), "{bad}");
        }
    }
}
