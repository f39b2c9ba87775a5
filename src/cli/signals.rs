//! Signals: requests to end, and writes beyond a limit of the size of files.

use std::sync::{Arc, atomic::AtomicBool};

use anyhow::Context;
use signal_hook::{consts, flag};

/// A flag that is set when the user interrupts (Ctrl-C) or the system requests the end. A second signal ends at once. What the caller
/// ignores stays ignored, as `nohup` wants.
pub fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    const ENDING: &[i32] = &[
        consts::SIGINT,
        consts::SIGTERM,
        #[cfg(unix)]
        consts::SIGHUP,
    ];
    let stop = Arc::new(AtomicBool::new(false));
    let ignored = ignored_signals();
    for &signal in ENDING.iter().filter(|&&signal| !is_among(ignored, signal)) {
        // The first signal finds the flag not yet set.
        flag::register_conditional_shutdown(signal, 1, Arc::clone(&stop))
            .and_then(|_| flag::register(signal, Arc::clone(&stop)))
            .context("cannot watch for interruptions")?;
    }
    Ok(stop)
}

/// Lets a write beyond the largest size of a file (`ulimit -f`) fail, where it would end the program without a message.
pub fn let_large_writes_fail() {
    // Without the handler the program still ends.
    #[cfg(unix)]
    let _ = flag::register(consts::SIGXFSZ, Arc::new(AtomicBool::new(false)));
}

/// The signals that this process ignores, as a set of bits; those of Linux.
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    set_of(&status)
}

/// Reads the line `SigIgn:` of `/proc/PID/status`; 0 without one.
fn set_of(status: &str) -> u64 {
    let line = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    line.and_then(|set| u64::from_str_radix(set.trim(), 16).ok()).unwrap_or(0)
}

fn is_among(set: u64, signal: i32) -> bool {
    u32::try_from(signal - 1).is_ok_and(|bit| set.checked_shr(bit).unwrap_or(0) & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_are_bits_of_a_hexadecimal_number() {
        // As under `nohup`: hang-up (1) and a broken pipe (13).
        let set = set_of("Name:\tgrimace\nSigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\n");
        assert_eq!((1..=64).filter(|&signal| is_among(set, signal)).collect::<Vec<_>>(), [1, 13]);
        assert_eq!((set_of(""), set_of("SigIgn:\tx")), (0, 0));
        assert!(!is_among(u64::MAX, 0) && !is_among(u64::MAX, 65));
    }
}
