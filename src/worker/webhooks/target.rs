//! Where webhooks may go: to public addresses, and to those that `--webhook-allow` names.
//!
//! A webhook's address is a client's wish, and the service stands where that client may not: so no delivery goes to
//! loopback, private or link-local addresses (server-side request forgery). What is checked is the address that is
//! connected to, each time, after the name was resolved: a name may mean another address the second time.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

use ipnet::IpNet;
use ureq::config::Config;
use ureq::http::Uri;
use ureq::unversioned::resolver::{ResolvedSocketAddrs, Resolver};
use ureq::unversioned::transport::NextTimeout;

const LONGEST_URL: usize = 2048;

/// The networks that are allowed beside public ones.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Allowed(pub Vec<IpNet>);

impl Allowed {
    pub fn allows(&self, address: IpAddr) -> bool {
        let address = address.to_canonical();
        is_public(address) || self.0.iter().any(|net| net.contains(&address))
    }

    /// Whether a webhook may be registered: by its form, and where it names an address, by that. What a name means is
    /// checked when it is called.
    pub fn target(&self, url: &str) -> Result<(), String> {
        if url.len() > LONGEST_URL {
            return Err(format!("must have {LONGEST_URL} characters at most"));
        }
        let uri: Uri = url.parse().map_err(|_| "must be an absolute http or https URL".to_owned())?;
        let host = uri.host().filter(|host| !host.is_empty());
        let (Some("http" | "https"), Some(host)) = (uri.scheme_str(), host) else {
            return Err("must be an absolute http or https URL".into());
        };
        if uri.authority().is_some_and(|authority| authority.as_str().contains('@')) {
            return Err("must not hold a user or a password".into());
        }
        let bare = host.trim_start_matches('[').trim_end_matches(']');
        let local = bare.eq_ignore_ascii_case("localhost") || bare.to_ascii_lowercase().ends_with(".localhost");
        let address = bare.parse().ok().or(local.then_some(IpAddr::V4(Ipv4Addr::LOCALHOST)));
        match address {
            Some(address) if !self.allows(address) => Err(format!(
                "{bare} is a loopback, private or link-local address; --webhook-allow names those that are allowed"
            )),
            _ => Ok(()),
        }
    }
}

/// Resolves names, and keeps of their addresses those that are allowed.
#[derive(Debug)]
pub(super) struct Guarded<R> {
    pub allowed: Allowed,
    /// What names mean now.
    pub names: R,
}

impl<R: Resolver> Resolver for Guarded<R> {
    fn resolve(&self, uri: &Uri, config: &Config, timeout: NextTimeout) -> Result<ResolvedSocketAddrs, ureq::Error> {
        let found = self.names.resolve(uri, config, timeout)?;
        let mut kept = self.empty();
        found.iter().filter(|address| self.allowed.allows(address.ip())).for_each(|address| kept.push(*address));
        match kept.is_empty() {
            true => Err(std::io::Error::new(std::io::ErrorKind::PermissionDenied, "the address is not allowed").into()),
            false => Ok(kept),
        }
    }
}

/// Whether an address is one of the public internet's (IANA's special-purpose registries; RFC 6890).
fn is_public(address: IpAddr) -> bool {
    match address {
        IpAddr::V4(address) => is_public_v4(address),
        IpAddr::V6(address) => is_public_v6(address),
    }
}

fn is_public_v4(address: Ipv4Addr) -> bool {
    let [a, b, c, _] = address.octets();
    let special = matches!((a, b, c), (0, ..) | (100, 64..=127, _) | (192, 0, 0) | (198, 18..=19, _) | (240..=255, ..));
    let local = address.is_loopback() || address.is_private() || address.is_link_local();
    !(special || local || address.is_multicast() || address.is_documentation())
}

fn is_public_v6(address: Ipv6Addr) -> bool {
    let [a, b, c, d, ..] = address.segments();
    let embedded = match (a, b) {
        // NAT64 and 6to4 carry an address of version 4.
        (0x64, 0xff9b) => Some(Ipv4Addr::from(address.to_bits() as u32)),
        (0x2002, _) => Some(Ipv4Addr::from((u32::from(b) << 16) | u32::from(c))),
        _ => None,
    };
    let special = matches!((a, b), (0x100, 0) | (0x2001, 0..=0x1ff | 0xdb8) | (0x3fff, _) | (0x5f00, _))
        || (a, b, c, d) == (0, 0, 0, 0);
    let local = address.is_loopback() || address.is_unique_local() || address.is_unicast_link_local();
    embedded.is_none_or(is_public_v4) && !(special || local || address.is_multicast() || a & 0xffc0 == 0xfec0)
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::{SocketAddr, TcpListener};
    use std::sync::Mutex;

    use ureq::unversioned::resolver::DefaultResolver;

    use super::super::agent;
    use super::*;

    #[test]
    fn only_public_addresses_and_those_allowed_are_called() {
        let none = Allowed::default();
        for inside in [
            "127.0.0.1",
            "10.1.2.3",
            "192.168.0.1",
            "172.16.0.1",
            "169.254.169.254",
            "0.0.0.0",
            "100.64.0.1",
            "224.0.0.1",
            "255.255.255.255",
            "::1",
            "::",
            "fe80::1",
            "fc00::1",
            "::ffff:127.0.0.1",
            "::ffff:10.0.0.1",
            "64:ff9b::7f00:1",
            "2002:7f00:1::",
            "ff02::1",
            "::7f00:1",
        ] {
            assert!(!none.allows(inside.parse().unwrap()), "{inside}");
        }
        for outside in ["1.1.1.1", "93.184.216.34", "2606:4700:4700::1111"] {
            assert!(none.allows(outside.parse().unwrap()), "{outside}");
        }
        let lan = Allowed(vec!["10.0.0.0/8".parse().unwrap()]);
        assert!(lan.allows("10.1.2.3".parse().unwrap()) && lan.allows("::ffff:10.1.2.3".parse().unwrap()));
        assert!(!lan.allows("127.0.0.1".parse().unwrap()));
    }

    /// A name is checked by what it means: also one that no form gives away, for a resolver reads numbers in many ways.
    #[test]
    fn names_of_addresses_that_are_not_allowed_lead_nowhere() {
        let resolve = |url: &str, allowed: &str| {
            let allowed = Allowed(allowed.split(' ').filter_map(|net| net.parse().ok()).collect());
            Guarded { allowed, names: DefaultResolver::default() }.resolve(
                &url.parse().unwrap(),
                &Config::default(),
                NextTimeout::default(),
            )
        };
        for url in
            ["http://localhost:9/", "http://127.1:9/", "http://2130706433:9/", "http://0x7f.0.0.1:9/", "http://0:9/"]
        {
            let refused = resolve(url, "").unwrap_err();
            assert!(refused.to_string().contains("not allowed"), "{url}: {refused}");
        }
        let own = resolve("http://localhost:9/", "127.0.0.0/8 ::1/128").unwrap();
        assert!(!own.is_empty() && own.iter().all(|address| address.ip().is_loopback()));
    }

    /// A name server whose answers change, as one does that its owner wants to lead inside.
    #[derive(Debug)]
    struct Fickle(Mutex<Vec<SocketAddr>>);

    impl Resolver for Fickle {
        fn resolve(&self, _: &Uri, _: &Config, _: NextTimeout) -> Result<ResolvedSocketAddrs, ureq::Error> {
            let mut found = self.empty();
            found.push(self.0.lock().unwrap().pop().unwrap());
            Ok(found)
        }
    }

    #[test]
    fn a_name_that_means_another_address_the_second_time_leads_nowhere() {
        let outside = TcpListener::bind("127.0.0.2:0").unwrap();
        let inside = TcpListener::bind("127.0.0.1:0").unwrap();
        inside.set_nonblocking(true).unwrap();
        let answers = [&inside, &outside].map(|one| one.local_addr().unwrap());
        let allowed = Allowed(vec!["127.0.0.2/32".parse().unwrap()]);
        let calls = agent(Guarded { allowed, names: Fickle(Mutex::new(answers.to_vec())) });
        let receiver = std::thread::spawn(move || {
            let (mut wire, _) = outside.accept().unwrap();
            let _ = wire.read(&mut [0; 1024]).unwrap();
            wire.write_all(b"HTTP/1.1 204 No Content\r\nconnection: close\r\n\r\n").unwrap();
        });
        assert_eq!(calls.post("http://hooks.example/").send("{}").unwrap().status(), 204);
        receiver.join().unwrap();
        let refused = calls.post("http://hooks.example/").send("{}").unwrap_err();
        assert!(refused.to_string().contains("not allowed"), "{refused}");
        assert!(inside.accept().is_err(), "it was called");
    }

    #[test]
    fn urls_are_refused_by_form_and_by_address() {
        let none = Allowed::default();
        for bad in [
            "",
            "x",
            "ftp://a.example/",
            "/path",
            "http://",
            "http://localhost/",
            "http://a.localhost:1/",
            "http://127.0.0.1:9/x",
            "http://[::1]/",
            "https://user:secret@a.example/",
            "http://169.254.169.254/latest",
        ] {
            assert!(none.target(bad).is_err(), "{bad}");
        }
        assert!(none.target("https://hooks.example/a?b=c").is_ok());
    }
}
