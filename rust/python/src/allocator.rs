//! The allocator of the wheel. It returns freed memory to the system when the core's work ends, so that large results leave nothing behind in the host
//! process. The system's own allocator keeps up to 64 MB for every thread that ever worked, and its settings are those of the host.

use std::ffi::{c_int, c_long};
use std::sync::atomic::{AtomicU64, Ordering};

use mimalloc::MiMalloc;

#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// `mi_option_purge_delay` of mimalloc's header: milliseconds until freed memory is returned.
const PURGE_DELAY: c_int = 15;

/// Milliseconds until freed memory is returned while the core works. It soon allocates as much again; with 0 the system would clear pages for a tenth of
/// a bake.
const DELAY_AT_WORK: c_long = 1000;

/// The process, and the number of its calls that work: a fork copies the number, but none of the calls.
static AT_WORK: AtomicU64 = AtomicU64::new(0);

/// Makes the allocator return memory when it is freed. Its default waits a second for the next use of the allocator, which may never come.
/// Called once, at the import.
pub fn return_freed_memory() {
    set_purge_delay(0);
}

/// Work of the core, during which freed memory is kept for the next use.
pub struct Working;

impl Working {
    pub fn begin() -> Self {
        change_calls(1);
        set_purge_delay(DELAY_AT_WORK);
        Self
    }
}

impl Drop for Working {
    fn drop(&mut self) {
        if change_calls(-1) > 0 {
            return;
        }
        // With a delay of 0, which another call may just have set, nothing would be returned.
        set_purge_delay(DELAY_AT_WORK);
        // SAFETY: the function has no requirements; it may run beside any other of the allocator.
        #[allow(unsafe_code)]
        unsafe {
            libmimalloc_sys::mi_collect(true);
        }
        set_purge_delay(0);
    }
}

/// Changes the number of this process's calls at work, and returns it.
fn change_calls(by: i32) -> u32 {
    let process = std::process::id();
    let changed = |known: u64| {
        let calls = if (known >> 32) as u32 == process { known as u32 } else { 0 };
        calls.saturating_add_signed(by)
    };
    let packed = |known: u64| Some(u64::from(process) << 32 | u64::from(changed(known)));
    let (Ok(before) | Err(before)) = AT_WORK.fetch_update(Ordering::SeqCst, Ordering::SeqCst, packed);
    changed(before)
}

fn set_purge_delay(milliseconds: c_long) {
    // SAFETY: mimalloc knows the option. The call writes two aligned numbers, the value and that it is set; threads that allocate meanwhile read the
    // old or the new value, and either is right.
    #[allow(unsafe_code)]
    unsafe {
        libmimalloc_sys::mi_option_set(PURGE_DELAY, milliseconds);
    }
}
