//! `plywave merge`: merges the parts of a run and writes its output.

use crate::args::{Cli, MergeArgs};
use crate::commands::runs;
use crate::commands::wave::compare;
use crate::failure::Outcome;
use crate::{output, report};
use plywave::Document;
use plywave_pipeline::Output;
use plywave_runs::Parts;
use std::path::Path;

/// Runs the command.
pub fn run(cli: &Cli, args: &MergeArgs) -> Outcome {
    let path = &args.output;
    let refuse = |e| runs::failure(e, &args.parts[0]);
    let inputs: Vec<&Path> = args.parts.iter().map(|p| p.as_path()).collect();
    let parts = Parts::open(&args.parts).map_err(refuse)?;
    let kind = parts.description().kind.clone();
    match kind.as_str() {
        "compare" => output::check_folder(path, compare::REPORT, &inputs)?,
        _ => output::check_writable(path, &inputs)?,
    }
    match plywave_pipeline::merge_parts(&parts).map_err(refuse)? {
        Output::Table(table) => table.save(path)?,
        Output::Fiber(fiber) => fiber.save(path)?,
        Output::Speckle(patterns) => patterns.save(path)?,
        Output::Compare(report) => compare::save(path, &report)?,
        Output::Twin(twin) => twin.save(path)?,
        Output::Scatter(report) => crate::commands::wave::wave_scatter::save(path, &report)?,
    }
    let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
    if cli.json {
        return output::print_json(&serde_json::json!({
            "output": path.display().to_string(), "bytes": bytes, "kind": kind, "shards": parts.shards(),
            "parts": args.parts.len(),
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}", path.display(), report::bytes(bytes))?;
        writeln!(out, "  {kind:<12} {} shards of {} parts", parts.shards(), args.parts.len())
    })
}
