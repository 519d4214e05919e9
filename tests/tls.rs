//! Clients that speak TLS, without a proxy.

mod support;

use std::path::Path;
use std::process::Command;

use support::Server;
use ureq::tls::{Certificate, RootCerts, TlsConfig};

/// A certificate for this machine and its key, as files; the certificate, which is its own authority.
fn certified(folder: &Path) -> Certificate<'static> {
    let made = rcgen::generate_simple_self_signed(["localhost".to_owned(), "127.0.0.1".to_owned()]).unwrap();
    std::fs::write(folder.join("cert.pem"), made.cert.pem()).unwrap();
    std::fs::write(folder.join("key.pem"), made.signing_key.serialize_pem()).unwrap();
    Certificate::from_der(made.cert.der()).to_owned()
}

#[test]
fn a_service_speaks_tls_to_those_who_trust_its_certificate() {
    let folder = tempfile::tempdir().unwrap();
    let certificate = certified(folder.path());
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (cert, key) = (file("cert.pem"), file("key.pem"));
    let server = Server::start_with(&folder.path().join("data"), 0, &["--tls-cert", &cert, "--tls-key", &key]);
    assert!(server.url.starts_with("https://127.0.0.1:"), "{}", server.url);
    let trusting = TlsConfig::builder().root_certs(RootCerts::new_with_certs(&[certificate])).build();
    let config = ureq::Agent::config_builder().tls_config(trusting).proxy(None).http_status_as_error(false).build();
    let agent = ureq::Agent::new_with_config(config);
    // A connection that says nothing, or no TLS, holds up nobody.
    let address = server.url.trim_start_matches("https://").to_owned();
    let _silent = std::net::TcpStream::connect(&address).unwrap();
    let plain = ureq::get(format!("http://{address}/livez")).call();
    assert!(plain.is_err(), "it speaks TLS alone");
    for _ in 0..3 {
        let mut answer = agent.get(format!("{}/readyz", server.url)).call().unwrap();
        assert_eq!(answer.status(), 200);
        assert_eq!(answer.body_mut().read_to_string().unwrap(), r#"{"status":"ready"}"#);
    }
    // What hyper refuses by itself has words here, too.
    let crowded = (0..150).fold(agent.get(format!("{}/livez", server.url)), |get, k| get.header(format!("x-{k}"), "y"));
    let mut refused = crowded.call().unwrap();
    assert_eq!(refused.status(), 431);
    assert_eq!(refused.headers()["content-type"], "application/problem+json");
    assert!(refused.body_mut().read_to_string().unwrap().contains("/problems/too-large"));
    let stranger = ureq::get(format!("{}/livez", server.url)).call();
    assert!(stranger.is_err(), "nobody else vouches for it");
}

#[test]
fn a_pair_that_does_not_fit_is_a_usage_error() {
    let (folder, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    certified(folder.path());
    certified(other.path());
    let serve = |arguments: &[&Path]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mapfit"));
        command.args(["serve", "--listen", "127.0.0.1:0", "--workers", "0", "--data"]).arg(folder.path().join("data"));
        for (flag, file) in ["--tls-cert", "--tls-key"].iter().zip(arguments) {
            command.arg(flag).arg(file);
        }
        command.output().unwrap().status.code()
    };
    let (cert, key) = (folder.path().join("cert.pem"), folder.path().join("key.pem"));
    assert_eq!(serve(&[&cert]), Some(2), "without its key");
    assert_eq!(serve(&[&cert, &other.path().join("key.pem")]), Some(2), "another's key");
    assert_eq!(serve(&[&key, &key]), Some(2), "no certificate");
    assert_eq!(serve(&[&folder.path().join("none.pem"), &key]), Some(2));
}
