//! Linux: holes, reserved space, advice, and which disks are of this machine.

use std::fs::File;
use std::io;
use std::num::NonZeroU64;

use rustix::fs::{Advice, FallocateFlags};
use rustix::io::Errno;

use crate::store::access::Access;

/// Says what will be read of a file.
pub(in crate::store) fn will_read(file: &File, access: Access) {
    let advice = if access == Access::Blocks { Advice::Sequential } else { Advice::Random };
    let _ = rustix::fs::fadvise(file, 0, None, advice);
}

/// Says that a range will be read now.
pub(in crate::store) fn expect(file: &File, offset: u64, length: u64) {
    let _ = rustix::fs::fadvise(file, offset, NonZeroU64::new(length), Advice::WillNeed);
}

/// Says that a range will not be read again soon.
pub(in crate::store) fn release(file: &File, offset: u64, length: u64) {
    // Advice: without it the bytes are the same.
    let _ = rustix::fs::fadvise(file, offset, NonZeroU64::new(length), Advice::DontNeed);
}

/// Reserves disk space for a range where the file system can.
pub(in crate::store) fn reserve(file: &File, offset: u64, length: u64) -> io::Result<()> {
    match rustix::fs::fallocate(file, FallocateFlags::empty(), offset, length) {
        Ok(()) | Err(Errno::OPNOTSUPP | Errno::NOSYS) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// Makes a range read as zero and gives its space back; whether the file system can.
pub(in crate::store) fn clears(file: &File, offset: u64, length: u64) -> io::Result<bool> {
    match rustix::fs::fallocate(file, FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE, offset, length) {
        Ok(()) => Ok(true),
        Err(Errno::OPNOTSUPP | Errno::NOSYS) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// Start of the next range at or after `offset` that is not known to be a hole; `None` if only holes follow.
pub(in crate::store) fn next_data(file: &File, offset: u64) -> io::Result<Option<u64>> {
    match rustix::fs::seek(file, rustix::fs::SeekFrom::Data(offset)) {
        Ok(data) => Ok(Some(data)),
        Err(Errno::NXIO) => Ok(None),
        Err(_) => Ok((offset < file.metadata()?.len()).then_some(offset)),
    }
}

/// Whether a file's pages come from a disk of this machine, as far as the system tells.
pub(in crate::store) fn is_local(file: &File) -> bool {
    // As <linux/magic.h> and the file systems' own headers have them: NFS, SMB 1 and CIFS, SMB 2 and 3, 9P, FUSE, Ceph,
    // AFS, Coda, Lustre, GFS2, OCFS2.
    const REMOTE: [u32; 12] = [
        0x6969,
        0x517b,
        0xff53_4d42,
        0xfe53_4d42,
        0x0102_1997,
        0x6573_5546,
        0x00c3_6400,
        0x5346_414f,
        0x7375_7245,
        0x0bd0_0bd0,
        0x0116_1970,
        0x7461_636f,
    ];
    rustix::fs::fstatfs(file).is_ok_and(|volume| !REMOTE.contains(&(volume.f_type as u32)))
}
