//! What a group of submissions comes to, by what is there already: each sees those before it in the group, as if it had
//! been entered by itself. A decision, made without a database.

use std::collections::HashMap;

use uuid::Uuid;

use crate::jobs::Job;
use crate::store::{NewJob, Quota, StoreError, Submission};

/// Idempotency keys that were here before, by tenant and key: the digest of the body they came with, and its job.
pub type Known = HashMap<(String, String), (String, Job)>;
/// What tenants have: jobs that wait, and bytes of maps.
pub type Held = HashMap<String, (i64, i64)>;

/// The tenants and keys of a group's submissions that have keys.
pub fn keys(group: &[NewJob]) -> Vec<(&str, &str)> {
    group.iter().filter_map(|new| Some((&new.tenant[..], &new.idempotency.as_ref()?.0[..]))).collect()
}

/// The tenants whose quota counts, each once.
pub fn counted(group: &[NewJob]) -> Vec<&str> {
    let mut tenants: Vec<&str> = group.iter().filter(|new| new.quota.is_some()).map(|new| &new.tenant[..]).collect();
    tenants.sort_unstable();
    tenants.dedup();
    tenants
}

/// A group, sorted out.
pub struct Group<'a> {
    verdicts: Vec<Verdict<'a>>,
}

enum Verdict<'a> {
    Answered(Box<Submission>),
    /// A job, by the id it gets.
    New(String, &'a NewJob),
    /// The key and the body of an earlier one of the group, by its place there.
    Again(usize),
}

impl Verdict<'_> {
    fn answered(outcome: Submission) -> Self {
        Self::Answered(Box::new(outcome))
    }
}

impl<'a> Group<'a> {
    /// Sorts out a group by what is known and held.
    pub fn of(group: &'a [NewJob], known: &Known, mut held: Held) -> Self {
        let mut seen: HashMap<(&str, &str), usize> = HashMap::new();
        let mut verdicts = Vec::with_capacity(group.len());
        for (place, new) in group.iter().enumerate() {
            let repeated = repeat(new, known).or_else(|| {
                let (key, body) = new.idempotency.as_ref()?;
                let earlier = *seen.get(&(&new.tenant[..], &key[..]))?;
                let same = group[earlier].idempotency.as_ref().is_some_and(|(_, its)| its == body);
                Some(if same { Verdict::Again(earlier) } else { Verdict::answered(Submission::KeyReused) })
            });
            let verdict = repeated.unwrap_or_else(|| admit(new, &mut held));
            if let (Verdict::New(..), Some((key, _))) = (&verdict, &new.idempotency) {
                seen.insert((&new.tenant, key), place);
            }
            verdicts.push(verdict);
        }
        Self { verdicts }
    }

    /// The jobs to be written, with their ids, in their order.
    pub fn new_jobs(&self) -> impl Iterator<Item = (&str, &'a NewJob)> {
        self.verdicts.iter().filter_map(|verdict| match verdict {
            Verdict::New(id, new) => Some((&id[..], *new)),
            _ => None,
        })
    }

    pub fn has_new_jobs(&self) -> bool {
        self.new_jobs().next().is_some()
    }

    /// What each comes to, with the jobs as they were written, in any order.
    pub fn written(self, jobs: Vec<Job>) -> Result<Vec<Submission>, StoreError> {
        let mut jobs: HashMap<String, Job> = jobs.into_iter().map(|job| (job.id.clone(), job)).collect();
        let mut outcomes: Vec<Submission> = Vec::with_capacity(self.verdicts.len());
        for verdict in self.verdicts {
            let outcome = match verdict {
                Verdict::Answered(outcome) => *outcome,
                Verdict::New(id, _) => Submission::Accepted(jobs.remove(&id).ok_or(sqlx::Error::RowNotFound)?),
                Verdict::Again(earlier) => match outcomes[earlier].clone() {
                    Submission::Accepted(job) => Submission::Repeated(job),
                    other => other,
                },
            };
            outcomes.push(outcome);
        }
        Ok(outcomes)
    }
}

/// What a submission comes to whose key was here before.
fn repeat<'a>(new: &NewJob, known: &Known) -> Option<Verdict<'a>> {
    let (key, body) = new.idempotency.as_ref()?;
    let (its_body, job) = known.get(&(new.tenant.clone(), key.clone()))?;
    Some(Verdict::answered(match its_body == body {
        true => Submission::Repeated(job.clone()),
        false => Submission::KeyReused,
    }))
}

/// A job within its tenant's quota, which then has one more that waits.
fn admit<'a>(new: &'a NewJob, held: &mut Held) -> Verdict<'a> {
    let (queued, bytes) = held.entry(new.tenant.clone()).or_default();
    if let Some(what) = new.quota.and_then(|quota| over(quota, *queued, *bytes)) {
        return Verdict::answered(Submission::OverQuota(what));
    }
    *queued += 1;
    Verdict::New(Uuid::now_v7().to_string(), new)
}

/// What a tenant has as much of as it may.
fn over(quota: Quota, queued: i64, bytes: i64) -> Option<&'static str> {
    match (queued >= quota.queued, bytes >= quota.bytes) {
        (true, _) => Some("queued jobs"),
        (_, true) => Some("bytes of maps"),
        _ => None,
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::jobs::Progress;

    pub fn new(tenant: &str, key: Option<(&str, &str)>, queued: i64) -> NewJob {
        NewJob {
            tenant: tenant.into(),
            name: None,
            labels: Default::default(),
            priority: 0,
            progress: Progress::queued(1),
            message: None,
            request: Vec::new(),
            idempotency: key.map(|(key, body)| (key.into(), body.into())),
            retry_of: None,
            deadline_seconds: None,
            traceparent: None,
            quota: Some(Quota { queued, bytes: i64::MAX }),
        }
    }

    fn job(id: &str, tenant: &str) -> Job {
        Job {
            id: id.into(),
            tenant: tenant.into(),
            name: None,
            labels: Default::default(),
            status: crate::jobs::JobStatus::Accepted,
            progress: Progress::queued(1),
            message: None,
            problem: None,
            created: 0,
            started: None,
            finished: None,
            updated: 0,
            attempt: 0,
            priority: 0,
            map_id: None,
            revision: 1,
            retry_of: None,
            deadline: None,
            traceparent: None,
        }
    }

    /// What each of a group comes to, by a letter: accepted, repeated (of which job), key reused, over quota.
    fn outcomes(group: &[NewJob], known: &Known, held: Held) -> Vec<String> {
        let sorted = Group::of(group, known, held);
        let mut written: Vec<Job> = sorted.new_jobs().map(|(id, new)| job(id, &new.tenant)).collect();
        written.reverse();
        let ids: Vec<String> = sorted.new_jobs().map(|(id, _)| id.to_owned()).collect();
        let place = |job: &Job| ids.iter().position(|id| *id == job.id).map_or(job.id.clone(), |k| k.to_string());
        let letter = |outcome: &Submission| match outcome {
            Submission::Accepted(job) => format!("accepted {}", place(job)),
            Submission::Repeated(job) => format!("repeated {}", place(job)),
            Submission::KeyReused => "reused".into(),
            Submission::OverQuota(what) => format!("over {what}"),
        };
        sorted.written(written).unwrap().iter().map(letter).collect()
    }

    #[test]
    fn each_sees_those_before_it() {
        let group = [
            new("a", Some(("k", "one")), 9),
            new("a", Some(("k", "one")), 9),
            new("a", Some(("k", "two")), 9),
            new("b", Some(("k", "two")), 9),
            new("b", None, 9),
        ];
        let expected = ["accepted 0", "repeated 0", "reused", "accepted 1", "accepted 2"];
        assert_eq!(outcomes(&group, &Known::new(), Held::new()), expected);
    }

    #[test]
    fn a_quota_counts_what_the_group_brings() {
        let group =
            [new("a", None, 2), new("a", Some(("k", "one")), 2), new("b", None, 2), new("a", Some(("k", "one")), 2)];
        let held = Held::from([("a".into(), (1, 0)), ("b".into(), (1, 0))]);
        let expected = ["accepted 0", "over queued jobs", "accepted 1", "over queued jobs"];
        assert_eq!(outcomes(&group, &Known::new(), held), expected);
    }

    #[test]
    fn a_key_that_was_here_before_is_answered_whatever_the_quota() {
        let known = Known::from([(("a".into(), "k".into()), ("one".into(), job("earlier", "a")))]);
        let group = [new("a", Some(("k", "one")), 0), new("a", Some(("k", "two")), 0), new("b", Some(("k", "one")), 1)];
        assert_eq!(outcomes(&group, &known, Held::new()), ["repeated earlier", "reused", "accepted 0"]);
    }

    #[test]
    fn a_job_that_was_not_written_is_no_success() {
        let group = [new("a", None, 9)];
        assert!(Group::of(&group, &Known::new(), Held::new()).written(Vec::new()).is_err());
    }
}
