//! The command line: options that every command takes, and what they decide about the output.

use crate::output::{self, Settings};
use clap::error::ErrorKind;
use clap::{ArgMatches, ColorChoice, Command, CommandFactory, FromArgMatches};
use std::ffi::OsString;
use std::io::IsTerminal as _;
use std::path::PathBuf;

/// Options of every command.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct Global {
    /// Print errors, and nothing else.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Also print what is done: version, steps, duration and memory, on standard error.
    #[arg(long, short, global = true)]
    pub verbose: bool,
    /// Colours on a terminal, always, or never.
    #[arg(long, global = true, value_name = "WHEN", value_enum, default_value_t)]
    pub color: Color,
}

/// When the output has colours.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Color {
    /// On a terminal, unless NO_COLOR is set.
    #[default]
    Auto,
    /// On every standard error.
    Always,
    /// Never, wherever it goes.
    Never,
}

impl Color {
    fn choice(self) -> ColorChoice {
        match self {
            Self::Auto => ColorChoice::Auto,
            Self::Always => ColorChoice::Always,
            Self::Never => ColorChoice::Never,
        }
    }

    /// Whether standard error has colours.
    fn on_stderr(self) -> bool {
        match self {
            Self::Auto => {
                std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty())
            }
            Self::Always => true,
            Self::Never => false,
        }
    }
}

/// Parses the command line and decides where the output goes. `Err`: help was printed or the arguments are invalid; the
/// program ends with this exit code.
///
/// # Errors
/// See above.
pub fn parse<C: CommandFactory + FromArgMatches>() -> Result<C, u8> {
    let arguments: Vec<OsString> = std::env::args_os().collect();
    // The parser's own messages have colours, too.
    let color = color_of(&arguments);
    output::set_color(color.on_stderr());
    let version = C::command().render_version();
    let command = || C::command().color(color.choice());
    let parsed = command().try_get_matches_from(arguments).and_then(|matches| {
        output::set(settings(&matches, &mut command())?, version.trim_end());
        C::from_arg_matches(&matches)
    });
    parsed.map_err(|error| {
        let error = error.with_cmd(&command());
        if error.use_stderr() {
            // Standard error may be closed.
            let _ = error.print();
            return crate::BAD_INPUT;
        }
        // Help and version are output as any other: lost, they are an error.
        output::code_after(output::finish(|| output::is_there().and_then(|()| error.print())), 0)
    })
}

/// The value of `--color`, before anything is parsed.
fn color_of(arguments: &[OsString]) -> Color {
    let words: Vec<&str> = arguments.iter().map_while(|word| word.to_str()).collect();
    let value = words.iter().enumerate().find_map(|(place, word)| match word.strip_prefix("--color")? {
        "" => words.get(place + 1).copied(),
        value => value.strip_prefix('='),
    });
    match value {
        Some("always") => Color::Always,
        Some("never") => Color::Never,
        _ => Color::Auto,
    }
}

fn settings(matches: &ArgMatches, root: &mut Command) -> Result<Settings, clap::Error> {
    let (mut quiet, mut verbose, mut json_on_stdout) = (false, false, false);
    let mut command = Some(matches);
    while let Some(matches) = command {
        quiet |= matches.get_flag("quiet");
        verbose |= matches.get_flag("verbose");
        if let Ok(Some(file)) = matches.try_get_one::<PathBuf>("json") {
            json_on_stdout |= crate::is_stdout(file);
        }
        command = matches.subcommand().map(|(_, matches)| matches);
    }
    if quiet && verbose {
        return Err(root.error(ErrorKind::ArgumentConflict, "--quiet and --verbose exclude each other"));
    }
    Ok(Settings { quiet, verbose, json_on_stdout })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser as _;

    #[derive(Debug, clap::Parser)]
    struct Cli {
        #[command(flatten)]
        global: Global,
        #[command(subcommand)]
        command: Inner,
    }

    #[derive(Debug, clap::Subcommand)]
    enum Inner {
        One {
            #[arg(long)]
            json: Option<PathBuf>,
        },
        Two,
    }

    fn settings_of(words: &[&str]) -> Settings {
        settings(&Cli::command().try_get_matches_from(words).unwrap(), &mut Cli::command()).unwrap()
    }

    #[test]
    fn options_may_stand_before_or_after_the_command() {
        for words in [["x", "-q", "two"], ["x", "two", "--quiet"]] {
            assert!(settings_of(&words).quiet, "{words:?}");
            assert!(Cli::try_parse_from(words).unwrap().global.quiet, "{words:?}");
        }
        assert!(settings_of(&["x", "two", "--verbose"]).verbose);
        let both = Cli::command().try_get_matches_from(["x", "-q", "two", "-v"]).unwrap();
        assert!(settings(&both, &mut Cli::command()).is_err());
    }

    #[test]
    fn only_a_dash_takes_standard_output() {
        assert!(settings_of(&["x", "one", "--json", "-"]).json_on_stdout);
        assert!(!settings_of(&["x", "one", "--json", "./-"]).json_on_stdout);
        assert!(!settings_of(&["x", "one", "--json", "a.json"]).json_on_stdout);
        assert!(!settings_of(&["x", "two"]).json_on_stdout);
    }

    #[test]
    fn the_colour_is_known_before_the_arguments_are_parsed() {
        let of = |words: &[&str]| color_of(&words.iter().map(OsString::from).collect::<Vec<_>>());
        assert_eq!(of(&["x", "--color", "never", "one"]), Color::Never);
        assert_eq!(of(&["x", "one", "--color=always"]), Color::Always);
        assert_eq!(of(&["x", "one", "--color"]), Color::Auto);
        assert_eq!(of(&["x", "one", "--colors=always"]), Color::Auto);
    }
}
