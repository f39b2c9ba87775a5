//! Removes temporary files that killed processes of this program left behind.
//!
//! A temporary name is `.grimace-HOST-PROCESS-RANDOM.tmp`. HOST stands for the machine's name (8 hexadecimal digits), PROCESS is the
//! writer's process number in decimal. The writer holds a lock on the file, which the system releases when the process ends for any reason.
//! A file is removed if its lock is free and its writer is known to be gone: a process of this machine that no longer runs or, on another
//! machine that shares the folder, a file unchanged for a day. The first file that a process writes into a folder triggers the removal
//! there.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    sync::{LazyLock, Mutex, PoisonError},
    time::{Duration, SystemTime},
};

/// Start and end of temporary names.
const PREFIX: &str = ".grimace-";
pub(super) const SUFFIX: &str = ".tmp";

/// Age from which a file of another machine counts as left behind.
const OLD: Duration = Duration::from_secs(24 * 3600);

/// Folders that this process has cleaned.
static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// This machine's name in temporary names.
static HOST: LazyLock<String> = LazyLock::new(|| {
    #[cfg(unix)]
    let name = rustix::system::uname().nodename().to_bytes().to_vec();
    #[cfg(not(unix))]
    let name = std::env::var("COMPUTERNAME").unwrap_or_default().into_bytes();
    blake3::hash(&name).to_hex()[..8].to_owned()
});

/// Start of the temporary names of this process.
pub(super) fn prefix() -> String {
    format!("{PREFIX}{}-{}-", *HOST, std::process::id())
}

/// Locks a temporary file during writing. Without locks in the file system, only the writer's process number protects it.
pub(super) fn lock(file: &fs::File) {
    let _ = file.try_lock();
}

/// Cleans a folder on the first call for it in this process.
pub(crate) fn once(folder: &Path) {
    let first = SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned());
    if first {
        sweep(folder, SystemTime::now());
    }
}

/// Removes leftovers of killed processes in a folder. Files that cannot be removed stay; they do no harm.
fn sweep(folder: &Path, now: SystemTime) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let Some((host, process)) = name.to_str().and_then(writer_of) else { continue };
        let Ok(found) = entry.metadata() else { continue };
        let old = |time: std::io::Result<SystemTime>| time.is_ok_and(|t| now.duration_since(t).is_ok_and(|age| age > OLD));
        let gone = if host == *HOST { !is_running(process) } else { old(found.modified()) };
        if !gone {
            continue;
        }
        let path = entry.path();
        if found.is_file() && is_unlocked(&path) {
            let _ = fs::remove_file(&path);
        } else if found.is_dir() {
            // An encoder's folder has one file, `film.*`.
            for file in fs::read_dir(&path).into_iter().flatten().flatten() {
                if file.file_name().to_str().is_some_and(|n| n.starts_with("film.")) {
                    let _ = fs::remove_file(file.path());
                }
            }
            let _ = fs::remove_dir(&path);
        }
    }
}

/// Machine and process in a temporary name of this program.
fn writer_of(name: &str) -> Option<(&str, u32)> {
    let mut parts = name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX)?.split('-');
    let (host, process, random) = (parts.next()?, parts.next()?, parts.next()?);
    let is_ours = host.len() == 8
        && host.bytes().all(|b| b.is_ascii_hexdigit())
        && random.len() >= 6
        && random.bytes().all(|b| b.is_ascii_alphanumeric())
        && parts.next().is_none();
    Some((host, process.parse().ok().filter(|&p| is_ours && p > 0)?))
}

/// Whether a process of this machine is running; if unknown, yes.
fn is_running(process: u32) -> bool {
    #[cfg(unix)]
    {
        let Some(pid) = i32::try_from(process).ok().and_then(rustix::process::Pid::from_raw) else { return false };
        rustix::process::test_kill_process(pid) != Err(rustix::io::Errno::SRCH)
    }
    #[cfg(not(unix))]
    {
        let _ = process;
        true
    }
}

/// Whether the lock of a file is free; if unknown, no.
fn is_unlocked(path: &Path) -> bool {
    fs::File::options().write(true).open(path).is_ok_and(|file| file.try_lock().is_ok())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::output::PendingFile;

    /// A process number without a process: one that has just ended.
    fn dead() -> u32 {
        let mut child = std::process::Command::new("true").spawn().unwrap();
        child.wait().unwrap();
        child.id()
    }

    #[test]
    fn only_names_of_ours_are_recognized() {
        assert_eq!(writer_of(".grimace-0123abcd-77-x1Y2z3.tmp"), Some(("0123abcd", 77)));
        for other in [
            ".grimace-x1Y2z3.tmp",
            ".grimace-0123abcd-77-x1Y2z3",
            "grimace-0123abcd-77-x1Y2z3.tmp",
            ".grimace-0123abcd-0-x1Y2z3.tmp",
            ".grimace-0123abcd-77-x1Y2z3-notes.tmp",
            ".grimace-my-notes-2024.tmp",
        ] {
            assert_eq!(writer_of(other), None, "{other}");
        }
    }

    #[test]
    fn what_a_killed_writer_left_is_swept_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let left = format!(".grimace-{}-{}-abcdef.tmp", *HOST, dead());
        let film = format!(".grimace-{}-{}-ghijkl.tmp", *HOST, dead());
        fs::write(at(&left), "half").unwrap();
        fs::create_dir(at(&film)).unwrap();
        fs::write(at(&film).join("film.mp4"), "half").unwrap();
        // A live process of this machine; a young and an old file of another machine; a file of another program.
        let kept = [
            format!(".grimace-{}-1-abcdef.tmp", *HOST),
            ".grimace-00000000-9-abcdef.tmp".to_owned(),
            ".grimace-notes.tmp".into(),
        ];
        for name in &kept {
            fs::write(at(name), "x").unwrap();
        }
        let elsewhere = at(".grimace-00000000-9-oldold.tmp");
        fs::write(&elsewhere, "x").unwrap();
        let long_ago = SystemTime::now() - 2 * OLD;
        fs::File::options().append(true).open(&elsewhere).unwrap().set_modified(long_ago).unwrap();
        let pending = PendingFile::create(&at("result.csv")).unwrap();
        let mut found: Vec<String> =
            fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        found.retain(|name| !name.starts_with(&prefix()));
        found.sort();
        let mut expected = kept.to_vec();
        expected.sort();
        assert_eq!(found, expected);
        drop(pending);
    }

    #[test]
    fn a_locked_file_stays_though_its_process_is_not_to_be_seen() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!(".grimace-{}-{}-abcdef.tmp", *HOST, dead()));
        let file = fs::File::create(&path).unwrap();
        lock(&file);
        sweep(folder.path(), SystemTime::now());
        assert!(path.exists());
        drop(file);
        sweep(folder.path(), SystemTime::now());
        assert!(!path.exists());
    }
}
