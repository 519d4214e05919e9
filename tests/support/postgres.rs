//! A PostgreSQL server of the tests' own: started once a test program, stopped when that ends, however it ends.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};

/// Makes a cluster and serves it; makes a database of every name it reads, starts anew where it is told to, and takes all away
/// when its input closes: with the program that started it.
const LIFE: &str = r#"
set -e
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$1/initdb" --pgdata "$folder/data" --username mapfit --auth trust --no-sync --encoding UTF8 --locale C.UTF-8 >/dev/null
start() {
    "$1/postgres" -D "$folder/data" -c listen_addresses=127.0.0.1 -c port="$2" -c unix_socket_directories="$folder" \
        -c max_connections=300 -c log_min_messages=fatal 2>"$folder/log" &
    server=$!
    until "$1/pg_isready" --quiet --host 127.0.0.1 --port "$2"; do kill -0 $server || { cat "$folder/log" >&2; exit 1; }; sleep 0.1; done
    echo ready
}
start "$@"
while read -r word name; do
    case $word in
    restart)
        # An immediate shutdown: what a crash is to it.
        kill -QUIT $server
        wait $server || true
        start "$@"
        ;;
    create)
        "$1/createdb" --host 127.0.0.1 --port "$2" --username mapfit --no-password "$name" && echo ready
        ;;
    esac
done
kill -INT $server
wait $server || true
"#;

/// The folder of `initdb` and `postgres`. A machine without them fails the test.
fn programs() -> PathBuf {
    if let Some(folder) = std::env::var_os("MAPFIT_POSTGRES") {
        return folder.into();
    }
    let versions =
        std::fs::read_dir("/usr/lib/postgresql").map(|entries| entries.flatten().collect()).unwrap_or(vec![]);
    let newest = versions.iter().map(|entry| entry.path().join("bin")).filter(|bin| bin.join("initdb").exists()).max();
    newest.expect("there is no PostgreSQL server here: scripts/postgres installs one")
}

/// Where it is, and whom to tell to start it anew.
struct Running {
    url: String,
    life: Mutex<(Child, BufReader<ChildStdout>)>,
}

fn start() -> Running {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let programs = programs();
    let is_root = Path::new("/proc/self").metadata().is_ok_and(|own| std::os::unix::fs::MetadataExt::uid(&own) == 0);
    // PostgreSQL does not run as root.
    let mut command = Command::new(if is_root { "runuser" } else { "bash" });
    if is_root {
        command.args(["-u", "postgres", "--", "bash"]);
    }
    command.args(["-c", LIFE, "postgres"]).arg(programs).arg(port.to_string()).current_dir("/");
    let mut life = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut said = BufReader::new(life.stdout.take().unwrap());
    until_ready(&mut said);
    // Its input stays open as long as this program runs.
    Running { url: format!("postgres://mapfit@127.0.0.1:{port}"), life: Mutex::new((life, said)) }
}

fn until_ready(said: &mut impl BufRead) {
    let mut line = String::new();
    said.read_line(&mut line).unwrap();
    assert_eq!(line, "ready\n", "PostgreSQL did not start");
}

fn server() -> &'static Running {
    static SERVER: OnceLock<Running> = OnceLock::new();
    SERVER.get_or_init(start)
}

/// Ends the server without ado and starts it anew; it answers when this returns. Every test of the program is hit.
#[allow(dead_code)]
pub fn restart() {
    tell("restart");
}

/// The address of a new, empty database.
pub fn database() -> String {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let name = format!("test{}", COUNT.fetch_add(1, Ordering::Relaxed));
    tell(&format!("create {name}"));
    format!("{}/{name}", server().url)
}

/// Says a line, and waits until it is done.
fn tell(line: &str) {
    let mut life = server().life.lock().unwrap();
    writeln!(life.0.stdin.as_mut().unwrap(), "{line}").unwrap();
    until_ready(&mut life.1);
}
