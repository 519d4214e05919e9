//! Pages of jobs and maps, newest first, by walking indexes side by side.
//!
//! Each condition (a label, a status, a box) is a *leg*: an index that gives the next id below a bound. A page leaps from
//! leg to leg, and where all agree lies a hit (leapfrog join, Veldhuizen 2014).
//! So a page costs what its rarest condition has, whichever that is, without a guess of the planner's. PostgreSQL makes the
//! rows of a recursive query one by one, as they are asked for, so the walk ends with the page.

use sqlx::{Postgres, QueryBuilder};

use super::rows;
use crate::store::Listing;

/// What is listed: its table, its table of labels, and what a page reads of it.
pub struct Listed {
    table: &'static str,
    labels: &'static str,
    label_id: &'static str,
    columns: &'static str,
    /// What joins the rows to the hits.
    rows: &'static str,
    row_id: &'static str,
}

pub const JOBS: Listed = Listed {
    table: "jobs",
    labels: "job_labels",
    label_id: "job_id",
    columns: rows::JOB,
    rows: "JOIN jobs AS j ON j.id = hit.high LEFT JOIN leases AS l ON l.job_id = j.id",
    row_id: "j.id",
};
pub const MAPS: Listed = Listed {
    table: "maps",
    labels: "map_labels",
    label_id: "map_id",
    columns: rows::MAP,
    rows: "JOIN maps AS m ON m.id = hit.high",
    row_id: "m.id",
};

/// Above every id.
const ABOVE_ALL: &str = "~";

/// One condition.
enum Leg<'a> {
    Every,
    Label(&'a (String, String)),
    Status(&'static str),
    Within([f64; 4]),
}

/// Where a leg looks from.
enum Bound<'a> {
    /// Below an id.
    Start(&'a str),
    /// Below what the step before came to. An id and a blank sorts just above the id: it may itself be a hit.
    Walked,
    /// At the id of the leg before, or below it.
    AtMost(usize),
}

impl Bound<'_> {
    fn relation(&self) -> &'static str {
        match self {
            Self::Start(_) | Self::Walked => "<",
            Self::AtMost(_) => "<=",
        }
    }
}

/// The query for a page. A step of the walk asks one leg after the other, each from where the one before came to; where the
/// last is where the first is all agree. What a leg does not have is null, and ends the walk.
pub fn page(listed: &Listed, listing: &Listing) -> QueryBuilder<Postgres> {
    let mut labels: Vec<&(String, String)> = listing.labels.iter().collect();
    labels.sort_unstable();
    labels.dedup();
    let mut legs: Vec<Leg<'_>> = labels.into_iter().map(Leg::Label).collect();
    legs.extend(listing.status.map(|status| Leg::Status(status.name())));
    legs.extend(listing.bbox.map(Leg::Within));
    if legs.is_empty() {
        legs.push(Leg::Every);
    }
    let ends = format!("SELECT s0.id, s{}.id FROM ", legs.len() - 1);
    let start = listing.before.as_deref().unwrap_or(ABOVE_ALL);
    let mut query = QueryBuilder::<Postgres>::new("WITH RECURSIVE walk (high, low) AS (");
    query.push(&ends);
    push_step(&mut query, listed, &legs, &listing.tenant, &Bound::Start(start));
    query.push(" UNION ALL ").push(&ends).push("walk CROSS JOIN LATERAL ");
    push_step(&mut query, listed, &legs, &listing.tenant, &Bound::Walked);
    query.push(format!(" WHERE walk.low IS NOT NULL) SELECT {}", listed.columns));
    query.push(" FROM (SELECT high FROM walk WHERE low = high LIMIT ").push_bind(listing.limit);
    query.push(format!(") AS hit {} ORDER BY {} DESC", listed.rows, listed.row_id));
    query
}

fn push_step(query: &mut QueryBuilder<Postgres>, listed: &Listed, legs: &[Leg<'_>], tenant: &str, bound: &Bound<'_>) {
    for (k, leg) in legs.iter().enumerate() {
        if k == 0 {
            push_leg(query, listed, leg, tenant, bound);
            query.push(" AS s0");
        } else {
            query.push(" LEFT JOIN LATERAL ");
            push_leg(query, listed, leg, tenant, &Bound::AtMost(k - 1));
            query.push(format!(" AS s{k} ON true"));
        }
    }
}

/// The next id of a leg. Where the primary key could be walked, too, until a row fits, tenant and status are part of what is
/// ordered by, which only the leg's own index is: a planner that thinks a status frequent would walk past every job.
fn push_leg(query: &mut QueryBuilder<Postgres>, listed: &Listed, leg: &Leg<'_>, tenant: &str, bound: &Bound<'_>) {
    let Listed { table, labels, label_id, .. } = listed;
    match leg {
        Leg::Label((key, value)) => {
            query.push(format!("(SELECT {label_id} AS id FROM {labels} WHERE tenant = ")).push_bind(tenant.to_owned());
            query.push(" AND key = ").push_bind(key.clone()).push(" AND value = ").push_bind(value.clone());
            query.push(format!(" AND {label_id} {} ", bound.relation()));
            push_bound(query, bound);
            query.push(format!(" ORDER BY {labels}.{label_id} DESC LIMIT 1)"));
        }
        Leg::Within([min_x, min_y, max_x, max_y]) => {
            query.push(format!("(SELECT id FROM {table} WHERE tenant >= ")).push_bind(tenant.to_owned());
            query.push(" AND min_x <= ").push_bind(*max_x).push(" AND max_x >= ").push_bind(*min_x);
            query.push(" AND min_y <= ").push_bind(*max_y).push(" AND max_y >= ").push_bind(*min_y);
            query.push(format!(" AND (tenant, id) {} (", bound.relation())).push_bind(tenant.to_owned()).push(", ");
            push_bound(query, bound);
            query.push(") ORDER BY tenant DESC, id DESC LIMIT 1)");
        }
        Leg::Every => {
            query.push("(SELECT CASE WHEN tenant = ").push_bind(tenant.to_owned());
            query.push(format!(" THEN id END AS id FROM (SELECT tenant, id FROM {table} WHERE (tenant, id) "));
            query.push(bound.relation()).push(" (").push_bind(tenant.to_owned()).push(", ");
            push_bound(query, bound);
            query.push(") ORDER BY tenant DESC, id DESC LIMIT 1) AS before)");
        }
        Leg::Status(status) => {
            query.push("(SELECT CASE WHEN tenant = ").push_bind(tenant.to_owned());
            query.push(" AND status = ").push_bind(*status);
            query.push(format!(" THEN id END AS id FROM (SELECT tenant, status, id FROM {table}"));
            query.push(format!(" WHERE (tenant, status, id) {} (", bound.relation()));
            query.push_bind(tenant.to_owned()).push(", ").push_bind(*status).push(", ");
            push_bound(query, bound);
            query.push(") ORDER BY tenant DESC, status DESC, id DESC LIMIT 1) AS before)");
        }
    }
}

fn push_bound(query: &mut QueryBuilder<Postgres>, bound: &Bound<'_>) {
    match bound {
        Bound::Start(start) => query.push_bind((*start).to_owned()),
        Bound::Walked => query.push("CASE WHEN walk.low = walk.high THEN walk.low ELSE walk.low || ' ' END"),
        Bound::AtMost(before) => query.push(format!("s{before}.id")),
    };
}
