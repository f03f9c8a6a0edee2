//! The server of `plywave view`: serves the files of a site to browsers on this machine, one request per
//! connection. Limits on number, duration and size of connections protect it from misbehaving clients.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// File contents by address, without the leading slash.
pub type Files = BTreeMap<String, Cow<'static, [u8]>>;

/// Largest number of simultaneous connections; a browser opens six.
const MAX_CONNECTIONS: usize = 64;
/// Largest request [bytes].
const MAX_REQUEST: usize = 1 << 14;
/// Time limit for a whole request, from the connection to its last byte.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time limit for an answer, and the slowest reader for which it suffices [bytes per second].
const ANSWER_PATIENCE: Duration = Duration::from_secs(30);
const SLOWEST: usize = 1 << 20;
/// Wait before the next attempt if the system cannot accept a connection.
const RETRY: Duration = Duration::from_millis(100);
/// Stack size of a connection's thread [bytes].
const STACK: usize = 256 << 10;

/// A slot among the connections, which is free again when dropped.
struct Taken(Arc<AtomicUsize>);

impl Taken {
    /// Takes a slot; `None` if all are taken.
    fn take(count: &Arc<AtomicUsize>) -> Option<Taken> {
        let next = |taken: usize| (taken < MAX_CONNECTIONS).then_some(taken + 1);
        count.fetch_update(Ordering::AcqRel, Ordering::Acquire, next).ok().map(|_| Taken(Arc::clone(count)))
    }
}

impl Drop for Taken {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Serves until the program ends.
pub fn serve(listener: &TcpListener, port: u16, files: Files) -> ! {
    let files = Arc::new(files);
    let count = Arc::new(AtomicUsize::new(0));
    loop {
        // Without file descriptors, connections wait in the system's queue until one of ours ends.
        let Ok((stream, _)) = listener.accept() else {
            std::thread::sleep(RETRY);
            continue;
        };
        let stream = Arc::new(stream);
        let Some(taken) = Taken::take(&count) else {
            refuse(&stream);
            continue;
        };
        let (own, files) = (Arc::clone(&stream), Arc::clone(&files));
        let work = move || {
            // A browser that closes the connection is not an error.
            let _ = converse(&own, port, &files);
            drop(taken);
        };
        // If no thread can be started, the browser receives the same refusal as for too many connections.
        if std::thread::Builder::new().stack_size(STACK).spawn(work).is_err() {
            refuse(&stream);
        }
    }
}

/// Refuses a connection without waiting.
fn refuse(stream: &TcpStream) {
    let sent = stream.set_nonblocking(true).and_then(|()| {
        let mut out = stream;
        let answer = Answer::text("503 Service Unavailable", b"too many connections: close some and try again");
        out.write_all(&answer.head())?;
        out.write_all(answer.body)?;
        out.shutdown(Shutdown::Write)?;
        // Pending input is read first, because closing with unread input would reset the connection before
        // the answer arrives.
        out.read(&mut [0; 4096])
    });
    // A failure to send the refusal is ignored.
    drop(sent);
}

/// Reads one request and sends its answer.
fn converse(stream: &TcpStream, port: u16, files: &Files) -> std::io::Result<()> {
    let request = match read_request(stream, Instant::now() + PATIENCE) {
        Ok(request) if request.is_empty() => return Ok(()),
        Ok(request) => request,
        Err(error) if is_late(&error) => {
            let answer = Answer::text("408 Request Timeout", b"the request took too long");
            return send(stream, &answer, true);
        }
        Err(error) => return Err(error),
    };
    let request = Request::parse(&String::from_utf8_lossy(&request));
    send(stream, &request.answer(port, files), request.method != "HEAD")
}

/// Whether a time limit was exceeded.
fn is_late(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
}

/// Time until `end`; an error if it has passed.
fn remaining(end: Instant) -> std::io::Result<Duration> {
    let remaining = end.saturating_duration_since(Instant::now());
    if remaining.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(remaining) }
}

/// The bytes of a request up to its empty line, at most [`MAX_REQUEST`].
fn read_request(mut stream: &TcpStream, end: Instant) -> std::io::Result<Vec<u8>> {
    let mut request = Vec::new();
    let mut piece = [0; 2048];
    while request.len() < MAX_REQUEST {
        stream.set_read_timeout(Some(remaining(end)?))?;
        match stream.read(&mut piece) {
            Ok(0) => break,
            Ok(n) => request.extend_from_slice(&piece[..n]),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
        let is_whole = |end: &[u8]| request.windows(end.len()).any(|window| window == end);
        if is_whole(b"\r\n\r\n") || is_whole(b"\n\n") {
            break;
        }
    }
    Ok(request)
}

/// Sends an answer; fails if the reader is too slow.
fn send(mut stream: &TcpStream, answer: &Answer<'_>, has_body: bool) -> std::io::Result<()> {
    let size = if has_body { answer.body.len() } else { 0 };
    let end = Instant::now() + ANSWER_PATIENCE + Duration::from_secs((size / SLOWEST) as u64);
    let head = answer.head();
    for mut rest in [&head[..], &answer.body[..size]] {
        while !rest.is_empty() {
            stream.set_write_timeout(Some(remaining(end)?))?;
            match stream.write(rest) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(n) => rest = &rest[n..],
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }
    stream.shutdown(Shutdown::Write)
}

/// A parsed request.
#[derive(Debug, Default)]
struct Request {
    method: String,
    /// Address without the leading slash, with `%xx` decoded.
    name: String,
    host: String,
}

impl Request {
    fn parse(text: &str) -> Request {
        let mut lines = text.lines();
        let mut words = lines.next().unwrap_or_default().split(' ');
        let (method, target) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        let name = decoded(target.split(['?', '#']).next().unwrap_or_default().trim_start_matches('/'));
        let headers = lines.take_while(|line| !line.is_empty()).filter_map(|line| line.split_once(':'));
        let host = headers.filter(|(name, _)| name.eq_ignore_ascii_case("host")).last();
        Request {
            method: method.into(),
            name: if name.is_empty() { "index.html".into() } else { name },
            host: host.map(|(_, value)| value.trim().into()).unwrap_or_default(),
        }
    }

    fn answer<'a>(&self, port: u16, files: &'a Files) -> Answer<'a> {
        // The host is checked so that a page of another name that resolves to this machine cannot read the
        // files.
        let is_own = [format!("127.0.0.1:{port}"), format!("localhost:{port}")].contains(&self.host);
        match files.get(&self.name) {
            _ if !matches!(&*self.method, "GET" | "HEAD") => Answer::text("405 Method Not Allowed", b"GET alone"),
            _ if !is_own => Answer::text("403 Forbidden", b"for this machine alone"),
            Some(bytes) => Answer { status: "200 OK", kind: type_of(&self.name), body: bytes },
            None => Answer::text("404 Not Found", b"no such file"),
        }
    }
}

/// An answer to a request.
struct Answer<'a> {
    status: &'static str,
    kind: &'static str,
    body: &'a [u8],
}

impl<'a> Answer<'a> {
    fn text(status: &'static str, body: &'a [u8]) -> Self {
        Answer { status, kind: "text/plain", body }
    }

    fn head(&self) -> Vec<u8> {
        let (status, kind, length) = (self.status, self.kind, self.body.len());
        format!(
            "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nCache-Control: no-store\r\n\
             X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n"
        )
        .into_bytes()
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

/// An address with `%xx` decoded.
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
    use super::*;

    #[test]
    fn addresses_are_decoded() {
        assert_eq!(decoded("models/a%20b%C3%A4.pwc"), "models/a bä.pwc");
        assert_eq!(decoded("100%"), "100%");
    }

    #[test]
    fn requests_are_read() {
        let request = Request::parse("GET /a.js?x#y HTTP/1.1\r\naccept: */*\r\nhOsT:  localhost:8 \r\n\r\nHost: b\r\n");
        assert_eq!([&request.method, &request.name, &request.host], ["GET", "a.js", "localhost:8"]);
        assert_eq!(Request::parse("").name, "index.html");
    }

    #[test]
    fn places_are_counted() {
        let count = Arc::new(AtomicUsize::new(0));
        let all: Vec<_> = (0..MAX_CONNECTIONS).map(|_| Taken::take(&count).unwrap()).collect();
        assert!(Taken::take(&count).is_none());
        drop(all);
        assert!(Taken::take(&count).is_some());
    }
}
