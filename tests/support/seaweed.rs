//! An S3 server of the tests' own (SeaweedFS): started once a test program, killed and started again where a test asks for
//! it, stopped when the program ends, however it ends.
#![allow(dead_code)]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use futures::TryStreamExt;
use object_store::aws::{AmazonS3, AmazonS3Builder};
use object_store::{ObjectStore, ObjectStoreExt, RetryConfig};

/// Serves a folder, does what it reads (kill, start), and takes the folder away when its input closes.
const LIFE: &str = r#"
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
echo '{"identities":[{"name":"tests","credentials":[{"accessKey":"mapfit","secretKey":"secret"}],"actions":["Admin","Read","Write","List"]}]}' >"$folder/keys.json"
mkdir "$folder/data"
start() {
    TMPDIR=$folder "$1" -logtostderr=true server -ip=127.0.0.1 -ip.bind=127.0.0.1 -dir="$folder/data" \
        -master.port=$2 -master.port.grpc=$3 -master.volumeSizeLimitMB=64 -master.volumePreallocate=false \
        -volume.port=$4 -volume.port.grpc=$5 -volume.max=0 -filer.port=$6 -filer.port.grpc=$7 -filer.localSocket="$folder/filer" \
        -s3 -s3.port=$8 -s3.port.grpc=$9 -s3.port.iceberg=0 -s3.port.lance=0 -s3.config="$folder/keys.json" \
        -s3.localSocket="$folder/s3" >>"$folder/log" 2>&1 &
    server=$!
}
start "$@"
echo started
while read -r what; do
    case $what in
        kill) kill -KILL $server; wait $server 2>/dev/null ;;
        # The signal is sent before it is heard: a busy machine lets a thread answer once more.
        stop) kill -STOP $server
              while [ -n "$(grep -L '^State:.T' /proc/$server/task/*/status)" ]; do sleep 0.01; done ;;
        go) kill -CONT $server ;;
        start) start "$@" ;;
    esac
    echo "$what"
done
kill -KILL $server 2>/dev/null
wait $server 2>/dev/null
"#;

/// A running server. Its buckets make themselves.
pub struct Seaweed {
    life: Mutex<(Child, BufReader<ChildStdout>)>,
    port: u16,
}

/// `weed`, beside the Python of the tests. A machine without it fails the test.
fn program() -> PathBuf {
    let python = std::env::var_os("MAPFIT_PYTHON").map(PathBuf::from);
    let beside = python.as_deref().and_then(Path::parent).map(|bin| bin.join("weed"));
    let usual = Path::new(env!("CARGO_MANIFEST_DIR")).join(".venv/bin/weed");
    let found = beside.into_iter().chain([usual]).find(|path| path.exists());
    found.expect("there is no S3 server here: scripts/python installs one")
}

impl Seaweed {
    pub fn start() -> Self {
        let listeners: Vec<TcpListener> = (0..8).map(|_| TcpListener::bind("127.0.0.1:0").unwrap()).collect();
        let ports: Vec<u16> = listeners.iter().map(|listener| listener.local_addr().unwrap().port()).collect();
        drop(listeners);
        let mut command = Command::new("bash");
        command.args(["-c", LIFE, "seaweed"]).arg(program()).args(ports.iter().map(u16::to_string));
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let mut said = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        said.read_line(&mut line).unwrap();
        assert_eq!(line, "started\n");
        let server = Self { life: Mutex::new((child, said)), port: ports[6] };
        server.until_it_writes();
        server
    }

    fn tell(&self, what: &str) {
        let mut life = self.life.lock().unwrap();
        writeln!(life.0.stdin.as_mut().unwrap(), "{what}").unwrap();
        let mut line = String::new();
        life.1.read_line(&mut line).unwrap();
        assert_eq!(line.trim(), what);
    }

    /// kill -9; it has ended when this returns.
    pub fn kill(&self) {
        self.tell("kill");
    }

    /// Where its files were left; it takes writes when this returns.
    pub fn start_again(&self) {
        self.tell("start");
        self.until_it_writes();
    }

    /// It keeps its connections, and says nothing.
    pub fn freeze(&self) {
        self.tell("stop");
    }

    pub fn thaw(&self) {
        self.tell("go");
    }

    /// What tells a client of this server.
    pub fn variables(&self) -> Vec<(String, String)> {
        self.variables_of(self.port)
    }

    /// What tells a client of a port through which this server is reached slowly: so many bytes a second to it.
    pub fn slowly(&self, bytes_a_second: usize) -> Vec<(String, String)> {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let (port, behind) = (listener.local_addr().unwrap().port(), self.port);
        std::thread::spawn(move || {
            for near in listener.incoming().flatten() {
                let Ok(far) = TcpStream::connect(("127.0.0.1", behind)) else { continue };
                let (near_too, far_too) = (near.try_clone().unwrap(), far.try_clone().unwrap());
                std::thread::spawn(move || pass_on(near_too, far_too, bytes_a_second));
                std::thread::spawn(move || pass_on(far, near, usize::MAX));
            }
        });
        self.variables_of(port)
    }

    fn variables_of(&self, port: u16) -> Vec<(String, String)> {
        [
            ("AWS_ENDPOINT_URL", format!("http://127.0.0.1:{port}")),
            ("AWS_ALLOW_HTTP", "true".into()),
            ("AWS_ACCESS_KEY_ID", "mapfit".into()),
            ("AWS_SECRET_ACCESS_KEY", "secret".into()),
            ("AWS_REGION", "us-east-1".into()),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .to_vec()
    }

    /// A client of a bucket that tries everything once.
    pub fn bucket(&self, name: &str) -> AmazonS3 {
        let _ = rustls::crypto::ring::default_provider().install_default();
        let mut builder = AmazonS3Builder::new().with_bucket_name(name);
        for (name, value) in self.variables() {
            builder = builder.with_config(name.to_lowercase().parse().unwrap(), value);
        }
        let once = RetryConfig { max_retries: 0, ..RetryConfig::default() };
        builder.with_retry(once).build().unwrap()
    }

    /// A port that listens says little: it is ready when it has taken an object.
    fn until_it_writes(&self) {
        let begun = Instant::now();
        let bucket = self.bucket("ready");
        let runtime = tokio::runtime::Runtime::new().unwrap();
        while let Err(error) = runtime.block_on(bucket.put(&"ready".into(), "ready".into())) {
            assert!(begun.elapsed() < Duration::from_secs(60), "SeaweedFS does not take writes: {error}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// The names of all objects of a bucket.
    pub fn names(&self, bucket: &str) -> Vec<String> {
        let bucket = self.bucket(bucket);
        let runtime = tokio::runtime::Runtime::new().unwrap();
        let names = bucket.list(None).map_ok(|object| object.location.to_string()).try_collect();
        match runtime.block_on(names) {
            // It makes itself with the first object.
            Err(error) if error.to_string().contains("NoSuchBucket") => Vec::new(),
            names => names.unwrap(),
        }
    }
}

/// Everything from one side to the other, a little at a time.
fn pass_on(mut from: TcpStream, mut to: TcpStream, bytes_a_second: usize) {
    let mut piece = [0; 4096];
    while let Ok(n @ 1..) = from.read(&mut piece) {
        std::thread::sleep(Duration::from_secs_f64(n as f64 / bytes_a_second as f64));
        if to.write_all(&piece[..n]).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Both);
    let _ = from.shutdown(Shutdown::Both);
}

impl Drop for Seaweed {
    fn drop(&mut self) {
        if let Ok(mut life) = self.life.lock() {
            drop(life.0.stdin.take());
            let _ = life.0.wait();
        }
    }
}
