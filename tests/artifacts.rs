//! What every artifact store promises: one suite, run against a folder and against a bucket of a real S3 server.

#[path = "support/seaweed.rs"]
mod seaweed;

use std::future::Future;
use std::path::Path as FilePath;
use std::sync::{Arc, Mutex};
use std::sync::{LazyLock, Weak};

use mapfit::store::{Artifacts, ArtifactsError, MAP_FILE, SqliteStore};
use object_store::ObjectStoreExt;
use object_store::multipart::MultipartStore;
use object_store::path::Path;
use seaweed::Seaweed;
use sha2::{Digest, Sha256};

fn sha256(bytes: &[u8]) -> String {
    hex::encode(Sha256::digest(bytes))
}

/// The server that tests of this program share, for as long as one of them runs.
fn server() -> Arc<Seaweed> {
    static SERVER: LazyLock<Mutex<Weak<Seaweed>>> = LazyLock::new(Mutex::default);
    let mut shared = SERVER.lock().unwrap();
    shared.upgrade().unwrap_or_else(|| {
        let server = Arc::new(Seaweed::start());
        *shared = Arc::downgrade(&server);
        server
    })
}

fn in_bucket(server: &Seaweed, name: &str) -> Artifacts {
    Artifacts::in_bucket(&format!("s3://{name}/a/prefix"), server.variables().into_iter()).unwrap()
}

/// Runs a test of the suite against either kind.
fn either<F: Future<Output = ()>>(name: &str, test: impl Fn(Artifacts) -> F) {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let folder = tempfile::tempdir().unwrap();
    // One after the other, and named where one fails.
    println!("{name}: a folder");
    let own = runtime.block_on(async { Artifacts::in_folder(folder.path()).unwrap() });
    runtime.block_on(test(own));
    println!("{name}: a bucket");
    let server = server();
    runtime.block_on(test(in_bucket(&server, &name.replace('_', "-"))));
}

macro_rules! suite {
    ($($name:ident),+) => {
        $(#[test]
        fn $name() {
            either(stringify!($name), suite::$name);
        })+
    };
}
suite!(what_was_put_is_got, what_differs_is_damaged, what_nobody_owns_is_swept, a_probe_leaves_nothing);

mod suite {
    use super::*;

    pub async fn what_was_put_is_got(artifacts: Artifacts) {
        let small = b"small".to_vec();
        // Over two parts, and not a whole number of them.
        let large: Vec<u8> =
            (0..40u32 << 20).map(|k| (k.wrapping_mul(2_654_435_761) >> 24) as u8).chain([1, 2]).collect();
        let one = Artifacts::of_attempt("job", 1);
        for (name, bytes) in [(MAP_FILE, &small), ("large", &large)] {
            artifacts.put(&one, name, bytes.clone()).await.unwrap();
            assert!(artifacts.get(&one, name, Some(&sha256(bytes))).await.unwrap() == bytes[..], "{name}");
        }
        // A try whose answer was lost is made again.
        artifacts.put(&one, MAP_FILE, small.clone()).await.unwrap();
        let two = Artifacts::of_attempt("job", 1);
        artifacts.put(&two, MAP_FILE, b"another".to_vec()).await.unwrap();
        assert_eq!(artifacts.get(&one, MAP_FILE, None).await.unwrap(), small);
        artifacts.remove(&one).await.unwrap();
        artifacts.remove(&one).await.unwrap();
        let gone = artifacts.get(&one, MAP_FILE, None).await.unwrap_err();
        assert!(matches!(gone, ArtifactsError::Store(object_store::Error::NotFound { .. })), "{gone}");
        assert_eq!(artifacts.get(&two, MAP_FILE, None).await.unwrap(), "another");
    }

    pub async fn what_differs_is_damaged(artifacts: Artifacts) {
        let prefix = Artifacts::of_attempt("job", 1);
        artifacts.put(&prefix, MAP_FILE, b"these bytes".to_vec()).await.unwrap();
        let damaged = artifacts.get(&prefix, MAP_FILE, Some(&sha256(b"those bytes"))).await.unwrap_err();
        assert!(matches!(damaged, ArtifactsError::Damaged(_)), "{damaged}");
    }

    pub async fn what_nobody_owns_is_swept(artifacts: Artifacts) {
        let folder = tempfile::tempdir().unwrap();
        let records = SqliteStore::open(&folder.path().join("records.sqlite")).await.unwrap();
        let (orphan, import) = (Artifacts::of_attempt("nobody", 1), Artifacts::of_import("map"));
        artifacts.put(&orphan, MAP_FILE, b"orphan".to_vec()).await.unwrap();
        artifacts.put(&import, MAP_FILE, b"import".to_vec()).await.unwrap();
        assert_eq!(artifacts.sweep(&records).await.unwrap(), 1);
        assert!(artifacts.get(&orphan, MAP_FILE, None).await.is_err());
        // Its row may be on its way.
        assert!(artifacts.get(&import, MAP_FILE, None).await.is_ok());
        assert_eq!(artifacts.sweep(&records).await.unwrap(), 0);
    }

    pub async fn a_probe_leaves_nothing(artifacts: Artifacts) {
        artifacts.probe().await.unwrap();
    }
}

/// An object that is there under the name is another's: it stays.
#[test]
fn a_bucket_is_not_written_over() {
    let (runtime, server) = (tokio::runtime::Runtime::new().unwrap(), server());
    let artifacts = in_bucket(&server, "written-once");
    let prefix = Artifacts::of_attempt("job", 1);
    runtime.block_on(async {
        artifacts.put(&prefix, MAP_FILE, b"first".to_vec()).await.unwrap();
        assert!(artifacts.put(&prefix, MAP_FILE, b"other".to_vec()).await.is_err());
        assert_eq!(artifacts.get(&prefix, MAP_FILE, None).await.unwrap(), "first");
    });
}

/// Parts that a dead process sent are taken away, those of a running attempt are not.
#[test]
fn uploads_that_were_left_are_ended() {
    let (runtime, server) = (tokio::runtime::Runtime::new().unwrap(), server());
    let (artifacts, bucket) = (in_bucket(&server, "left-uploads"), server.bucket("left-uploads"));
    let folder = tempfile::tempdir().unwrap();
    runtime.block_on(async {
        let records = SqliteStore::open(&folder.path().join("records.sqlite")).await.unwrap();
        let begin = async |prefix: &str| {
            let key = Path::from(format!("a/prefix/{prefix}/{MAP_FILE}"));
            // The bucket makes itself with an object.
            bucket.put(&"other".into(), "object".into()).await.unwrap();
            let id = bucket.create_multipart(&key).await.unwrap();
            bucket.put_part(&key, &id, 0, vec![7; 5 << 20].into()).await.unwrap();
            (key, id)
        };
        let (dead, import) = (begin(&Artifacts::of_attempt("job", 1)).await, begin(&Artifacts::of_import("map")).await);
        assert_eq!(artifacts.sweep(&records).await.unwrap(), 1);
        assert!(bucket.put_part(&dead.0, &dead.1, 1, "more".into()).await.is_err(), "it was ended");
        bucket.put_part(&import.0, &import.1, 1, "more".into()).await.unwrap();
        assert!(bucket.head(&"other".into()).await.is_ok(), "what is not ours stays");
    });
}

/// A server that is gone, or says nothing, is an error in bounded time.
#[test]
fn a_dead_store_is_an_error_soon() {
    let (runtime, server) = (tokio::runtime::Runtime::new().unwrap(), Seaweed::start());
    let artifacts = in_bucket(&server, "dead");
    let prefix = Artifacts::of_attempt("job", 1);
    runtime.block_on(artifacts.put(&prefix, MAP_FILE, b"kept".to_vec())).unwrap();
    let fails = |within: u64| {
        let begun = std::time::Instant::now();
        assert!(runtime.block_on(artifacts.get(&prefix, MAP_FILE, None)).is_err());
        println!("an error after {:?}", begun.elapsed());
        assert!(begun.elapsed().as_secs() < within, "{:?}", begun.elapsed());
    };
    server.freeze();
    fails(40);
    server.thaw();
    server.kill();
    fails(10);
    server.start_again();
    assert_eq!(runtime.block_on(artifacts.get(&prefix, MAP_FILE, None)).unwrap(), "kept");
}

/// A crash leaves staging files that no list of objects shows.
#[test]
fn a_folder_is_swept_of_what_no_list_shows() {
    let folder = tempfile::tempdir().unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let left = folder.path().join("artifacts/attempts/job/1");
    std::fs::create_dir_all(&left).unwrap();
    std::fs::write(left.join("map.npz#1"), "half").unwrap();
    runtime.block_on(async {
        let records = SqliteStore::open(&folder.path().join("records.sqlite")).await.unwrap();
        let artifacts = Artifacts::in_folder(&folder.path().join("artifacts")).unwrap();
        assert_eq!(artifacts.sweep(&records).await.unwrap(), 1);
    });
    let empty = |path: &FilePath| std::fs::read_dir(path).unwrap().next().is_none();
    assert!(empty(&folder.path().join("artifacts/attempts")));
}
