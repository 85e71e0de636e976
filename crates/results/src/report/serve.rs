//! A viewer of 3D Tiles for one person on one machine: a page and the files of a tileset over HTTP, on loopback.
//!
//! | path | is |
//! |---|---|
//! | `/` | the viewer |
//! | `/tiles/…` | the files of the tileset: `.json` and `.glb`, nothing else |
//! | `/report.html` | the report beside it, where there is one |
//!
//! It listens on 127.0.0.1 only, answers `GET` and `HEAD` of requests for its own name only (a page elsewhere whose name
//! is bent to this machine gets nothing), and leaves its folder neither by `..` nor through links.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufRead as _, BufReader, Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::page;
use super::tileset::TILESET;
use crate::output::OutputError;
use crate::output::read::ReadError;
use sizeup_geo::files::FileError;
use sizeup_geo::paths::within;

/// Connections that are attended to at the same time, each by a thread; a browser asks for six files at a time. Whoever
/// comes on top takes the place of the one that has kept silent for longest.
const MAX_CONNECTIONS: usize = 64;
/// A request's head is at most this long, bytes.
const MAX_HEAD: u64 = 16 << 10;
/// So long the head of a request may take in all, and each piece of an answer.
const PATIENCE: Duration = Duration::from_secs(10);
/// The report beside a tileset.
const REPORT: &str = "report.html";

/// Why nothing can be served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The folder holds no tileset, and nothing that one could be made of.
    #[error(
        "{} holds neither {TILESET} nor city.city.json\nhint: name the folder of a result, or of `sizeup export … --to 3dtiles`",
        path.display()
    )]
    NoTileset {
        /// The folder that was named.
        path: PathBuf,
    },
    /// The port cannot be had.
    #[error(
        "cannot listen on 127.0.0.1:{port}: {source}\nhint: is another one running? `--port 0` takes any free port"
    )]
    Port {
        /// Port that was to be listened on.
        port: u16,
        /// Error that the system reported.
        source: io::Error,
    },
    /// The city does not say where it is.
    #[error("{} states no CRS\nhint: `sizeup export --crs EPSG:… --to 3dtiles` makes tiles of it", path.display())]
    NoCrs {
        /// The file of the city.
        path: PathBuf,
    },
    /// The city cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// No tiles can be made of it.
    #[error(transparent)]
    Tiles(#[from] OutputError),
    /// The folder cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
}

/// A server that is ready to answer.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    port: u16,
    tiles: PathBuf,
    report: Option<PathBuf>,
    page: String,
}

/// An HTTP answer: its status line, media type and content.
struct HttpAnswer {
    status: &'static str,
    media_type: &'static str,
    body: Body,
}

enum Body {
    Text(String),
    File(File, u64),
}

impl Server {
    /// Takes a port of loopback (0: any) for the tileset in `tiles`, with the report of `result` where there is one.
    ///
    /// # Errors
    /// [`ServeError`].
    pub fn bind(tiles: &Path, result: &Path, port: u16) -> Result<Self, ServeError> {
        if !tiles.join(TILESET).is_file() {
            return Err(ServeError::NoTileset { path: tiles.to_owned() });
        }
        let whole = |path: &Path| path.canonicalize().map_err(FileError::on("cannot read", path));
        let listener =
            TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(|source| ServeError::Port { port, source })?;
        let address = listener.local_addr().map_err(|source| ServeError::Port { port, source })?;
        let report = Some(result.join(REPORT)).filter(|path| path.is_file());
        let name = result.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Ok(Self { listener, port: address.port(), tiles: whole(tiles)?, report, page: page::view(&name) })
    }

    /// Address of the viewer.
    #[must_use]
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    /// Answers until the process ends.
    pub fn run(&self) {
        let silent = Silent::default();
        std::thread::scope(|scope| {
            for (number, stream) in self.listener.incoming().enumerate() {
                // What goes wrong with one client is that client's: it sees its connection closed.
                let Ok(stream) = stream else { continue };
                silent.enter(number, &stream);
                let silent = &silent;
                let attend = move || {
                    let head = patient(&stream).and_then(|()| read_head(&stream));
                    silent.leave(number);
                    let _ = head.and_then(|head| head.map_or(Ok(()), |head| self.attend(&stream, &head)));
                };
                // Without a thread the connection is closed.
                let _ = std::thread::Builder::new().stack_size(STACK).spawn_scoped(scope, attend);
            }
        });
    }

    /// Answers one request.
    ///
    /// # Errors
    /// Where the request cannot be read as text, or the answer not be written. One that is cut off or too long has no answer.
    pub fn answer_one(&self, request: impl Read, reply: impl Write) -> io::Result<()> {
        read_head(request)?.map_or(Ok(()), |head| self.attend(reply, &head))
    }

    fn attend(&self, reply: impl Write, head: &RequestHead) -> io::Result<()> {
        let mut words = head.first.split_ascii_whitespace();
        let (method, target) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        send(reply, self.answer(method, target, head.host.as_deref()), method == "HEAD")
    }

    fn answer(&self, method: &str, target: &str, host: Option<&str>) -> HttpAnswer {
        let own = [format!("127.0.0.1:{}", self.port), format!("localhost:{}", self.port)];
        if !host.is_some_and(|host| own.iter().any(|name| name == host)) {
            return HttpAnswer::refusal("421 Misdirected Request");
        }
        if !matches!(method, "GET" | "HEAD") {
            return HttpAnswer::refusal("405 Method Not Allowed");
        }
        let path = target.split(['?', '#']).next().unwrap_or_default();
        let found = match path {
            "/" => return HttpAnswer { status: OK, media_type: HTML, body: Body::Text(self.page.clone()) },
            "/report.html" => self.report.clone().map(|path| (path, HTML)),
            _ => path.strip_prefix("/tiles/").and_then(|name| self.tile(name)),
        };
        let open = |(path, media_type)| {
            let file = File::open(path).ok()?;
            let length = file.metadata().ok()?.len();
            Some(HttpAnswer { status: OK, media_type, body: Body::File(file, length) })
        };
        found.and_then(open).unwrap_or_else(|| HttpAnswer::refusal("404 Not Found"))
    }

    /// The file of a name within the tileset, and what it is.
    fn tile(&self, name: &str) -> Option<(PathBuf, &'static str)> {
        let name = decoded(name)?;
        let name = within(&name)?;
        let media_type = match name.extension()?.to_str()? {
            "json" => "application/json",
            "glb" => "model/gltf-binary",
            _ => return None,
        };
        let path = self.tiles.join(name).canonicalize().ok()?;
        (path.starts_with(&self.tiles) && path.is_file()).then_some((path, media_type))
    }
}

/// Request of a client.
struct RequestHead {
    first: String,
    host: Option<String>,
}

/// Stack of a thread that answers, bytes: it holds no more than a head and a piece of a file.
const STACK: usize = 256 << 10;

/// Waits so long for a client and no longer.
fn patient(stream: &TcpStream) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))
}

/// Reads the head of a request; `None` where it is cut off, too long or too slow.
fn read_head(request: impl Read) -> io::Result<Option<RequestHead>> {
    let start = Instant::now();
    let mut lines = BufReader::new(request.take(MAX_HEAD));
    let mut head = RequestHead { first: String::new(), host: None };
    lines.read_line(&mut head.first)?;
    loop {
        let mut line = String::new();
        if lines.read_line(&mut line)? == 0 || start.elapsed() > PATIENCE {
            return Ok(None);
        }
        let line = line.trim_end();
        if line.is_empty() {
            return Ok(Some(head));
        }
        if let Some((name, value)) = line.split_once(':')
            && name.eq_ignore_ascii_case("host")
        {
            head.host = Some(value.trim().to_ascii_lowercase());
        }
    }
}

/// Connections that have not asked for anything yet, oldest first: no number of them keeps others waiting.
#[derive(Default)]
struct Silent(Mutex<VecDeque<(usize, TcpStream)>>);

impl Silent {
    /// One more; the oldest of too many is closed, which ends its thread.
    fn enter(&self, number: usize, stream: &TcpStream) {
        let mut silent = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if silent.len() >= MAX_CONNECTIONS
            && let Some((_, oldest)) = silent.pop_front()
        {
            // It may have gone by itself.
            let _ = oldest.shutdown(Shutdown::Both);
        }
        if let Ok(stream) = stream.try_clone() {
            silent.push_back((number, stream));
        }
    }

    /// It has asked, or gone.
    fn leave(&self, number: usize) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).retain(|(other, _)| *other != number);
    }
}

const OK: &str = "200 OK";
const HTML: &str = "text/html; charset=utf-8";

impl HttpAnswer {
    fn refusal(status: &'static str) -> Self {
        Self { status, media_type: "text/plain", body: Body::Text(format!("{status}\n")) }
    }
}

fn send(mut stream: impl Write, answer: HttpAnswer, is_head: bool) -> io::Result<()> {
    let length = match &answer.body {
        Body::Text(text) => text.len() as u64,
        Body::File(_, length) => *length,
    };
    write!(
        stream,
        "HTTP/1.1 {}\r\nContent-Type: {}\r\nContent-Length: {length}\r\nConnection: close\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\nX-Frame-Options: DENY\r\nReferrer-Policy: no-referrer\r\n\
         Cross-Origin-Resource-Policy: same-origin\r\n\r\n",
        answer.status, answer.media_type
    )?;
    match answer.body {
        _ if is_head => {}
        Body::Text(text) => stream.write_all(text.as_bytes())?,
        Body::File(file, length) => drop(io::copy(&mut file.take(length), &mut stream)?),
    }
    stream.flush()
}

/// `%20` and the like as what they stand for; `None` where that is not text, or holds what no name of ours does.
fn decoded(name: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(name.len());
    let mut rest = name.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        if first == b'%' {
            let digits = std::str::from_utf8(after.get(..2)?).ok()?;
            bytes.push(u8::from_str_radix(digits, 16).ok()?);
            rest = &after[2..];
        } else {
            bytes.push(first);
            rest = after;
        }
    }
    String::from_utf8(bytes).ok().filter(|name| !name.contains(['\\', '\0', ':']))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn server(folder: &Path) -> Server {
        let tiles = folder.join("tiles");
        std::fs::create_dir_all(tiles.join("tiles")).unwrap();
        std::fs::write(tiles.join(TILESET), "{}").unwrap();
        std::fs::write(tiles.join("tiles/a b.glb"), "glTF").unwrap();
        std::fs::write(tiles.join("notes.txt"), "no").unwrap();
        std::fs::write(folder.join("secret.json"), "no").unwrap();
        Server::bind(&tiles, folder, 0).unwrap()
    }

    #[test]
    fn only_the_tilesets_own_files_are_served() {
        let folder = tempfile::tempdir().unwrap();
        let server = server(folder.path());
        let host = format!("127.0.0.1:{}", server.port);
        let status = |target: &str| server.answer("GET", target, Some(&host)).status;
        for target in ["/", "/tiles/tileset.json", "/tiles/tileset.json?v=1", "/tiles/tiles/a%20b.glb"] {
            assert_eq!(status(target), OK, "{target}");
        }
        for target in [
            "/tiles/../secret.json",
            "/tiles/%2e%2e/secret.json",
            "/tiles/tiles/../../secret.json",
            "/tiles//etc/hosts.json",
            "/tiles/%2fetc%2fhosts.json",
            "/tiles/..%5csecret.json",
            "/tiles/notes.txt",
            "/tiles/",
            "/tiles/%",
            "/tiles/%ff.glb",
            "/secret.json",
            "/report.html",
            "tiles/tileset.json",
            "",
        ] {
            assert_eq!(status(target), "404 Not Found", "{target}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(folder.path().join("secret.json"), folder.path().join("tiles/link.json"))
                .unwrap();
            assert_eq!(status("/tiles/link.json"), "404 Not Found");
        }
    }

    #[test]
    fn requests_for_other_names_and_other_methods_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let server = server(folder.path());
        let own = format!("localhost:{}", server.port);
        assert_eq!(server.answer("HEAD", "/", Some(&own)).status, OK);
        for host in [None, Some("evil.example"), Some("127.0.0.1"), Some("127.0.0.1:1")] {
            assert_eq!(server.answer("GET", "/", host).status, "421 Misdirected Request", "{host:?}");
        }
        assert_eq!(server.answer("POST", "/", Some(&own)).status, "405 Method Not Allowed");
    }

    #[test]
    fn silent_connections_keep_nobody_waiting() {
        let folder = tempfile::tempdir().unwrap();
        let server = Box::leak(Box::new(server(folder.path())));
        let address = ("127.0.0.1", server.port);
        let host = format!("127.0.0.1:{}", server.port);
        std::thread::spawn(|| server.run());
        // Some that say nothing, and some that never come to the end.
        let silent: Vec<TcpStream> = (0..3 * MAX_CONNECTIONS)
            .map(|i| {
                let mut stream = TcpStream::connect(address).unwrap();
                if i % 2 == 1 {
                    let _ = stream.write_all(b"GET / HTTP/1.1\r\nA: ");
                }
                stream
            })
            .collect();
        let start = Instant::now();
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(format!("GET /tiles/tileset.json HTTP/1.1\r\nHost: {host}\r\n\r\n").as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200 OK") && answer.ends_with("{}"), "{answer}");
        assert!(start.elapsed() < PATIENCE / 2, "{:?}", start.elapsed());
        drop(silent);
    }

    #[test]
    fn a_folder_without_a_tileset_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = Server::bind(folder.path(), folder.path(), 0).unwrap_err().to_string();
        assert!(error.contains(TILESET) && error.contains("hint: "), "{error}");
    }
}
