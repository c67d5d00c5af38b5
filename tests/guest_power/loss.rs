//! A disk's own cache, which a power cut empties.
//!
//! QEMU logs every request to the disk (its driver `blklogwrites`, in the format of the kernel's
//! dm-log-writes). A request survives if a flush of the guest follows it. Any blocks of the
//! later ones may survive, as a disk writes them in any order.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Unit of the log, bytes.
const SECTOR: u64 = 512;
/// Beginning of a log: its number, and version 1.
const MAGIC: u64 = 0x006a_7366_7773_6872;
/// Flag of a flush.
const FLUSH: u64 = 1;
/// Flag of a discarded part, which has no data in the log.
const DISCARD: u64 = 4;
/// Part of a request that a disk writes as a whole, bytes.
const BLOCK: usize = 4096;

/// Requests that survived, and that did not.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Requests {
    pub(crate) flushed: u64,
    pub(crate) flushes: u64,
    pub(crate) unflushed: u64,
    /// Blocks of the unflushed requests that are lost.
    pub(crate) lost_blocks: u64,
}

/// Applies the log of a boot to the disk as it was before that boot.
pub(crate) fn apply(log: &Path, disk: &Path, random: &mut fastrand::Rng) -> Requests {
    let mut log = File::open(log).unwrap();
    let disk = File::options().write(true).open(disk).unwrap();
    let mut head = [0; SECTOR as usize];
    log.read_exact(&mut head).unwrap();
    let number = |head: &[u8], at: usize| u64::from_le_bytes(head[8 * at..8 * at + 8].try_into().unwrap());
    assert_eq!((number(&head, 0), number(&head, 1)), (MAGIC, 1), "a log of QEMU's");
    let (mut requests, mut waiting) = (Requests::default(), Vec::<(u64, Vec<u8>)>::new());
    loop {
        // The last request may be cut off: the guest has had no answer to it.
        match log.read_exact(&mut head) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => break,
            done => done.unwrap(),
        }
        let [sector, sectors, flags] = [0, 1, 2].map(|at| number(&head, at));
        if flags & FLUSH != 0 {
            requests.flushes += 1;
            requests.flushed += waiting.len() as u64;
            for (at, bytes) in waiting.drain(..) {
                disk.write_all_at(&bytes, at).unwrap();
            }
        }
        if flags & DISCARD != 0 || sectors == 0 {
            if flags & FLUSH == 0 && sectors == 0 {
                // Not written yet.
                break;
            }
            continue;
        }
        let mut bytes = vec![0; (sectors * SECTOR) as usize];
        match log.read_exact(&mut bytes) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => break,
            done => done.unwrap(),
        }
        waiting.push((sector * SECTOR, bytes));
    }
    requests.unflushed = waiting.len() as u64;
    for (at, bytes) in waiting {
        let kept = random.f32();
        for (n, block) in (0..).zip(bytes.chunks(BLOCK)) {
            if random.f32() < kept {
                disk.write_all_at(block, at + n * BLOCK as u64).unwrap();
            } else {
                requests.lost_blocks += 1;
            }
        }
    }
    requests
}
