//! The allocator of the wheel. It returns freed memory to the system when the core's work ends, so that large results leave nothing behind in the host
//! process. The system's own allocator keeps up to 64 MB for every thread that ever worked, and its settings are those of the host.

use std::ffi::{c_int, c_long};
use std::sync::atomic::{AtomicUsize, Ordering};

use mimalloc::MiMalloc;

#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// `mi_option_purge_delay` of mimalloc's header: milliseconds until freed memory is returned.
const PURGE_DELAY: c_int = 15;

/// That time while the core works, which allocates what it has just freed: with 0, a tenth of a bake is the system clearing pages.
const DELAY_AT_WORK: c_long = 1000;

/// Calls that work.
static AT_WORK: AtomicUsize = AtomicUsize::new(0);

/// Makes the allocator return memory when it is freed. Its default waits a second for the next use of the allocator, which may never come.
/// Called once, at the import.
pub fn return_freed_memory() {
    set_purge_delay(0);
}

/// Work of the core, during which freed memory is kept for the next use.
pub struct Working;

impl Working {
    pub fn begin() -> Self {
        if AT_WORK.fetch_add(1, Ordering::SeqCst) == 0 {
            set_purge_delay(DELAY_AT_WORK);
        }
        Self
    }
}

impl Drop for Working {
    fn drop(&mut self) {
        // Each call that sets the longer delay does so before it leaves, so after the last one the delay is 0.
        if AT_WORK.fetch_sub(1, Ordering::SeqCst) == 1 {
            // It returns nothing where the delay is 0.
            // SAFETY: the function has no requirements; it may run beside any other of the allocator.
            #[allow(unsafe_code)]
            unsafe {
                libmimalloc_sys::mi_collect(true);
            }
            set_purge_delay(0);
        }
    }
}

fn set_purge_delay(milliseconds: c_long) {
    // SAFETY: mimalloc knows the option, and the call writes one aligned number: others read the old or the new one, and either is right.
    #[allow(unsafe_code)]
    unsafe {
        libmimalloc_sys::mi_option_set(PURGE_DELAY, milliseconds);
    }
}
