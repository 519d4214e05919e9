//! The memory that this process may use: what the machine has, or the least that its control groups allow.
//!
//! `/proc/self/cgroup` has a line a hierarchy, `number:controllers:path`: `0::path` of version 2, and one that names
//! `memory` among its controllers of version 1. The kernel holds a group to its own limit and to those of all groups
//! around it, so the least along the path counts. Inside a container the path may be the host's, of which only the end
//! is mounted, as the root: what is not there is passed over.

use std::path::{Component, Path, PathBuf};

/// Of a machine that does not say what it has.
const USUAL: u64 = 4 << 30;

/// Bytes.
pub fn of_this_machine() -> u64 {
    below(Path::new("/"))
}

/// The same of a machine whose root is elsewhere.
fn below(root: &Path) -> u64 {
    let machine = machine(root).unwrap_or(USUAL);
    limits(root).into_iter().fold(machine, u64::min)
}

fn machine(root: &Path) -> Option<u64> {
    let text = std::fs::read_to_string(root.join("proc/meminfo")).ok()?;
    let line = text.lines().find(|line| line.starts_with("MemTotal:"))?;
    line.split_whitespace().nth(1)?.parse::<u64>().ok().map(|kilobytes| kilobytes << 10)
}

/// What the groups that hold this process allow, each.
fn limits(root: &Path) -> Vec<u64> {
    let groups = std::fs::read_to_string(root.join("proc/self/cgroup")).unwrap_or_default();
    let mounted = root.join("sys/fs/cgroup");
    let hierarchy = |line: &str| {
        let mut parts = line.splitn(3, ':');
        let (number, controllers, path) = (parts.next()?, parts.next()?, parts.next()?);
        match number {
            "0" if controllers.is_empty() => Some((mounted.clone(), "memory.max", path.to_owned())),
            _ if controllers.split(',').any(|one| one == "memory") => {
                Some((mounted.join("memory"), "memory.limit_in_bytes", path.to_owned()))
            }
            _ => None,
        }
    };
    let along = |(folder, file, path): (PathBuf, &str, String)| -> Vec<u64> {
        let inner = within(&path);
        // "max" is no number.
        let limit = |group: &Path| std::fs::read_to_string(folder.join(group).join(file)).ok()?.trim().parse().ok();
        inner.ancestors().filter_map(limit).collect()
    };
    groups.lines().filter_map(hierarchy).flat_map(along).collect()
}

/// A group's path below the mount. One that leads out of what a namespace shows says nothing of what is mounted.
fn within(path: &str) -> PathBuf {
    let parts = || Path::new(path).components();
    match parts().any(|part| part == Component::ParentDir) {
        true => PathBuf::new(),
        false => parts().filter(|part| matches!(part, Component::Normal(_))).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a machine of 8 GiB with these files says.
    fn allowed(files: &[(&str, &str)]) -> u64 {
        let root = tempfile::tempdir().unwrap();
        for (file, text) in [("proc/meminfo", "MemFree: 1 kB\nMemTotal:  8388608 kB\n")].iter().chain(files) {
            let file = root.path().join(file);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, text).unwrap();
        }
        below(root.path())
    }

    const MACHINE: u64 = 8 << 30;
    const OF_2: (&str, &str) = ("proc/self/cgroup", "0::/system.slice/mapfit.service\n");
    const OF_1: (&str, &str) = ("proc/self/cgroup", "9:cpu,cpuacct:/a\n4:memory,hugetlb:/docker/x:y\n0::/\n");

    #[test]
    fn without_limits_it_is_the_machines() {
        assert_eq!(allowed(&[]), MACHINE);
        assert_eq!(allowed(&[OF_2]), MACHINE);
        assert_eq!(allowed(&[OF_2, ("sys/fs/cgroup/system.slice/memory.max", "max\n")]), MACHINE);
        let unlimited = ("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
        assert_eq!(allowed(&[OF_1, unlimited]), MACHINE);
        assert_eq!(below(Path::new("/nowhere at all")), USUAL);
    }

    #[test]
    fn the_least_limit_along_the_path_counts() {
        let [service, slice, all] = ["system.slice/mapfit.service/", "system.slice/", ""]
            .map(|group| format!("sys/fs/cgroup/{group}memory.max"));
        assert_eq!(allowed(&[OF_2, (&service, "1048576\n")]), 1 << 20);
        assert_eq!(allowed(&[OF_2, (&service, "4194304\n"), (&slice, "2097152\n"), (&all, "max\n")]), 2 << 20);
        assert_eq!(allowed(&[OF_2, (&service, "max\n"), (&slice, "max\n"), (&all, "3145728\n")]), 3 << 20);
        let other = "sys/fs/cgroup/system.slice/other.service/memory.max";
        assert_eq!(allowed(&[OF_2, (&service, "4194304\n"), (other, "1024\n")]), 4 << 20, "another's is another's");
    }

    #[test]
    fn version_1_is_read_where_its_memory_controller_is() {
        let [own, all] = ["docker/x:y/", ""].map(|group| format!("sys/fs/cgroup/memory/{group}memory.limit_in_bytes"));
        assert_eq!(allowed(&[OF_1, (&own, "1048576\n"), (&all, "2097152\n")]), 1 << 20);
        assert_eq!(allowed(&[OF_1, (&all, "2097152\n")]), 2 << 20, "a container sees its own group as the root");
    }

    #[test]
    fn a_path_that_is_not_below_the_mount_leaves_the_root() {
        let outside = ("proc/self/cgroup", "0::/../../other\n");
        let [other, all] = ["other/", ""].map(|group| format!("sys/fs/cgroup/{group}memory.max"));
        assert_eq!(allowed(&[outside, (&other, "1024\n"), (&all, "1048576\n")]), 1 << 20);
    }

    #[test]
    fn what_cannot_be_read_is_no_limit() {
        let own = "sys/fs/cgroup/system.slice/memory.max";
        for text in ["", "much", "-1", "18446744073709551616"] {
            assert_eq!(allowed(&[OF_2, (own, text)]), MACHINE, "{text}");
        }
        for groups in ["", "0\n", "0::\n", "::::\nmemory\n", "\u{0}"] {
            assert_eq!(allowed(&[("proc/self/cgroup", groups)]), MACHINE, "{groups:?}");
        }
    }
}
