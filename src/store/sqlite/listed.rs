//! Pages of jobs and maps, newest first, by walking indexes side by side.
//!
//! Each condition (a label, a status, a box) is a *leg*: an index that gives the next id below a bound. A page leaps from
//! leg to leg: the least of the legs' ids is the next bound, and where all agree lies a hit (leapfrog join, Veldhuizen 2014).
//! So a page costs what its rarest condition has, whichever that is, without a guess of the planner's.

use sqlx::{QueryBuilder, Sqlite};

use crate::store::Listing;

/// What is listed: its table, and its table of labels.
pub struct Listed {
    table: &'static str,
    labels: &'static str,
    label_id: &'static str,
}

pub const JOBS: Listed = Listed { table: "jobs", labels: "job_labels", label_id: "job_id" };
pub const MAPS: Listed = Listed { table: "maps", labels: "map_labels", label_id: "map_id" };

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
pub fn page(listed: &Listed, columns: &str, listing: &Listing) -> QueryBuilder<Sqlite> {
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
    let (all, least, greatest) = match &names[..] {
        [one] => (one.clone(), one.clone(), one.clone()),
        many => (many.join(", "), format!("min({})", many.join(", ")), format!("max({})", many.join(", "))),
    };
    // An id and a blank sorts just above the id, so that what lies below it includes it.
    let bound = format!("CASE WHEN {least} = {greatest} THEN l0 ELSE {least} || ' ' END");
    let mut query = QueryBuilder::<Sqlite>::new(format!("WITH RECURSIVE walk ({all}) AS (SELECT "));
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
    query.push(format!(" FROM walk WHERE {least} IS NOT NULL) SELECT "));
    let columns: Vec<String> = columns.split(',').map(|column| format!("r.{}", column.trim())).collect();
    query.push(columns.join(", "));
    query.push(format!(" FROM (SELECT l0 FROM walk WHERE {least} = {greatest} LIMIT ")).push_bind(listing.limit);
    query.push(format!(") AS hit CROSS JOIN {} AS r ON r.id = hit.l0 ORDER BY r.id DESC", listed.table));
    query
}

enum Bound<'a> {
    Given(&'a str),
    Walked(&'a str),
}

/// The next id of a leg below a bound.
fn push_leg(query: &mut QueryBuilder<Sqlite>, listed: &Listed, leg: &Leg<'_>, tenant: &str, bound: &Bound<'_>) {
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
