//! Work that takes seconds, on a thread that makes way for those that answer.
//!
//! Fits keep every core busy, and what a small question takes is a tenth of a millisecond on each of several threads: the
//! one that reads it, the database's, a thread that computes. At equal priority each may wait for a fit's slice of the
//! core to end, which is milliseconds. A thread of the lowest priority (nice 19) gives way at once, and loses next to
//! nothing by it as long as small questions leave the cores any time. A process without privileges cannot raise a
//! thread's priority again, and threads inherit it: so work gets a thread of its own, and the one that started it, which
//! goes on to speak to the database and may open connections with threads of theirs, keeps its own.

use std::panic::resume_unwind;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread::{Builder, scope};
use std::time::Duration;

use rustix::process::setpriority_process;

/// The lowest priority that still has a share of the cores.
const LOWEST: i32 = 19;
/// How often somebody who waits looks whether to wait on.
const LOOK: Duration = Duration::from_millis(100);

/// Does work in the background, and waits for it. A panic goes on here. The error is that there is no thread to be had.
pub fn in_background<T: Send>(work: impl FnOnce() -> T + Send) -> std::io::Result<T> {
    let mut done = None;
    on_a_thread(Box::new(|| done = Some(work())))?;
    done.ok_or_else(|| std::io::Error::other("the thread ended without a word"))
}

/// Of whatever kind its outcome is, so that starting a thread is compiled once.
fn on_a_thread(work: Box<dyn FnOnce() + Send + '_>) -> std::io::Result<()> {
    scope(|scope| {
        let make_way = || {
            make_way();
            work();
        };
        let thread = thread().spawn_scoped(scope, make_way)?;
        thread.join().unwrap_or_else(|panic| resume_unwind(panic));
        Ok(())
    })
}

/// The same, for as long as it is waited for: `None` where it is not any more. Nothing can end a thread from outside, so work
/// that does not end by itself goes on, with all that it holds.
pub(super) fn in_background_while<T: Send + 'static>(
    waits: impl Fn() -> bool,
    work: impl FnOnce() -> T + Send + 'static,
) -> std::io::Result<Option<T>> {
    let (tell, told) = channel();
    let thread = thread().spawn(move || {
        make_way();
        // Whoever does not wait any more is not told.
        let _ = tell.send(work());
    })?;
    loop {
        match told.recv_timeout(LOOK) {
            Ok(done) => return Ok(Some(done)),
            Err(RecvTimeoutError::Timeout) if waits() => {}
            Err(RecvTimeoutError::Timeout) => return Ok(None),
            Err(RecvTimeoutError::Disconnected) => match thread.join() {
                Err(panic) => resume_unwind(panic),
                // Without a word and without a panic a thread does not end.
                Ok(()) => return Ok(None),
            },
        }
    }
}

fn thread() -> Builder {
    Builder::new().name("background".into())
}

fn make_way() {
    // Of this thread alone: on Linux each has a priority of its own.
    if let Err(error) = setpriority_process(None, LOWEST) {
        tracing::debug!(%error, "work goes on at the usual priority");
    }
}

#[cfg(test)]
mod tests {
    use rustix::process::getpriority_process;

    use super::*;

    #[test]
    fn work_has_the_lowest_priority_and_who_waits_for_it_keeps_its_own() {
        let before = getpriority_process(None).unwrap();
        assert_eq!(in_background(|| getpriority_process(None)).unwrap(), Ok(LOWEST));
        assert_eq!(in_background_while(|| true, || getpriority_process(None)).unwrap(), Some(Ok(LOWEST)));
        assert_eq!(getpriority_process(None), Ok(before));
    }

    #[test]
    fn a_panic_comes_back() {
        let caught = std::panic::catch_unwind(|| in_background(|| panic!("no more")));
        assert_eq!(caught.unwrap_err().downcast_ref(), Some(&"no more"));
        let caught = std::panic::catch_unwind(|| in_background_while::<()>(|| true, || panic!("no more")));
        assert_eq!(caught.unwrap_err().downcast_ref(), Some(&"no more"));
    }

    #[test]
    fn work_that_does_not_end_is_left() {
        let (go_on, gone_on) = channel::<()>();
        let left = in_background_while(|| false, move || gone_on.recv().is_err());
        assert_eq!(left.unwrap(), None);
        drop(go_on);
    }
}
