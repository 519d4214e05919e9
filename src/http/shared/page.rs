//! Lists, page by page, and times as clients read them.

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use serde::Serialize;
use utoipa::ToSchema;

/// One page of a list.
#[derive(Debug, Serialize, ToSchema)]
pub struct Page<T: ToSchema> {
    pub items: Vec<T>,
    /// For `?cursor=`; null on the last page.
    #[schema(required)]
    pub next_cursor: Option<String>,
}

impl<T: ToSchema> Page<T> {
    /// A page from one row more than it shows, which tells whether another follows. `id` is what a cursor names.
    pub fn of<S>(rows: Vec<S>, limit: i64, id: impl Fn(&S) -> &str) -> Self
    where
        T: From<S>,
    {
        Self::cut(rows, limit, |row| to_cursor(id(row)))
    }

    /// The same of rows that a number orders.
    pub fn numbered<S>(rows: Vec<S>, limit: i64, number: impl Fn(&S) -> i64) -> Self
    where
        T: From<S>,
    {
        Self::cut(rows, limit, |row| to_cursor(&number(row).to_string()))
    }

    fn cut<S>(mut rows: Vec<S>, limit: i64, cursor: impl Fn(&S) -> String) -> Self
    where
        T: From<S>,
    {
        let more = rows.len() as i64 > limit;
        rows.truncate(limit as usize);
        let next_cursor = rows.last().filter(|_| more).map(cursor);
        Self { items: rows.into_iter().map(T::from).collect(), next_cursor }
    }
}

const CURSOR: &str = "before:";

/// The opaque cursor that continues below an id.
pub fn to_cursor(id: &str) -> String {
    URL_SAFE_NO_PAD.encode(format!("{CURSOR}{id}"))
}

/// The id a cursor continues below, where it is one of ours.
pub fn from_cursor(cursor: &str) -> Option<String> {
    uuid::Uuid::parse_str(&below(cursor)?).ok().map(|id| id.to_string())
}

/// The number a cursor continues below, likewise.
pub fn from_numbered_cursor(cursor: &str) -> Option<i64> {
    below(cursor)?.parse().ok()
}

fn below(cursor: &str) -> Option<String> {
    let text = String::from_utf8(URL_SAFE_NO_PAD.decode(cursor).ok()?).ok()?;
    text.strip_prefix(CURSOR).map(str::to_owned)
}

/// RFC 3339 in UTC, to the millisecond.
pub fn timestamp(milliseconds: i64) -> Option<String> {
    jiff::Timestamp::from_millisecond(milliseconds).ok().map(|time| format!("{time:.3}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_comes_back_as_its_id() {
        let id = uuid::Uuid::now_v7().to_string();
        assert_eq!(from_cursor(&to_cursor(&id)), Some(id));
        assert_eq!(from_cursor("YmVmb3JlOnh5eg"), None);
    }
}
