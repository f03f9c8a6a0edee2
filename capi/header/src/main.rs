//! Makes `capi/include/plywave.h` of the crate `plywave-capi`. With `--check` it writes nothing and fails
//! where the file differs.

use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let check = match std::env::args().nth(1).as_deref() {
        None => false,
        Some("--check") => true,
        Some(other) => {
            eprintln!("{other}: expected --check or nothing");
            return ExitCode::from(2);
        }
    };
    let capi = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let path = capi.join("include/plywave.h");
    let made = match cbindgen::generate(&capi) {
        Ok(bindings) => {
            let mut text = Vec::new();
            bindings.write(&mut text);
            text
        }
        Err(error) => {
            eprintln!("cbindgen: {error}");
            return ExitCode::FAILURE;
        }
    };
    if !check {
        if let Err(error) = std::fs::write(&path, made) {
            eprintln!("{}: {error}", path.display());
            return ExitCode::FAILURE;
        }
        return ExitCode::SUCCESS;
    }
    match std::fs::read(&path) {
        Ok(found) if found == made => ExitCode::SUCCESS,
        Ok(_) => {
            eprintln!("capi/include/plywave.h is not what capi/src declares: run capi/header.sh");
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("{}: {error}", path.display());
            ExitCode::FAILURE
        }
    }
}
