//! Memory that the machine, and the container that the program runs in, could give now.

use std::fs;
use std::path::Path;

/// A limit of cgroups version 1 from here on means none: "unlimited" is written as a number near 2⁶³.
const UNLIMITED: u64 = 1 << 60;

/// Anonymous memory available now without swapping: the least of what the system has available and what each limit of
/// the program's cgroup (version 1 or 2), or of one above it, leaves. `None` if nothing is known.
///
/// `root` is the folder that `/proc` and `/sys` lie in: `/`, but for tests.
pub(super) fn available_bytes(root: &Path) -> Option<u64> {
    let groups = fs::read_to_string(root.join("proc/self/cgroup")).unwrap_or_default();
    groups.lines().flat_map(|line| left_in_group(root, line)).chain(of_system(root, "MemAvailable:")).min()
}

/// Memory of the machine, as far as the system tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MachineMemory {
    /// All that there is.
    pub total_bytes: Option<u64>,
    /// What this process could have now without swapping, within the limits of the container that it runs in.
    pub available_bytes: Option<u64>,
}

/// The memory of this machine now. Linux tells; of other systems nothing is known.
pub fn machine_memory() -> MachineMemory {
    let root = Path::new("/");
    MachineMemory { total_bytes: of_system(root, "MemTotal:"), available_bytes: available_bytes(root) }
}

/// A line of the system's own account.
fn of_system(root: &Path, name: &str) -> Option<u64> {
    let text = fs::read_to_string(root.join("proc/meminfo")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kibibytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kibibytes * 1024)
}

/// The names of a memory controller's files.
struct Controller {
    /// Mount points of the controller, below `/sys/fs/cgroup`.
    mounts: &'static [&'static str],
    limits: &'static [&'static str],
    usage: &'static str,
    /// Entries of `memory.stat` that the kernel takes back before it refuses memory: pages of files.
    reclaimable: &'static [&'static str],
}

const VERSION_1: Controller = Controller {
    mounts: &["memory", ""],
    limits: &["memory.limit_in_bytes"],
    usage: "memory.usage_in_bytes",
    reclaimable: &["total_inactive_file", "total_active_file"],
};

const VERSION_2: Controller = Controller {
    mounts: &["", "unified"],
    // Above `high` a program is slowed down until it hardly runs.
    limits: &["memory.max", "memory.high"],
    usage: "memory.current",
    reclaimable: &["inactive_file", "active_file"],
};

/// What is left in the group of a line of `/proc/self/cgroup`, `number:controllers:/path`, and in each group above it. Inside a
/// container the path may be the host's, where only the container's own group is to be seen, as the mount's root.
fn left_in_group(root: &Path, line: &str) -> Vec<u64> {
    let mut parts = line.splitn(3, ':').skip(1);
    let (Some(controllers), Some(path)) = (parts.next(), parts.next()) else { return Vec::new() };
    let controller = match controllers {
        "" => VERSION_2,
        _ if controllers.split(',').any(|name| name == "memory") => VERSION_1,
        _ => return Vec::new(),
    };
    let groups = || Path::new(path.trim_start_matches('/')).ancestors();
    let mounts = controller.mounts.iter().map(|mount| root.join("sys/fs/cgroup").join(mount));
    mounts
        .flat_map(|mount| groups().map(move |group| mount.join(group)))
        .filter_map(|group| controller.left(&group))
        .collect()
}

impl Controller {
    fn left(&self, group: &Path) -> Option<u64> {
        let number = |name: &str| fs::read_to_string(group.join(name)).ok()?.trim().parse::<u64>().ok();
        let limit = self.limits.iter().filter_map(|name| number(name)).filter(|&limit| limit < UNLIMITED).min()?;
        let stat = fs::read_to_string(group.join("memory.stat")).unwrap_or_default();
        let counted = |line: &str| {
            let (name, bytes) = line.split_once(' ')?;
            self.reclaimable.contains(&name).then(|| bytes.trim().parse::<u64>().ok())?
        };
        let reclaimable: u64 = stat.lines().filter_map(counted).sum();
        Some(limit.saturating_sub(number(self.usage).unwrap_or(0).saturating_sub(reclaimable)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GIB: u64 = 1 << 30;

    /// A machine of 8 GiB with these files beside its `meminfo`.
    fn machine(files: &[(&str, &str)]) -> Option<u64> {
        let root = tempfile::tempdir().unwrap();
        let meminfo = ("proc/meminfo", "MemTotal:       16777216 kB\nMemAvailable:    8388608 kB\n");
        for (path, text) in [meminfo].iter().chain(files) {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        available_bytes(root.path())
    }

    #[test]
    fn without_groups_it_is_what_the_system_has() {
        assert_eq!(machine(&[]), Some(8 * GIB));
        assert_eq!(machine(&[("proc/self/cgroup", "0::/user.slice\n")]), Some(8 * GIB));
        assert_eq!(available_bytes(Path::new("/nowhere/at/all")), None);
    }

    #[test]
    fn version_2_limits_by_the_narrowest_group_above() {
        let files = [
            ("proc/self/cgroup", "0::/pod/app\n"),
            ("sys/fs/cgroup/pod/memory.max", "2147483648\n"),
            ("sys/fs/cgroup/pod/memory.current", "1073741824\n"),
            // Pages of files are taken back where memory is wanted.
            ("sys/fs/cgroup/pod/memory.stat", "anon 1\ninactive_file 268435456\nactive_file 268435456\n"),
            ("sys/fs/cgroup/pod/app/memory.max", "max\n"),
            ("sys/fs/cgroup/pod/app/memory.high", "max\n"),
        ];
        assert_eq!(machine(&files), Some(GIB + GIB / 2));
        // Inside a container the group is the root of what is mounted, whatever its path is outside.
        let inside = [
            ("proc/self/cgroup", "0::/docker/4711\n"),
            ("sys/fs/cgroup/memory.max", "1073741824\n"),
            ("sys/fs/cgroup/memory.current", "4096\n"),
        ];
        assert_eq!(machine(&inside), Some(GIB - 4096));
    }

    #[test]
    fn version_1_limits_too_and_its_largest_number_is_none() {
        let with = |limit| {
            machine(&[
                ("proc/self/cgroup", "12:cpu,cpuacct:/a\n5:memory:/a/b\n1:name=systemd:/\n"),
                ("sys/fs/cgroup/memory/a/b/memory.limit_in_bytes", limit),
                ("sys/fs/cgroup/memory/a/b/memory.usage_in_bytes", "104857600\n"),
                ("sys/fs/cgroup/memory/a/b/memory.stat", "cache 7\ntotal_inactive_file 104857600\n"),
            ])
        };
        assert_eq!(with("536870912\n"), Some(GIB / 2));
        assert_eq!(with("9223372036854771712\n"), Some(8 * GIB));
    }

    #[test]
    fn a_group_that_is_full_leaves_nothing() {
        let files = [
            ("proc/self/cgroup", "0::/\n"),
            ("sys/fs/cgroup/memory.max", "4096\n"),
            ("sys/fs/cgroup/memory.current", "8192\n"),
        ];
        assert_eq!(machine(&files), Some(0));
    }
}
