//! The time of day, for what is written down; no result depends on it.

use std::time::{SystemTime, UNIX_EPOCH};

/// The time of day in UTC, for people: `2026-01-31 08:00 UTC`.
pub fn utc_now() -> String {
    utc(seconds_now())
}

/// The time of day in UTC, for programs (RFC 3339): `2026-01-31T08:00:00Z`.
pub fn rfc3339_now() -> String {
    rfc3339(seconds_now())
}

fn seconds_now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())
}

fn utc(seconds: u64) -> String {
    let time = seconds % 86_400;
    format!("{} {:02}:{:02} UTC", date(seconds), time / 3600, time / 60 % 60)
}

fn rfc3339(seconds: u64) -> String {
    let time = seconds % 86_400;
    format!("{}T{:02}:{:02}:{:02}Z", date(seconds), time / 3600, time / 60 % 60, time % 60)
}

/// Days to date by the algorithm of Howard Hinnant ("chrono-Compatible Low-Level Date Algorithms", days_from_civil).
fn date(seconds: u64) -> String {
    let shifted = seconds / 86_400 + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_right_at_leap_days_and_turns_of_years() {
        for (seconds, date) in [
            (0, "1970-01-01 00:00 UTC"),
            (951_782_400, "2000-02-29 00:00 UTC"),
            (951_868_800, "2000-03-01 00:00 UTC"),
            (1_735_689_599, "2024-12-31 23:59 UTC"),
            (1_735_689_600, "2025-01-01 00:00 UTC"),
            (4_107_542_399, "2100-02-28 23:59 UTC"),
        ] {
            assert_eq!(utc(seconds), date);
        }
        assert_eq!(rfc3339(1_735_689_599), "2024-12-31T23:59:59Z");
    }
}
