//! Numbers as a person reads them: as many digits as the uncertainty carries, real minus signs, a dash for "none".

/// Shown for absent and undefined values.
pub const NONE: &str = "–";

/// Most digits after the point; a tenth of a nanometre in mm is beyond every cell.
const MAX_DECIMALS: usize = 7;

/// Digits after the point that show two significant digits of the uncertainty (GUM 7.2.6); 4 without one.
pub fn decimals(uncertainty: Option<f64>) -> usize {
    let Some(mut scaled) = uncertainty.filter(|u| u.is_finite() && *u > 0.0) else {
        return 4;
    };
    let mut decimals = 0;
    // 9.95 is rounded to 10, which has its two digits already.
    while scaled < 9.95 && decimals < MAX_DECIMALS {
        scaled *= 10.0;
        decimals += 1;
    }
    decimals
}

/// A fixed number of digits, with a real minus sign and without a negative zero.
pub fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return NONE.to_owned();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|b| matches!(b, b'0' | b'.')) => digits.to_owned(),
        Some(digits) => format!("−{digits}"),
        None => text,
    }
}

/// The same, a dash where there is no value.
pub fn optional(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| NONE.to_owned(), |v| fixed(v, decimals))
}

/// With a plus sign where positive: for errors and deviations.
pub fn signed(value: f64, decimals: usize) -> String {
    let text = fixed(value, decimals);
    let zero = text.bytes().all(|b| matches!(b, b'0' | b'.'));
    if value > 0.0 && value.is_finite() && !zero { format!("+{text}") } else { text }
}

/// Digits after the point that a limit from a plan needs to be printed as it was written.
pub fn limit_decimals(limit: Option<f64>) -> usize {
    let Some(value) = limit.filter(|v| v.is_finite()) else {
        return 0;
    };
    // Nominal and tolerance are added before they come here: 60.12 + 0.024 is 60.144000000000005.
    let rounding = 4.0 * f64::EPSILON * value.abs();
    let exact = |d: &usize| {
        format!("{value:.d$}", d = *d).parse::<f64>().is_ok_and(|printed| (printed - value).abs() <= rounding)
    };
    (0..MAX_DECIMALS).find(exact).unwrap_or(MAX_DECIMALS)
}

/// A limit from a plan with all its digits, and at least `decimals`.
pub fn limit(value: Option<f64>, decimals: usize) -> String {
    optional(value, limit_decimals(value).max(decimals))
}

/// So many significant digits, with a power of ten for very small and very large numbers.
pub fn significant(value: f64, digits: usize) -> String {
    if !value.is_finite() || value == 0.0 {
        return if value == 0.0 { "0".to_owned() } else { NONE.to_owned() };
    }
    // Rounded first, so that 0.0999 becomes 0.10 and not 0.100.
    let scientific = format!("{value:.*e}", digits.saturating_sub(1));
    let Some((mantissa, exponent)) = scientific.split_once('e') else { return scientific };
    match exponent.parse::<i32>() {
        Ok(power) if (-4..6).contains(&power) => fixed(value, (digits as i32 - 1 - power).max(0) as usize),
        _ => format!("{}e{}", mantissa.replace('-', "−"), exponent.replace('-', "−")),
    }
}

/// A count in groups of three, parted by thin spaces.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::with_capacity(digits.len() * 2);
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

/// A time given in ns, as text in ms.
pub fn milliseconds(time_ns: Option<u64>) -> String {
    time_ns.map_or_else(|| NONE.to_owned(), |t| fixed(t as f64 * 1e-6, 2))
}

/// Units as they are printed.
pub fn unit(plain: &str) -> &str {
    match plain {
        "um" => "µm",
        "deg" => "°",
        other => other,
    }
}

/// The step of 1, 2 or 5 · 10ⁿ that is at least `value`; 0 for what is no positive number.
pub fn round_up(value: f64) -> f64 {
    if !value.is_finite() || value <= 0.0 {
        return 0.0;
    }
    // Exact powers from text: repeated multiplication would give 0.30000000000000004 on an axis.
    let power = |n: i32| format!("1e{n}").parse::<f64>().unwrap_or(f64::INFINITY);
    for exponent in -300..300 {
        for step in [1.0, 2.0, 5.0] {
            let candidate = step * power(exponent);
            if candidate >= value * (1.0 - 1e-12) {
                return candidate;
            }
        }
    }
    value
}

/// Round values from `low` to `high`, about `wanted` of them, and the digits they need.
pub fn ticks(low: f64, high: f64, wanted: usize) -> (Vec<f64>, usize) {
    let step = round_up((high - low) / wanted.max(1) as f64);
    if step <= 0.0 || !low.is_finite() {
        return (Vec::new(), 0);
    }
    let decimals = (0..MAX_DECIMALS).find(|d| format!("{step:.d$}").parse::<f64>() == Ok(step));
    let first = (low / step - 1e-9).ceil();
    let count = ((high / step + 1e-9).floor() - first).max(-1.0) as i64;
    let values = (0..=count).map(|i| (first + i as f64) * step).collect();
    (values, decimals.unwrap_or(MAX_DECIMALS))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_has_the_digits_of_its_uncertainty() {
        assert_eq!(decimals(Some(0.0123)), 3);
        assert_eq!(decimals(Some(0.0031)), 4);
        assert_eq!(decimals(Some(0.09951)), 2);
        assert_eq!(decimals(Some(42.0)), 0);
        assert_eq!(decimals(Some(0.0)), 4);
        assert_eq!(decimals(Some(f64::NAN)), 4);
        assert_eq!(decimals(Some(1e-30)), MAX_DECIMALS);
    }

    #[test]
    fn signs_are_those_of_print() {
        assert_eq!(fixed(-1.25, 1), "−1.2");
        assert_eq!(fixed(-0.0001, 2), "0.00");
        assert_eq!(signed(0.0001, 2), "0.00");
        assert_eq!(signed(0.01, 2), "+0.01");
        assert_eq!(signed(-0.01, 2), "−0.01");
        assert_eq!(fixed(f64::NAN, 2), NONE);
        assert_eq!(signed(f64::INFINITY, 2), NONE);
    }

    #[test]
    fn a_limit_keeps_the_digits_of_the_plan() {
        assert_eq!(limit(Some(60.1945), 2), "60.1945");
        assert_eq!(limit(Some(60.0), 2), "60.00");
        assert_eq!(limit(Some(60.12 + 0.024), 2), "60.144");
        assert_eq!(limit(Some(1.0 / 3.0), 2), "0.3333333");
        assert_eq!(limit(None, 2), NONE);
        assert_eq!(limit(Some(f64::INFINITY), 2), NONE);
    }

    #[test]
    fn significant_digits_are_counted_from_the_first() {
        for (value, text) in [
            (0.012_345, "0.0123"),
            (-15.55, "−15.6"),
            (0.099_97, "0.100"),
            (123_456.0, "123456"),
            (1.03e-7, "1.03e−7"),
            (-2.5e9, "−2.50e9"),
            (0.0, "0"),
            (f64::INFINITY, NONE),
        ] {
            assert_eq!(significant(value, 3), text);
        }
    }

    #[test]
    fn counts_are_grouped() {
        assert_eq!(count(7), "7");
        assert_eq!(count(1_234_567), "1\u{202f}234\u{202f}567");
    }

    #[test]
    fn axes_have_round_ticks() {
        assert_eq!(round_up(0.011), 0.02);
        assert_eq!(round_up(0.05), 0.05);
        assert_eq!((round_up(26.0), round_up(600.0)), (50.0, 1000.0));
        assert_eq!(round_up(-1.0), 0.0);
        let (values, digits) = ticks(-0.05, 0.05, 5);
        assert_eq!((values.len(), digits), (5, 2));
        assert_eq!(values[0], -0.04);
        assert!(ticks(1.0, 1.0, 5).0.is_empty());
        assert!(ticks(f64::NAN, 1.0, 5).0.is_empty());
    }
}
