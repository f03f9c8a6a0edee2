//! The plywave command: simulate, fit, build, inspect, evaluate, check, compare and plot ply models.

mod args;
mod commands;
mod failure;
mod inputs;
mod kinds;
mod output;
mod plot;
mod progress;
mod rendering;
mod report;
mod strand_scene;
mod threads;
mod yarn_words;

use args::{Cli, Command, WaveCommand};
use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    if let Err(failure) = inputs::check_inputs(&cli.command) {
        return failure.report();
    }
    let outcome = match &cli.command {
        Command::Simulate(args) => commands::make::simulate::run(&cli, args),
        Command::Fit(args) => commands::make::fit::run(&cli, args),
        Command::Build(args) => commands::make::build::run(&cli, args),
        Command::Family(args) => commands::make::family::run(&cli, args),
        Command::Info(args) => commands::look::info::run(&cli, args),
        Command::Eval(args) => commands::look::eval::run(&cli, args),
        Command::Sample(args) => commands::look::sample::run(&cli, args),
        Command::Check(args) => commands::check::check::run(&cli, args),
        Command::Diff(args) => commands::look::diff::run(&cli, args),
        Command::Plot(args) => commands::look::plot::run(&cli, args),
        Command::Compare(args) => commands::wave::compare::run(&cli, args),
        Command::Export(args) => commands::picture::export::run(&cli, args),
        Command::Render(args) => commands::picture::render::run(&cli, args),
        Command::Merge(args) => commands::make::merge::run(&cli, args),
        Command::Noise(args) => commands::wave::noise::run(&cli, args),
        Command::Color(args) => commands::look::color::run(&cli, args),
        Command::Farm(args) => commands::make::farm::run(&cli, args),
        Command::Hairs(args) => commands::picture::hairs::run(&cli, args),
        Command::Twin(args) => commands::make::twin::run(&cli, args),
        Command::View(args) => commands::look::view::run(&cli, args),
        Command::New(args) => commands::make::new::run(&cli, args),
        Command::Swatch(args) => commands::make::swatch::run(&cli, args),
        Command::Weave(args) => commands::make::weave::run(&cli, args),
        Command::Completions(args) => commands::shell::completions(args),
        Command::Man(args) => commands::shell::man(&cli, args),
        Command::Wave(wave) => match &wave.command {
            WaveCommand::Scatter(args) => commands::wave::wave_scatter::run(&cli, args),
            WaveCommand::Speckle(args) => commands::wave::wave_speckle::run(&cli, args),
            WaveCommand::Tabulate(args) => commands::wave::wave_tabulate::run(&cli, args),
        },
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

/// Prints help and version to standard output, and an error of the command line as one line.
fn usage(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() {
        // A closed standard output is not an error here.
        let _ = error.print();
        return ExitCode::SUCCESS;
    }
    let text = error.render().to_string();
    let mut lines = text.lines().map(str::trim).filter(|l| !l.is_empty());
    // The command, as far as the arguments name a known one.
    let mut command = "plywave".to_string();
    let mut at = <Cli as clap::CommandFactory>::command();
    for word in std::env::args_os().skip(1) {
        let Some(next) = at.find_subcommand(&word).cloned() else { break };
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
