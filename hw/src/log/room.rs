//! Room on the disk that a log leaves to what is worth more than it.

use std::path::Path;

/// Bytes that are free on the disk of a file or folder that is there; `None` where the operating system does not say.
#[cfg(unix)]
pub fn free_space(path: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(path).ok()?;
    disk.f_bavail.checked_mul(disk.f_frsize)
}

/// Not known here.
#[cfg(not(unix))]
pub fn free_space(_: &Path) -> Option<u64> {
    None
}

/// Tells, now and then, whether a file may grow.
pub(super) struct Room {
    /// Bytes to leave.
    reserve: u64,
    free: Box<Free>,
    /// Bytes since one last asked.
    since: u64,
}

/// Says how many bytes are free on the disk of a path.
type Free = dyn Fn(&Path) -> Option<u64> + Send;

/// Bytes after which one asks again.
const ASK_AFTER: u64 = 256 << 10;

/// Bytes of a log's end, and of what it holds back in memory besides its chunk.
const END: u64 = 64 << 10;

impl Room {
    pub fn new(reserve: u64) -> Self {
        Self::by(reserve, free_space)
    }

    fn by(reserve: u64, free: impl Fn(&Path) -> Option<u64> + Send + 'static) -> Self {
        Self {
            reserve,
            free: Box::new(free),
            since: ASK_AFTER,
        }
    }

    /// How many bytes are free, and how many are to be, where the file at `path` may not grow by `more`, with `pending` in memory.
    pub fn lacks(&mut self, path: &Path, pending: u64, more: u64) -> Option<[u64; 2]> {
        self.since += more;
        if self.since < ASK_AFTER {
            return None;
        }
        self.since = 0;
        let free = (self.free)(path)?;
        let needed = [pending, more, ASK_AFTER, END]
            .into_iter()
            .fold(self.reserve, u64::saturating_add);
        (free < needed).then_some([free, self.reserve])
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn what_is_left_is_more_than_the_reserve() {
        let free = Arc::new(AtomicU64::new(8 << 20));
        let disk = free.clone();
        let mut room = Room::by(4 << 20, move |_| Some(disk.load(Ordering::Relaxed)));
        let mut written = 0;
        let lacks = loop {
            if let Some(lacks) = room.lacks(Path::new(""), 1 << 20, 10_000) {
                break lacks;
            }
            written += 10_000;
            free.fetch_sub(10_000, Ordering::Relaxed);
            assert!(written < 8 << 20, "it never ends");
        };
        assert_eq!(lacks, [free.load(Ordering::Relaxed), 4 << 20]);
        // What is held back in memory, and the end, fit above the reserve.
        assert!(lacks[0] + 10_000 >= (4 << 20) + (1 << 20), "{lacks:?}");
        assert!(written > 2 << 20, "{written}");
        let mut unknown = Room::by(u64::MAX, |_| None);
        assert_eq!(unknown.lacks(Path::new(""), 0, 1 << 30), None);
    }

    #[test]
    fn the_disk_of_a_folder_says_what_is_free() {
        let folder = tempfile::tempdir().unwrap();
        assert!(free_space(folder.path()).unwrap() > 0);
        assert_eq!(free_space(&folder.path().join("missing")), None);
    }
}
