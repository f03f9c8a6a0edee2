//! `plywave view`: what its server answers, and what it refuses.

use crate::common::{plywave, refused, text};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The program with a site, stopped when the test ends.
struct Served {
    program: Child,
    port: String,
}

impl Drop for Served {
    fn drop(&mut self) {
        drop(self.program.kill());
        drop(self.program.wait());
    }
}

impl Served {
    /// A program that prints its address.
    fn start(mut command: Command) -> Served {
        let mut program = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut address = String::new();
        BufReader::new(program.stdout.take().unwrap()).read_line(&mut address).unwrap();
        let port = address.trim().trim_end_matches('/').rsplit(':').next().unwrap().to_string();
        Served { program, port }
    }

    /// The program with the site of `folder`.
    fn site(folder: &Path) -> Served {
        site(folder);
        Served::start(plywave(folder, &["view", "--site", "site", "-q"]))
    }

    /// A connection whose reads end after some seconds, so that no test waits for ever.
    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(format!("127.0.0.1:{}", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream
    }

    fn page(&self) -> String {
        let own = format!("127.0.0.1:{}", self.port);
        asked(&self.port, &format!("GET / HTTP/1.1\r\nHost: {own}\r\n\r\n"))
    }

    /// Whether the page is served within some seconds: places become free a moment after a connection ends.
    fn serves_again(&self) -> bool {
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(10) {
            if self.page().starts_with("HTTP/1.1 200") {
                return true;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        false
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
    // A server that has no place ends the connection with the request unread.
    let ended = stream.read_to_end(&mut answer);
    assert!(ended.is_ok() || answer.starts_with(b"HTTP/1.1 503"), "{ended:?}");
    String::from_utf8_lossy(&answer).into_owned()
}

#[test]
fn the_server_answers_this_machine_alone() {
    let folder = tempfile::tempdir().unwrap();
    site(folder.path());
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/models/polyester.pwm");
    let mut program = plywave(folder.path(), &["view", "--site", "site", "-q"]);
    program.arg(&model);
    let served = Served::start(program);
    let port = &*served.port;

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

/// 64 connections have all places, whoever holds them and says nothing.
#[test]
fn more_connections_than_there_is_room_for_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut served = Served::site(folder.path());
    let idle: Vec<TcpStream> = (0..64).map(|_| served.connect()).collect();
    for k in 0..36 {
        let mut answer = String::new();
        served.connect().read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 503") && answer.contains("too many connections"), "{k}: {answer}");
    }
    drop(idle);
    assert!(served.serves_again() && served.program.try_wait().unwrap().is_none());
}

/// A byte now and then, and none at all: both end when the time of a whole request is over.
#[test]
fn a_request_has_one_time_for_all_its_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let served = Served::site(folder.path());
    let begun = Instant::now();
    let (mut idle, mut slow) = (served.connect(), served.connect());
    slow.set_read_timeout(Some(Duration::from_millis(300))).unwrap();
    let (mut answer, mut piece) = (Vec::new(), [0; 1024]);
    loop {
        assert!(begun.elapsed() < Duration::from_secs(15), "held for {:?}", begun.elapsed());
        // Fails once the other side has gone, when the answer has come.
        drop(slow.write_all(b"G"));
        match slow.read(&mut piece) {
            Ok(0) => break,
            Ok(n) => answer.extend_from_slice(&piece[..n]),
            Err(error) if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => {}
            Err(_) => break,
        }
    }
    assert!(text(&answer).starts_with("HTTP/1.1 408"), "{}", text(&answer));
    drop(idle.read_to_end(&mut answer));
    let held = begun.elapsed();
    assert!(held > Duration::from_secs(4) && held < Duration::from_secs(15), "{held:?}");
    assert!(served.page().starts_with("HTTP/1.1 200"));
}

/// A reader of one byte now and then.
#[test]
#[ignore = "slow: 35 s: answers have a time"]
fn an_answer_has_one_time_for_all_its_bytes() {
    let folder = tempfile::tempdir().unwrap();
    site(folder.path());
    // More than the buffers of both sides.
    std::fs::write(folder.path().join("site/large.bin"), vec![1; 32 << 20]).unwrap();
    let served = Served::start(plywave(folder.path(), &["view", "--site", "site", "-q"]));
    let mut reader = served.connect();
    let own = format!("127.0.0.1:{}", served.port);
    write!(reader, "GET /large.bin HTTP/1.1\r\nHost: {own}\r\n\r\n").unwrap();
    let (begun, mut byte) = (Instant::now(), [0; 1]);
    // The server's thread is gone while the reader still has bytes to read.
    let threads = || std::fs::read_dir(format!("/proc/{}/task", served.program.id())).unwrap().count();
    // It is there once the first byte is.
    assert_eq!(reader.read(&mut byte).unwrap(), 1);
    while threads() > 1 {
        assert!(begun.elapsed() < Duration::from_secs(90), "held for {:?}", begun.elapsed());
        assert_eq!(reader.read(&mut byte).unwrap(), 1);
        std::thread::sleep(Duration::from_millis(200));
    }
    assert!(begun.elapsed() > Duration::from_secs(20), "{:?}", begun.elapsed());
}

/// Seconds that a program has computed.
#[cfg(target_os = "linux")]
fn computed(program: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{program}/stat")).unwrap();
    // After the name in parentheses: user and system time are the 12th and 13th, in hundredths.
    let numbers: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    (numbers[11].parse::<f64>().unwrap() + numbers[12].parse::<f64>().unwrap()) / 100.0
}

/// Where the system has no more descriptors, the server waits instead of trying without end.
#[cfg(target_os = "linux")]
#[test]
fn a_server_without_descriptors_waits() {
    let folder = tempfile::tempdir().unwrap();
    site(folder.path());
    let mut program = Command::new("sh");
    let command = format!("ulimit -n 20; exec '{}' view --site site -q", env!("CARGO_BIN_EXE_plywave"));
    program.current_dir(folder.path()).args(["-c", &command]);
    let served = Served::start(program);
    let held: Vec<TcpStream> = (0..40).map(|_| served.connect()).collect();
    std::thread::sleep(Duration::from_millis(300));
    let before = computed(served.program.id());
    std::thread::sleep(Duration::from_secs(1));
    let spent = computed(served.program.id()) - before;
    assert!(spent < 0.2, "{spent} s of one");
    drop(held);
    assert!(served.serves_again());
}

/// What is no viewer is not read into memory: 10 GB that take no room on the disk.
#[test]
fn a_vast_folder_is_no_site() {
    let folder = tempfile::tempdir().unwrap();
    site(folder.path());
    let vast = std::fs::File::create(folder.path().join("site/models/vast.bin")).unwrap();
    vast.set_len(10 << 30).unwrap();
    let begun = Instant::now();
    refused(
        folder.path(),
        &["view", "--site", "site"],
        &["--site = site", "256 MiB", "models/vast.bin", "viewer/dist"],
    );
    // Files of less, together more.
    vast.set_len(100 << 20).unwrap();
    for name in ["a", "b"] {
        std::fs::File::create(folder.path().join("site").join(name)).unwrap().set_len(100 << 20).unwrap();
    }
    refused(folder.path(), &["view", "--site", "site"], &["--site = site", "256 MiB"]);
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
}
