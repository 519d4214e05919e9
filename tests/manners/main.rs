//! How the service meets what it should not serve: foreign names, bodies that are too large, fields it does not know;
//! crowds, those who send or take nothing, and work that is more than it may do.

mod budgets;
mod crowds;
mod keeping;
mod refusals;
#[path = "../support/mod.rs"]
mod support;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use support::Server;

fn connect(server: &Server) -> TcpStream {
    TcpStream::connect(server.url.trim_start_matches("http://")).unwrap()
}

/// Sends a request as it is and gives what came back until the answer's end or two seconds of silence.
fn raw(server: &Server, request: &str) -> String {
    let mut stream = connect(server);
    stream.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let (mut answer, mut buffer) = (Vec::new(), [0; 4096]);
    while let Ok(n @ 1..) = stream.read(&mut buffer) {
        answer.extend_from_slice(&buffer[..n]);
        if String::from_utf8_lossy(&answer).contains("request_id") {
            break;
        }
    }
    String::from_utf8_lossy(&answer).into_owned()
}
