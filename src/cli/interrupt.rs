//! Ctrl-C while a command waits for what goes on without it: the process ends at once, and says so.
//!
//! Before anything waits, Ctrl-C ends the process as it ends any. From then on one thread listens for it until the
//! process ends: whoever waits does so in calls that block, and a signal that was once caught is never given back.

use std::io::IsTerminal;
use std::process;
use std::sync::{Mutex, OnceLock, PoisonError};

use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::{Signal, SignalKind, signal};

/// What a shell has for a process that Ctrl-C ended.
const INTERRUPTED: i32 = 130;

/// What to say, while somebody waits.
static WORDS: Mutex<Option<String>> = Mutex::new(None);
static LISTENS: OnceLock<bool> = OnceLock::new();

/// Somebody waits, until it is dropped.
pub struct Interrupt;

impl Interrupt {
    /// What Ctrl-C is to say from now on.
    pub fn says(words: String) -> Self {
        *WORDS.lock().unwrap_or_else(PoisonError::into_inner) = Some(words);
        // Where nobody can listen Ctrl-C does what it did.
        LISTENS.get_or_init(|| listen().is_ok());
        Self
    }
}

impl Drop for Interrupt {
    fn drop(&mut self) {
        *WORDS.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

fn listen() -> std::io::Result<()> {
    let runtime = Builder::new_current_thread().enable_io().build()?;
    // Within the runtime, and before anything is said: a Ctrl-C from here on is heard.
    let interrupts = {
        let _within = runtime.enter();
        signal(SignalKind::interrupt())?
    };
    let thread = std::thread::Builder::new().name("interrupt".into());
    thread.spawn(move || end_at(interrupts, &runtime)).map(drop)
}

fn end_at(mut interrupts: Signal, runtime: &Runtime) {
    runtime.block_on(interrupts.recv());
    if let Some(words) = WORDS.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
        // The bar stands in the line.
        let begin = if std::io::stderr().is_terminal() { "\n" } else { "" };
        eprintln!("{begin}mapfit: {words}");
    }
    process::exit(INTERRUPTED)
}
