//! The plywave command: simulate, fit, build, inspect, evaluate, check, compare and plot ply models.

mod args;
mod commands;
mod failure;
mod kinds;
mod output;
mod plot;
mod progress;
mod rendering;
mod report;
mod strand_scene;
mod yarn_words;

use args::{Cli, Command, WaveCommand};
use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    if let Err(failure) = kinds::check_inputs(&cli.command) {
        return failure.report();
    }
    let outcome = match &cli.command {
        Command::Simulate(args) => commands::simulate::run(&cli, args),
        Command::Fit(args) => commands::fit::run(&cli, args),
        Command::Build(args) => commands::build::run(&cli, args),
        Command::Family(args) => commands::family::run(&cli, args),
        Command::Info(args) => commands::info::run(&cli, args),
        Command::Eval(args) => commands::eval::run(&cli, args),
        Command::Sample(args) => commands::sample::run(&cli, args),
        Command::Check(args) => commands::check::run(&cli, args),
        Command::Diff(args) => commands::diff::run(&cli, args),
        Command::Plot(args) => commands::plot::run(&cli, args),
        Command::Compare(args) => commands::compare::run(&cli, args),
        Command::Export(args) => commands::export::run(&cli, args),
        Command::Render(args) => commands::render::run(&cli, args),
        Command::Merge(args) => commands::merge::run(&cli, args),
        Command::Noise(args) => commands::noise::run(&cli, args),
        Command::Color(args) => commands::color::run(&cli, args),
        Command::Farm(args) => commands::farm::run(&cli, args),
        Command::Hairs(args) => commands::hairs::run(&cli, args),
        Command::Twin(args) => commands::twin::run(&cli, args),
        Command::View(args) => commands::view::run(&cli, args),
        Command::New(args) => commands::new::run(&cli, args),
        Command::Weave(args) => commands::weave::run(&cli, args),
        Command::Completions(args) => commands::shell::completions(args),
        Command::Man(args) => commands::shell::man(&cli, args),
        Command::Wave(wave) => match &wave.command {
            WaveCommand::Scatter(args) => commands::wave_scatter::run(&cli, args),
            WaveCommand::Speckle(args) => commands::wave_speckle::run(&cli, args),
            WaveCommand::Tabulate(args) => commands::wave_tabulate::run(&cli, args),
        },
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

/// Help and version go to standard output; what is wrong with the command line becomes one line.
fn usage(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() {
        // A reader that went away has read enough.
        let _ = error.print();
        return ExitCode::SUCCESS;
    }
    let text = error.render().to_string();
    let mut lines = text.lines().map(str::trim).filter(|l| !l.is_empty());
    // The command as far as the arguments name a known one.
    let mut command = "plywave".to_string();
    let mut at = <Cli as clap::CommandFactory>::command();
    for asked in std::env::args_os().skip(1) {
        let Some(next) = at.find_subcommand(&asked).cloned() else { break };
        command = format!("{command} {}", next.get_name());
        at = next;
    }
    let commands = || at.get_subcommands().map(clap::Command::get_name).collect::<Vec<_>>().join(", ");
    use clap::error::ErrorKind;
    let what = match error.kind() {
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::MissingSubcommand => {
            format!("no command given, expected one of {}", commands())
        }
        kind => {
            let said: Vec<&str> =
                lines.by_ref().take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more")).collect();
            let said = said.join(" ").trim_start_matches("error: ").to_string();
            match kind {
                ErrorKind::InvalidSubcommand if !said.contains("tip:") => {
                    format!("{said}, expected one of {}", commands())
                }
                _ => said,
            }
        }
    };
    failure::Failure::Input(format!("{what}; see {command} --help")).report()
}
