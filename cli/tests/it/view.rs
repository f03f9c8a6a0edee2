//! `plywave view`: what its server answers, and what it refuses.

use crate::common::refused;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// The program, stopped when the test ends.
struct Served(Child);

impl Drop for Served {
    fn drop(&mut self) {
        drop(self.0.kill());
        drop(self.0.wait());
    }
}

/// A site of one page, in a folder.
fn site(folder: &Path) {
    let models = folder.join("site/models");
    std::fs::create_dir_all(&models).unwrap();
    std::fs::write(folder.join("site/index.html"), "<p>page</p>").unwrap();
    std::fs::write(models.join("index.json"), r#"["silk.pwm","polyester.pwm"]"#).unwrap();
}

fn asked(port: &str, request: &str) -> String {
    let mut stream = TcpStream::connect(format!("127.0.0.1:{port}")).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

#[test]
fn the_server_answers_this_machine_alone() {
    let folder = tempfile::tempdir().unwrap();
    site(folder.path());
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/models/polyester.pwm");
    let mut program = Command::new(env!("CARGO_BIN_EXE_plywave"));
    program.current_dir(folder.path()).arg("view").arg(&model).args(["--site", "site", "-q"]);
    let mut served = Served(program.stdout(Stdio::piped()).spawn().unwrap());
    let mut address = String::new();
    BufReader::new(served.0.stdout.take().unwrap()).read_line(&mut address).unwrap();
    let port = address.trim().trim_end_matches('/').rsplit(':').next().unwrap();

    let get = |path: &str, host: &str| asked(port, &format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n"));
    let own = format!("127.0.0.1:{port}");
    let page = get("/", &own);
    assert!(page.starts_with("HTTP/1.1 200") && page.ends_with("<p>page</p>"), "{page}");
    // The file comes first, and once.
    assert!(get("/models/index.json", &own).ends_with(r#"["polyester.pwm","silk.pwm"]"#));
    let bytes = std::fs::metadata(&model).unwrap().len();
    assert!(get("/models/polyester.pwm", &own).contains(&format!("Content-Length: {bytes}\r\n")));
    for other in ["/../Cargo.toml", "/%2e%2e/Cargo.toml", "/etc/passwd", "/models"] {
        assert!(get(other, &own).starts_with("HTTP/1.1 404"), "{other}");
    }
    assert!(get("/", "elsewhere.example").starts_with("HTTP/1.1 403"));
    assert!(asked(port, &format!("POST / HTTP/1.1\r\nHost: {own}\r\n\r\n")).starts_with("HTTP/1.1 405"));
    let head = asked(port, &format!("HEAD / HTTP/1.1\r\nHost: {own}\r\n\r\n"));
    assert!(head.ends_with("\r\n\r\n") && head.contains("Content-Length: 11"), "{head}");
    // Another program has the port.
    refused(folder.path(), &["view", "--site", "site", "--port", port], &["--port", port]);
}

#[test]
fn no_site_and_no_model_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    site(dir);
    std::fs::create_dir(dir.join("empty")).unwrap();
    std::fs::write(dir.join("note.txt"), "nothing").unwrap();
    refused(dir, &["view", "--site", "empty"], &["--site", "empty", "index.html"]);
    refused(dir, &["view", "--site", "absent"], &["--site", "absent"]);
    refused(dir, &["view", "note.txt", "--site", "site"], &["note.txt"]);
    refused(dir, &["view", "absent.pwm", "--site", "site"], &["absent.pwm"]);
}
