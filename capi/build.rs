//! Gives the shared library the name under which programs look for it, as cargo-c does: the first number of
//! the version that is not 0, and those before it.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let number = |name: &str| std::env::var(name).unwrap_or_default();
    let abi = match number("CARGO_PKG_VERSION_MAJOR").as_str() {
        "0" => format!("0.{}", number("CARGO_PKG_VERSION_MINOR")),
        major => major.to_string(),
    };
    match number("CARGO_CFG_TARGET_OS").as_str() {
        "macos" => println!("cargo::rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libplywave.{abi}.dylib"),
        "linux" | "freebsd" | "netbsd" | "openbsd" => {
            println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libplywave.so.{abi}");
        }
        _ => {}
    }
}
