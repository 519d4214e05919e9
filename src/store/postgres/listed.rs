//! Pages of jobs and maps, newest first, by walking indexes side by side.
//!
//! Each condition (a label, a status, a box) is a *leg*: an index that gives the next id below a bound. A page leaps from
//! leg to leg: the least of the legs' ids is the next bound, and where all agree lies a hit (leapfrog join, Veldhuizen 2014).
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
    rows: "JOIN jobs AS j ON j.id = hit.l0 LEFT JOIN leases AS l ON l.job_id = j.id",
    row_id: "j.id",
};
pub const MAPS: Listed = Listed {
    table: "maps",
    labels: "map_labels",
    label_id: "map_id",
    columns: rows::MAP,
    rows: "JOIN maps AS m ON m.id = hit.l0",
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

/// The query for a page.
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
    let names: Vec<String> = (0..legs.len()).map(|k| format!("l{k}")).collect();
    // LEAST passes over what is null, so the end of a leg is asked for by itself.
    let each = |condition: &str| names.iter().map(|name| format!("{name} {condition}")).collect::<Vec<_>>();
    let goes_on = each("IS NOT NULL").join(" AND ");
    let agree = each("= l0").join(" AND ");
    let all = names.join(", ");
    // An id and a blank sorts just above the id, so that what lies below it includes it.
    let bound = format!("CASE WHEN {agree} THEN l0 ELSE LEAST({all}) || ' ' END");
    let mut query = QueryBuilder::<Postgres>::new(format!("WITH RECURSIVE walk ({all}) AS (SELECT "));
    let start = listing.before.clone().unwrap_or_else(|| ABOVE_ALL.to_owned());
    for (k, leg) in legs.iter().enumerate() {
        query.push(if k > 0 { ", " } else { "" });
        push_leg(&mut query, listed, leg, &listing.tenant, &Bound::Given(&start));
    }
    query.push(" UNION ALL SELECT ");
    for (k, leg) in legs.iter().enumerate() {
        query.push(if k > 0 { ", " } else { "" });
        push_leg(&mut query, listed, leg, &listing.tenant, &Bound::Walked(&bound));
    }
    query.push(format!(" FROM walk WHERE {goes_on}) SELECT {}", listed.columns));
    query.push(format!(" FROM (SELECT l0 FROM walk WHERE {agree} LIMIT ")).push_bind(listing.limit);
    query.push(format!(") AS hit {} ORDER BY {} DESC", listed.rows, listed.row_id));
    query
}

enum Bound<'a> {
    Given(&'a str),
    Walked(&'a str),
}

/// The next id of a leg below a bound.
fn push_leg(query: &mut QueryBuilder<Postgres>, listed: &Listed, leg: &Leg<'_>, tenant: &str, bound: &Bound<'_>) {
    let (table, id) = match leg {
        Leg::Label(_) => (listed.labels, listed.label_id),
        _ => (listed.table, "id"),
    };
    query.push(format!("(SELECT {id} FROM {table} WHERE tenant = ")).push_bind(tenant.to_owned());
    match leg {
        Leg::Every => {}
        Leg::Label((key, value)) => {
            query.push(" AND key = ").push_bind(key.clone()).push(" AND value = ").push_bind(value.clone());
        }
        Leg::Status(status) => {
            query.push(" AND status = ").push_bind(*status);
        }
        Leg::Within([min_x, min_y, max_x, max_y]) => {
            query.push(" AND min_x <= ").push_bind(*max_x).push(" AND max_x >= ").push_bind(*min_x);
            query.push(" AND min_y <= ").push_bind(*max_y).push(" AND max_y >= ").push_bind(*min_y);
        }
    }
    query.push(format!(" AND {id} < "));
    match bound {
        Bound::Given(id) => query.push_bind((*id).to_owned()),
        Bound::Walked(expression) => query.push(*expression),
    };
    query.push(format!(" ORDER BY {id} DESC LIMIT 1)"));
}
