//! Completion scripts and man pages, from the definition of the command line.

use clap::Command;
pub use clap_complete::Shell;
use std::io;

/// Command-line arguments of `completions`.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct Completions {
    /// Shell that completes the commands.
    #[arg(value_enum)]
    pub shell: Shell,
}

/// Command-line arguments of `man`.
#[derive(Debug, Clone, clap::Args)]
pub struct Man {
    /// Write the pages to this folder, a page per command.
    #[arg(long, value_name = "DIR")]
    pub out: std::path::PathBuf,
}

/// Prints the completion script of a program.
pub fn print_completions(mut command: Command, shell: Shell) {
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, name, &mut script);
    crate::output::raw(&script);
}

/// The man pages of a program and of each of its commands: names and contents.
///
/// # Errors
/// None: the pages are made in memory.
pub fn man_pages(command: Command) -> io::Result<Vec<(String, Vec<u8>)>> {
    let name = command.get_name().to_owned();
    let mut command = command.disable_help_subcommand(true);
    command.build();
    let mut pages = Vec::new();
    add(&command, &name, &mut pages)?;
    Ok(pages)
}

fn add(command: &Command, name: &str, pages: &mut Vec<(String, Vec<u8>)>) -> io::Result<()> {
    for inner in command.get_subcommands().filter(|command| !command.is_hide_set()) {
        add(inner, &format!("{name}-{}", inner.get_name()), pages)?;
    }
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone().display_name(name.to_owned())).render(&mut page)?;
    pages.push((format!("{name}.1"), page));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Arg;

    #[test]
    fn there_is_a_page_for_each_command_that_is_shown() {
        let inner = Command::new("inner").about("Does it.").arg(Arg::new("file").long("file"));
        let command = Command::new("program")
            .subcommand(Command::new("outer").subcommand(inner))
            .subcommand(Command::new("secret").hide(true));
        let pages = man_pages(command).unwrap();
        let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["program-outer-inner.1", "program-outer.1", "program.1"]);
        let page = String::from_utf8(pages[0].1.clone()).unwrap();
        assert!(page.contains("Does it.") && page.contains("\\-\\-file"), "{page}");
    }
}
