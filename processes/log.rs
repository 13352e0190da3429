//! Log messages on standard error; `FRINGECELL_LOG` selects them.

use crate::terminal;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::FmtSpan;

/// Name of the environment variable.
const VARIABLE: &str = "FRINGECELL_LOG";

/// Its syntax, for the error message.
const REMEDY: &str = "use off, error, warn, info, debug or trace; per module: warn,fringecell::stage=debug";

/// What libraries say without being asked: the one of the gateway takes every fault of a client for an error of its own, that of the
/// link every attempt to connect.
const LIBRARIES: &str =
    "zenoh=off,opcua_core=off,opcua_crypto=off,opcua_server=off,opcua_types=off,opcua_nodes=off";

/// Starts logging; the default level is `warn`, with `--verbose` `info`, with `--quiet` `error`; the variable comes first. `info`: stages and cycles; `debug`: each activation; `trace`: each step of a
/// stage with its duration. `report_errors`: print a warning if the variable is invalid; stages leave that to the supervisor.
pub fn to_stderr(report_errors: bool) {
    let value = std::env::var_os(VARIABLE).map(|text| text.to_string_lossy().into_owned());
    let (filter, error) = filter(value.as_deref());
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(|| cli::output::Stderr)
        // Log the duration of each span.
        .with_span_events(FmtSpan::CLOSE)
        .with_ansi(cli::output::has_color())
        .without_time()
        .init();
    if let Some(error) = error.filter(|_| report_errors) {
        terminal::print_note(&format!("warning: {error}"));
    }
}

/// The filter of a value; for an invalid one, the default filter and the error.
fn filter(value: Option<&str>) -> (EnvFilter, Option<String>) {
    let warnings = || EnvFilter::new("warn");
    let default = if cli::is_quiet() {
        "error"
    } else if cli::is_verbose() {
        "info"
    } else {
        "warn"
    };
    let Some(text) = value.filter(|text| !text.trim().is_empty()) else {
        return (EnvFilter::new(format!("{default},{LIBRARIES}")), None);
    };
    let wrong = match EnvFilter::builder().parse(text) {
        Ok(filter) => match unknown_level(text) {
            None => return (filter, None),
            Some(word) => format!("\"{word}\" is not a level"),
        },
        Err(error) => error.to_string(),
    };
    (warnings(), Some(format!("{VARIABLE}={text:?}: {wrong}; showing warnings only; {REMEDY}")))
}

/// A word that is not a level. `EnvFilter` takes it for a module name, which is not what a mistyped level means.
fn unknown_level(text: &str) -> Option<&str> {
    // In a filter with span fields, a comma also separates fields.
    let mut words = text.split(',').map(str::trim).filter(|_| !text.contains('['));
    words.find(|word| !word.is_empty() && !word.contains('=') && word.parse::<LevelFilter>().is_err())
}

#[cfg(test)]
mod tests {
    use super::filter;

    #[test]
    fn an_invalid_filter_is_reported_in_one_line_with_the_remedy() {
        for (bad, wrong) in [
            ("debgu", "\"debgu\" is not a level"),
            ("warn,fringecell", "\"fringecell\" is not a level"),
            ("warn,fringecell::stage=loud", "expected one of"),
            ("warn,[", ""),
        ] {
            let (used, error) = filter(Some(bad));
            let error = error.expect(bad);
            assert_eq!(used.to_string(), "warn", "{bad}");
            assert!(error.contains(wrong) && error.contains("FRINGECELL_LOG=\""), "{error}");
            assert!(error.contains("use off, error") && error.lines().count() == 1, "{error}");
        }
    }

    #[test]
    fn valid_filters_are_accepted() {
        for good in
            ["debug", "OFF", "warn,fringecell::stage=debug", "info,ipc=trace", "warn,fringecell[step]=trace"]
        {
            let (_, error) = filter(Some(good));
            assert_eq!(error, None, "{good}");
        }
        assert!(filter(None).0.to_string().split(',').any(|part| part == "warn"));
        assert_eq!(filter(Some(" ")).1, None);
    }
}
