//! Under which names artifacts lie, and whose they are.

use uuid::Uuid;

pub(super) const ATTEMPTS: &str = "attempts";
pub(super) const IMPORTS: &str = "imports";
pub(super) const PROBES: &str = "probes";
pub(super) const ROOTS: [&str; 3] = [ATTEMPTS, IMPORTS, PROBES];

/// Whose a prefix is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Owner {
    Attempt { job_id: String, attempt: i64 },
    Import,
    Probe,
}

/// A prefix that no other claim has, whatever its number: one that was handed back is claimed again under the same.
pub(super) fn of_attempt(job_id: &str, attempt: i64) -> String {
    format!("{ATTEMPTS}/{job_id}/{attempt}-{}", Uuid::now_v7().simple())
}

pub(super) fn of_import(map_id: &str) -> String {
    format!("{IMPORTS}/{map_id}")
}

pub(super) fn of_probe(id: &Uuid) -> String {
    format!("{PROBES}/{id}")
}

/// The prefix that a path lies under, which is what one owner has, whole.
pub(super) fn of_path(path: &str) -> Option<String> {
    let parts: Vec<&str> = path.split('/').collect();
    let depth = if parts[0] == ATTEMPTS { 3 } else { 2 };
    (ROOTS.contains(&parts[0]) && parts.len() >= depth).then(|| parts[..depth].join("/"))
}

/// Whose a prefix is; nobody's known where it is not one of ours. Attempts before version 0.3 had no suffix.
pub(super) fn owner(prefix: &str) -> Option<Owner> {
    let parts: Vec<&str> = prefix.split('/').collect();
    match parts[..] {
        [ATTEMPTS, job_id, own] => {
            let number = own.split_once('-').map_or(own, |(number, _)| number);
            Some(Owner::Attempt { job_id: job_id.to_owned(), attempt: number.parse().ok()? })
        }
        [IMPORTS, _] => Some(Owner::Import),
        [PROBES, _] => Some(Owner::Probe),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prefix_tells_whose_it_is() {
        let prefix = of_attempt("job", 2);
        assert_ne!(prefix, of_attempt("job", 2), "two claims share no prefix");
        assert_eq!(of_path(&format!("{prefix}/map.npz")).as_deref(), Some(&prefix[..]));
        let attempt = |attempt| Some(Owner::Attempt { job_id: "job".into(), attempt });
        assert_eq!((owner(&prefix), owner("attempts/job/7")), (attempt(2), attempt(7)));
        assert_eq!((owner("imports/map"), owner("probes/x")), (Some(Owner::Import), Some(Owner::Probe)));
        assert_eq!((owner("attempts/job/x-1"), owner("elsewhere/x")), (None, None));
        assert_eq!((of_path("attempts/job"), of_path("other/a/b/c")), (None, None));
    }
}
