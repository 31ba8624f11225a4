//! The allocator of the wheel. It returns freed memory to the system at once, so that large results leave nothing behind in the host
//! process. The system's own allocator keeps up to 64 MB for every thread that ever worked, and its settings are those of the host.

use std::ffi::c_int;

use mimalloc::MiMalloc;

#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// `mi_option_purge_delay` of mimalloc's header: milliseconds until freed memory is returned.
const PURGE_DELAY: c_int = 15;

/// Makes the allocator return memory when it is freed. Its default waits a second for the next use of the allocator, which may never come.
/// Called once, at the import.
pub fn return_freed_memory() {
    // SAFETY: mimalloc knows the option. The call is not safe beside others that set it, and the import is the only one.
    #[allow(unsafe_code)]
    unsafe {
        libmimalloc_sys::mi_option_set(PURGE_DELAY, 0);
    }
}
