//! Days of a test and of its certificates.

/// A day of the Gregorian calendar; later days compare greater.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Day {
    year: u16,
    month: u8,
    of_month: u8,
}

impl Day {
    /// Reads YYYY-MM-DD (ISO 8601); a time of day may follow after `T` or a space. `None` for anything else.
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        let (date, rest) = text.split_at_checked(10)?;
        if !(rest.is_empty() || rest.starts_with(['T', ' '])) {
            return None;
        }
        let mut parts = date.split('-');
        let mut part = |digits: usize| {
            let text = parts.next()?;
            let sound = text.len() == digits && text.bytes().all(|b| b.is_ascii_digit());
            text.parse::<u16>().ok().filter(|_| sound)
        };
        let (year, month, day) = (part(4)?, part(2)?, part(2)?);
        let leap = year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
        let days = match month {
            2 if leap => 29,
            2 => 28,
            4 | 6 | 9 | 11 => 30,
            1..=12 => 31,
            _ => return None,
        };
        (1..=days).contains(&day).then_some(Self { year, month: month as u8, of_month: day as u8 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar_and_in_its_order() {
        for text in ["2026-11-20", "2024-02-29", " 2026-11-20T08:00:00Z", "2000-02-29 12:00"] {
            assert!(Day::parse(text).is_some(), "{text}");
        }
        for text in [
            "",
            "simulated",
            "2026-13-01",
            "2026-02-29",
            "1900-02-29",
            "26-11-20",
            "2026-11-20x",
            "2026-+1-20",
        ] {
            assert!(Day::parse(text).is_none(), "{text}");
        }
        assert!(Day::parse("2025-12-31") < Day::parse("2026-01-01"));
    }
}
