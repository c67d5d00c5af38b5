//! Places that open sockets. `SECURITY.md` describes them all; another one would make it false.

use crate::findings::Finding;
use crate::sources::Sources;

/// Files that may listen or connect: both servers, the checks of free addresses, and the client.
const PLACES: [&str; 5] = [
    "crates/listener/src/lib.rs",
    "src/app/doctor/facts.rs",
    "src/app/live/check.rs",
    "src/cli/demo.rs",
    "drivers/src/transport/tcp.rs",
];
/// Types that listen, and those of other protocols.
const LISTENERS: [&str; 6] = ["TcpListener", "TcpSocket", "UdpSocket", "UnixDatagram", "UnixListener", "UnixStream"];

/// Returns the other places of the program where a socket is opened. Tests may open any.
pub(crate) fn check(sources: &Sources) -> Vec<Finding> {
    let mut findings = Vec::new();
    let is_program =
        |path: &str| ["src/", "crates/", "drivers/src/", "calibration/src/"].iter().any(|f| path.starts_with(f));
    let is_test = |path: &str| path.contains("/tests/") || path.ends_with("/tests.rs");
    for source in sources.rust().filter(|source| is_program(&source.path) && !is_test(&source.path)) {
        if PLACES.contains(&source.path.as_str()) {
            continue;
        }
        let code = source.code();
        let tests = code.windows(6).position(|w| w[0].text == "cfg" && w[2].text == "test" && w[5].text == "mod");
        let code = &code[..tests.unwrap_or(code.len())];
        for (at, name) in code.iter().enumerate() {
            let connects = code[at..].iter().take(4).any(|next| next.text.starts_with("connect"));
            if LISTENERS.contains(&name.text) || (name.text == "TcpStream" && connects) {
                let sentence = "opens a socket; use the crate listener or the driver's, or describe it in SECURITY.md";
                findings.push(Finding::new(&source.path, name.line, sentence));
            }
        }
    }
    findings
}

#[test]
fn sockets_elsewhere_are_found() {
    let sources = Sources::of(&[
        (
            "src/app/live.rs",
            "fn f(s: TcpStream) {}\nfn g() { TcpListener::bind(a); }\nfn h() { TcpStream::connect(a); }\n",
        ),
        ("crates/listener/src/lib.rs", "fn f() { TcpListener::bind(a); }\n"),
        ("src/app/a.rs", "fn f() {}\n#[cfg(test)]\nmod tests { use std::net::UdpSocket; }\n"),
        ("crates/console/src/tests/a.rs", "use std::net::UdpSocket;\n"),
    ]);
    let found: Vec<(String, usize)> = check(&sources).into_iter().map(|f| (f.file, f.line)).collect();
    assert_eq!(found, [("src/app/live.rs".to_owned(), 2), ("src/app/live.rs".to_owned(), 3)]);
}
