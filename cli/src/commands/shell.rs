//! `plywave completions` and `plywave man`: what a shell and its manual need, generated from the flags
//! themselves.

use crate::args::{Cli, CompletionsArgs, ManArgs};
use crate::failure::{Failure, Outcome};
use crate::output;
use clap::CommandFactory;

/// Prints the completions of a shell.
pub fn completions(args: &CompletionsArgs) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "plywave", &mut script);
    output::print(|out| out.write_all(&script))
}

/// Prints the manual page, or writes the pages of all commands.
pub fn man(cli: &Cli, args: &ManArgs) -> Outcome {
    let Some(folder) = &args.output else {
        return output::print(|out| clap_mangen::Man::new(Cli::command()).render(out));
    };
    let written = std::fs::create_dir_all(folder).and_then(|()| clap_mangen::generate_to(Cli::command(), folder));
    written.map_err(|e| Failure::input(folder.display(), "-o", e, "choose a folder that can be written"))?;
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| writeln!(out, "{}: manual pages of plywave and its commands", folder.display()))
}
