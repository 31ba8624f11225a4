//! Execution of the core's work for Python: it releases the GIL, answers Ctrl-C, survives a fork and catches panics.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock, mpsc};
use std::thread;
use std::time::Duration;

use leafcloud::{Error, Progress};
use pyo3::prelude::*;

use crate::allocator::Working;
use crate::errors::{Failure, refuse};

/// The longest wait between checks for Ctrl-C.
pub const PATIENCE: Duration = Duration::from_millis(50);

/// Runs `work` and returns its result. A panic becomes an error, so that a panic never ends the host process.
///
/// # Errors
/// The error of `work`, a panic of `work`, or no threads after a fork.
pub fn guard<T: Send>(work: impl FnOnce() -> leafcloud::Result<T> + Send) -> Result<T, Failure> {
    let _working = Working::begin();
    match catch_unwind(AssertUnwindSafe(|| with_threads(work))) {
        Ok(result) => result.map_err(Failure::from),
        Err(panic) => Err(Failure::Refused(format!("internal error, please report it: {}", panic_message(&*panic)))),
    }
}

/// Runs `work` on a separate thread while this thread waits and answers Ctrl-C.
///
/// After Ctrl-C the call raises at once. `work` stops at its next report to [`Progress`]; work without reports ends in the
/// background.
///
/// # Errors
/// The error of `work`, `KeyboardInterrupt`, or no thread for `work`.
pub fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(Progress) -> leafcloud::Result<T> + Send + 'static,
) -> PyResult<T> {
    let stopped = Arc::new(AtomicBool::new(false));
    let (done, result) = mpsc::sync_channel(1);
    let mut result = OfThisProcess::new(result);
    let told = Arc::clone(&stopped);
    start(move || {
        let report = move |_: &str, _: f64| !told.load(Ordering::Relaxed);
        // The receiver is gone after Ctrl-C.
        let _ = done.send(guard(|| work(Progress::new(&report))));
    })?;
    loop {
        let waited = result.get()?; // A signal handler may have forked.
        match py.detach(move || waited.recv_timeout(PATIENCE)) {
            Ok(result) => return Ok(result?),
            Err(mpsc::RecvTimeoutError::Disconnected) => return Err(refuse("the work ended without a result")),
            Err(mpsc::RecvTimeoutError::Timeout) => {
                py.check_signals().inspect_err(|_| stopped.store(true, Ordering::Relaxed))?;
            }
        }
    }
}

/// Refuses to wait in a forked child: a fork copies neither the thread of the work nor its end.
///
/// # Errors
/// This process is not `process`, which started the work.
pub fn check_process(process: u32) -> Result<(), Failure> {
    if process == std::process::id() { Ok(()) } else { Err(Failure::Refused(FORKED.to_owned())) }
}

const FORKED: &str =
    "the work was started before this process was forked, and runs in its parent only; start it again in this process";

/// One end of a channel. After a fork the child has no thread at the other end, and a message may be incomplete. Using or dropping the end would
/// wait for its rest forever, so the child forgets the end.
pub struct OfThisProcess<T> {
    end: Option<T>,
    process: u32,
}

impl<T> OfThisProcess<T> {
    pub fn new(end: T) -> Self {
        Self { end: Some(end), process: std::process::id() }
    }

    /// # Errors
    /// This process is a forked child.
    pub fn get(&mut self) -> Result<&mut T, Failure> {
        check_process(self.process)?;
        self.end.as_mut().ok_or_else(|| Failure::Refused(FORKED.to_owned()))
    }
}

impl<T> Drop for OfThisProcess<T> {
    fn drop(&mut self) {
        if check_process(self.process).is_err() {
            std::mem::forget(self.end.take());
        }
    }
}

/// Starts a thread named after the library.
///
/// # Errors
/// The system cannot start another thread.
pub fn start(body: impl FnOnce() + Send + 'static) -> PyResult<()> {
    let started = thread::Builder::new().name("leafcloud".to_owned()).spawn(body);
    started.map(drop).map_err(|error| refuse(format!("no thread could be started: {error}")))
}

/// Stores this process as the owner of rayon's threads. Called once, at the import.
pub fn own_threads() {
    OWNER.get_or_init(std::process::id);
}

/// The process that imported the module.
static OWNER: OnceLock<u32> = OnceLock::new();

/// Whether a call has the threads that rayon shares among all callers.
static SHARED_THREADS_TAKEN: AtomicBool = AtomicBool::new(false);

/// The shared threads, for one call at a time.
struct SharedThreads;

impl SharedThreads {
    /// Takes the shared threads unless another call has them. A fork copies none of them, so every call in a forked child would wait for
    /// them forever: it never gets them.
    fn take() -> Option<Self> {
        let exist = OWNER.get() == Some(&std::process::id());
        (exist && !SHARED_THREADS_TAKEN.swap(true, Ordering::Acquire)).then(|| Self) // Not `then_some`: it would drop a `Self`.
    }
}

impl Drop for SharedThreads {
    fn drop(&mut self) {
        SHARED_THREADS_TAKEN.store(false, Ordering::Release);
    }
}

/// Runs `work` with the shared threads, or with threads of its own while another call has the shared ones. Rayon's threads look at the work
/// of a new caller only when they have finished that of the caller before; the system divides time among all threads.
fn with_threads<T: Send>(work: impl FnOnce() -> leafcloud::Result<T> + Send) -> leafcloud::Result<T> {
    if let Some(_taken) = SharedThreads::take() {
        return work();
    }
    let pool = rayon::ThreadPoolBuilder::new().build();
    pool.map_err(|error| Error::invalid(format!("no threads could be started: {error}")))?.install(work)
}

fn panic_message(panic: &(dyn Any + Send)) -> &str {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    owned.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message")
}
