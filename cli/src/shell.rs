//! `rayo completions` and `rayo man`: shell completions and manual pages of all commands.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, CommandFactory};
use clap_complete::Shell;
use clap_mangen::Man;

use super::measuring::{create_directory, write_file};
use super::{Cli, Failure, write_out};

/// Print the completions of commands and options for a shell
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo completions bash > ~/.local/share/bash-completion/completions/rayo
  rayo completions zsh > ~/.zfunc/_rayo
  rayo completions fish > ~/.config/fish/completions/rayo.fish")]
pub struct CompletionsArgs {
    shell: Shell,
}

/// Print the manual page, or with --out write one for each command
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo man > rayo.1
  rayo man | man -l -
  rayo man --out ~/.local/share/man/man1")]
pub struct ManArgs {
    /// Write rayo.1, rayo-render.1 and so on to this directory
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Prints the completions.
pub fn completions(args: &CompletionsArgs) -> Result<ExitCode, Failure> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "rayo", &mut text);
    write_out(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// Prints the manual page, or writes all pages.
pub fn man(args: &ManArgs) -> Result<ExitCode, Failure> {
    let mut command = Cli::command().disable_help_subcommand(true);
    // `build` sets the full names of subcommands.
    command.build();
    let Some(directory) = &args.out else {
        write_out(&page(&Man::new(command))?)?;
        return Ok(ExitCode::SUCCESS);
    };
    create_directory(directory)?;
    let commands: Vec<_> = command.get_subcommands().cloned().collect();
    for command in [command].into_iter().chain(commands) {
        let man = Man::new(command);
        write_file(directory, &man.get_filename(), &page(&man)?)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn page(man: &Man) -> Result<Vec<u8>, Failure> {
    let mut text = Vec::new();
    man.render(&mut text).map_err(Failure::output)?;
    // clap_mangen gives the text below a command's help no proper heading.
    Ok(String::from_utf8_lossy(&text).replace(".SH EXTRA\nExamples:\n", ".SH EXAMPLES\n").into_bytes())
}
