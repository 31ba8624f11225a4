//! Memory use of the whole process, from the operating system.

/// Returns an entry of /proc/self/status in bytes; `None` on systems other than Linux.
fn status(name: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with(name))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? * 1024)
}

/// Runs `work`; returns its result and the greatest growth of the process in bytes meanwhile. Reused memory that was freed before does not
/// count, so the first of several runs shows the most.
pub fn peak<T>(work: impl FnOnce() -> T) -> (T, Option<u64>) {
    // Writing 5 begins a new peak at what is held now (proc(5)).
    let before = std::fs::write("/proc/self/clear_refs", "5").ok().and_then(|()| status("VmRSS:"));
    let result = work();
    let grown = before.and_then(|before| Some(status("VmHWM:")?.saturating_sub(before)));
    (result, grown)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn temporary_memory_counts() {
        let (sum, grown) = peak(|| vec![1u8; 64 << 20].iter().map(|&b| u64::from(b)).sum::<u64>());
        assert_eq!(sum, 64 << 20);
        assert!(grown.is_some_and(|grown| (60 << 20..200 << 20).contains(&grown)), "{grown:?}");
    }
}
