//! What the processes say of themselves on standard error, as `FRINGECELL_LOG` chooses.

use std::io::IsTerminal;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::FmtSpan;

/// The variable that chooses.
const VARIABLE: &str = "FRINGECELL_LOG";

/// How it is written.
const REMEDY: &str = "write off, error, warn, info, debug or trace, for parts of the program as in warn,fringecell::stage=debug";

/// Tells warnings by default. `info`: stages and cycles; `debug`: each activation; `trace`: each step of a stage as a span
/// with its time. `complains`: of a variable that cannot be followed; the stages leave that to their supervisor.
pub fn to_stderr(complains: bool) {
    let written = std::env::var_os(VARIABLE).map(|text| text.to_string_lossy().into_owned());
    let (filter, complaint) = filter(written.as_deref());
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        // Of the spans that the filter lets through, how long each one lasted.
        .with_span_events(FmtSpan::CLOSE)
        .with_ansi(std::io::stderr().is_terminal())
        .without_time()
        .init();
    if let Some(complaint) = complaint.filter(|_| complains) {
        eprintln!("warning: {complaint}");
    }
}

/// The filter that is meant; where that cannot be known, warnings and what is wrong.
fn filter(written: Option<&str>) -> (EnvFilter, Option<String>) {
    let warnings = || EnvFilter::new("warn");
    let Some(text) = written.filter(|text| !text.trim().is_empty()) else { return (warnings(), None) };
    let wrong = match EnvFilter::builder().parse(text) {
        Ok(filter) => match unknown_level(text) {
            None => return (filter, None),
            Some(word) => format!("\"{word}\" is no level"),
        },
        Err(error) => error.to_string(),
    };
    (warnings(), Some(format!("{VARIABLE}={text:?}: {wrong}; warnings are told; {REMEDY}")))
}

/// A word that stands alone is taken for the name of a part of the program, of which it then tells everything, and
/// nothing of the rest. Whoever mistypes a level means neither.
fn unknown_level(text: &str) -> Option<&str> {
    // Within a span's fields a comma separates something else.
    let mut words = text.split(',').map(str::trim).filter(|_| !text.contains('['));
    words.find(|word| !word.is_empty() && !word.contains('=') && word.parse::<LevelFilter>().is_err())
}

#[cfg(test)]
mod tests {
    use super::filter;

    #[test]
    fn a_filter_that_cannot_be_followed_is_named_in_one_line_with_what_is_used_and_how_to_write_it() {
        for (bad, wrong) in [
            ("debgu", "\"debgu\" is no level"),
            ("warn,fringecell", "\"fringecell\" is no level"),
            ("warn,fringecell::stage=loud", "expected one of"),
            ("warn,[", ""),
        ] {
            let (used, complaint) = filter(Some(bad));
            let complaint = complaint.expect(bad);
            assert_eq!(used.to_string(), "warn", "{bad}");
            assert!(complaint.contains(wrong) && complaint.contains("FRINGECELL_LOG=\""), "{complaint}");
            assert!(complaint.contains("write off, error") && complaint.lines().count() == 1, "{complaint}");
        }
    }

    #[test]
    fn what_can_be_followed_is() {
        for good in
            ["debug", "OFF", "warn,fringecell::stage=debug", "info,ipc=trace", "warn,fringecell[step]=trace"]
        {
            let (_, complaint) = filter(Some(good));
            assert_eq!(complaint, None, "{good}");
        }
        assert_eq!(filter(None).0.to_string(), "warn");
        assert_eq!(filter(Some(" ")).1, None);
    }
}
