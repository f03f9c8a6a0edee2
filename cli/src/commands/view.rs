//! `plywave view`: serves the viewer and a model to a browser on this machine.

use super::cloth_file;
use crate::args::{Cli, ViewArgs};
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, Kind};
use crate::output;
use plywave::PlyModel;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Files of the site in the program: addresses and contents.
static SITE: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/site.rs"));
/// Largest request [bytes].
const MAX_REQUEST: u64 = 1 << 14;
/// List of the models that the site has.
const INDEX: &str = "models/index.json";
/// Longest that a browser may take to ask or to read.
const PATIENCE: Duration = Duration::from_secs(30);

/// Contents by address, without the first slash.
type Files = BTreeMap<String, Cow<'static, [u8]>>;

/// Runs the command.
pub fn run(cli: &Cli, args: &ViewArgs) -> Outcome {
    let mut files = site(args)?;
    if let Some(file) = &args.file {
        let (name, bytes) = model(cli, file)?;
        files.insert(format!("models/{name}"), Cow::Owned(bytes));
        // The page shows the first of the list.
        let mut names: Vec<String> =
            files.get(INDEX).and_then(|index| serde_json::from_slice(index).ok()).unwrap_or_default();
        names.retain(|other| *other != name);
        names.insert(0, name);
        let index = serde_json::to_vec(&names).map_err(|e| Failure::Input(format!("list of models: {e}")))?;
        files.insert(INDEX.into(), Cow::Owned(index));
    }
    let refused = |e: std::io::Error| Failure::input("command line", "--port", args.port, &format!("{e}; use another"));
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, args.port)).map_err(refused)?;
    let port = listener.local_addr().map_err(refused)?.port();
    output::print(|out| {
        writeln!(out, "http://127.0.0.1:{port}/")?;
        out.flush()
    })?;
    if !cli.quiet {
        eprintln!("open this address in a browser; Ctrl-C ends");
    }
    let files = Arc::new(files);
    for stream in listener.incoming().flatten() {
        let files = Arc::clone(&files);
        // A browser that goes away in between is no fault.
        std::thread::spawn(move || drop(answer(&stream, port, &files)));
    }
    Ok(())
}

/// The site, of the program or of a folder.
fn site(args: &ViewArgs) -> Outcome<Files> {
    let mut files: Files = SITE.iter().map(|(name, bytes)| ((*name).to_string(), Cow::Borrowed(*bytes))).collect();
    if let Some(folder) = &args.site {
        files.clear();
        let refused = |e: std::io::Error| Failure::input("command line", "--site", folder.display(), &e.to_string());
        read(folder, "", &mut files).map_err(refused)?;
    }
    if files.contains_key("index.html") {
        return Ok(files);
    }
    Err(match &args.site {
        Some(folder) => Failure::input(
            "command line",
            "--site",
            folder.display(),
            "has no index.html; give the folder that `npm run build` makes, viewer/dist",
        ),
        None => Failure::Input(
            "view: this program was built without the viewer; make it (viewer/README.md) and give --site viewer/dist"
                .into(),
        ),
    })
}

fn read(folder: &Path, prefix: &str, files: &mut Files) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        match entry.file_type()? {
            kind if kind.is_dir() => read(&entry.path(), &format!("{name}/"), files)?,
            kind if kind.is_file() => drop(files.insert(name, Cow::Owned(std::fs::read(entry.path())?))),
            _ => (),
        }
    }
    Ok(())
}

/// Name and bytes of the file to show; a cloth spec becomes its cloth.
fn model(cli: &Cli, file: &Path) -> Outcome<(String, Vec<u8>)> {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    match kinds::kind_of(file) {
        Some(Kind::Model) => {
            let (_, bytes) = cli.library()?.read(file)?;
            PlyModel::from_bytes(&bytes, &file.display().to_string())?;
            Ok((format!("{stem}.pwm"), bytes))
        }
        _ => Ok((format!("{stem}.pwc"), cloth_file::ready(cli, file)?.data.to_bytes()?)),
    }
}

fn type_of(name: &str) -> &'static str {
    match Path::new(name).extension().and_then(|ending| ending.to_str()) {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript",
        Some("css") => "text/css",
        Some("wasm") => "application/wasm",
        Some("json") => "application/json",
        _ => "application/octet-stream",
    }
}

/// Answers one request.
fn answer(stream: &TcpStream, port: u16, files: &Files) -> std::io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut lines = BufReader::new(stream.take(MAX_REQUEST)).lines();
    let request = lines.next().unwrap_or_else(|| Ok(String::new()))?;
    let mut host = String::new();
    for line in lines {
        let line = line?;
        if line.is_empty() {
            break;
        }
        if let Some((name, value)) = line.split_once(':')
            && name.eq_ignore_ascii_case("host")
        {
            host = value.trim().to_string();
        }
    }
    let mut words = request.split(' ');
    let (method, target) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let name = decoded(target.split(['?', '#']).next().unwrap_or_default().trim_start_matches('/'));
    let name = if name.is_empty() { "index.html" } else { &name };
    // A page of another name that resolves to this machine is not to read the files.
    let is_own = [format!("127.0.0.1:{port}"), format!("localhost:{port}")].contains(&host);
    let (status, kind, body): (_, _, &[u8]) = match files.get(name) {
        _ if !matches!(method, "GET" | "HEAD") => ("405 Method Not Allowed", "text/plain", b"GET alone"),
        _ if !is_own => ("403 Forbidden", "text/plain", b"for this machine alone"),
        Some(bytes) => ("200 OK", type_of(name), bytes),
        None => ("404 Not Found", "text/plain", b"no such file"),
    };
    let mut out = stream;
    let length = body.len();
    write!(
        out,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n"
    )?;
    if method != "HEAD" {
        out.write_all(body)?;
    }
    out.flush()
}

/// An address with its `%xx` as characters.
fn decoded(text: &str) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((first, after)) = rest.split_first() {
        let code = after.get(..2).and_then(|hex| std::str::from_utf8(hex).ok());
        match code.and_then(|hex| u8::from_str_radix(hex, 16).ok()).filter(|_| *first == b'%') {
            Some(byte) => {
                bytes.push(byte);
                rest = &after[2..];
            }
            None => {
                bytes.push(*first);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    #[test]
    fn addresses_are_decoded() {
        assert_eq!(super::decoded("models/a%20b%C3%A4.pwc"), "models/a bä.pwc");
        assert_eq!(super::decoded("100%"), "100%");
    }
}
