//! `multipart/form-data` (RFC 7578): the parts of a body that is here as a whole, without copying them.
//!
//! A body is `--B CRLF headers CRLF CRLF content CRLF`, again and again, and `--B--` at the end, `B` the boundary that the
//! content type names. Only a part's name is read of its headers. What a client sends before the first boundary and after
//! the last is passed over, as the standard asks.

use axum::http::{HeaderMap, StatusCode, header};
use bytes::Bytes;
use memchr::memmem;

use super::problem::Problem;

/// A form has few parts.
const MOST_PARTS: usize = 16;
/// A part's headers have so many bytes at most.
const LARGEST_HEAD: usize = 8 << 10;
/// RFC 2046, 5.1.1.
const LONGEST_BOUNDARY: usize = 70;

/// One part.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    pub name: String,
    pub content: Bytes,
}

/// The boundary that a content type names.
pub fn boundary(headers: &HeaderMap) -> Result<String, Problem> {
    let value = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let boundary = parameter(value, "boundary").filter(|b| (1..=LONGEST_BOUNDARY).contains(&b.len()));
    boundary.ok_or_else(|| malformed("its content type names no boundary of 1 to 70 characters"))
}

/// The parts of a body, in their order.
pub fn parts(body: &Bytes, boundary: &str) -> Result<Vec<Part>, Problem> {
    let delimiter = format!("\r\n--{boundary}");
    let finder = memmem::Finder::new(delimiter.as_bytes());
    // The first boundary may stand at the very beginning.
    let opening = &delimiter.as_bytes()[2..];
    let mut at = match body.starts_with(opening) {
        true => opening.len(),
        false => {
            finder.find(body).map(|k| k + delimiter.len()).ok_or_else(|| malformed("the boundary is not in it"))?
        }
    };
    let mut parts = Vec::new();
    loop {
        let rest = &body[at..];
        if rest.starts_with(b"--") {
            return Ok(parts);
        }
        // Blanks may pad a boundary's line.
        let padding = rest.iter().take_while(|byte| matches!(byte, b' ' | b'\t')).count();
        if !rest[padding..].starts_with(b"\r\n") {
            return Err(malformed("a boundary's line goes on"));
        }
        let head = at + padding;
        let window = &body[head..body.len().min(head + LARGEST_HEAD)];
        let blank = memmem::find(window, b"\r\n\r\n").ok_or_else(|| malformed("a part's headers do not end"))?;
        let content = head + blank + 4;
        let end = content - 2 + finder.find(&body[content - 2..]).ok_or_else(|| malformed("a part does not end"))?;
        let name = name(&body[head..head + blank])?;
        if parts.len() == MOST_PARTS {
            return Err(malformed("it has too many parts"));
        }
        parts.push(Part { name, content: body.slice(content.min(end)..end) });
        at = end + delimiter.len();
    }
}

/// The name in a part's `Content-Disposition: form-data; name="..."`.
fn name(head: &[u8]) -> Result<String, Problem> {
    let head = std::str::from_utf8(head).map_err(|_| malformed("a part's headers are no text"))?;
    let disposition = head.split("\r\n").find_map(|line| {
        let (field, value) = line.split_once(':')?;
        field.trim().eq_ignore_ascii_case("content-disposition").then(|| value.trim())
    });
    let named = disposition.and_then(|value| parameter(value, "name"));
    named.ok_or_else(|| malformed("a part has no name"))
}

/// A parameter of a header's value, `a; key=value; key="quoted \" value"`.
fn parameter(value: &str, key: &str) -> Option<String> {
    let mut rest = value.split_once(';')?.1;
    loop {
        let (name, after) = rest.split_once('=')?;
        let (text, more) = match after.strip_prefix('"') {
            Some(quoted) => unquoted(quoted)?,
            None => {
                let end = after.find(';').unwrap_or(after.len());
                (after[..end].trim().to_owned(), &after[end..])
            }
        };
        if name.trim_matches([' ', '\t', ';']).eq_ignore_ascii_case(key) {
            return Some(text);
        }
        rest = more.trim_start_matches([' ', '\t', ';']);
    }
}

/// A quoted text, after its first quote, and what follows it.
fn unquoted(quoted: &str) -> Option<(String, &str)> {
    let mut text = String::new();
    let mut letters = quoted.char_indices();
    while let Some((k, letter)) = letters.next() {
        match letter {
            '"' => return Some((text, &quoted[k + 1..])),
            '\\' => text.push(letters.next()?.1),
            letter => text.push(letter),
        }
    }
    None
}

fn malformed(what: &str) -> Problem {
    let detail = format!("the body is no multipart/form-data: {what}");
    Problem { detail, slug: "malformed-multipart", ..Problem::of_status(StatusCode::BAD_REQUEST) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(body: &str) -> Result<Vec<(String, String)>, String> {
        let body = Bytes::copy_from_slice(body.as_bytes());
        let text = |part: Part| (part.name, String::from_utf8_lossy(&part.content).into_owned());
        parts(&body, "B").map(|parts| parts.into_iter().map(text).collect()).map_err(|problem| problem.detail)
    }

    #[test]
    fn parts_come_with_their_names_and_every_byte() {
        let body = "preamble\r\n--B\r\nContent-Disposition: form-data; name=\"a\"; filename=\"x;y\\\".log\"\r\nX: y\r\n\r\n1\r\n2--B\r\n\
                    \r\n--B \t\r\ncontent-disposition: form-data; filename=n; name=options\r\n\r\n\r\n--B--\r\nepilogue";
        let both = [("a".to_owned(), "1\r\n2--B\r\n".to_owned()), ("options".to_owned(), String::new())];
        assert_eq!(read(body).unwrap(), both);
        assert_eq!(read("--B--").unwrap(), []);
    }

    #[test]
    fn what_is_no_form_says_why() {
        for (body, why) in [
            ("", "boundary is not in it"),
            ("--B\r\nContent-Disposition: form-data; name=a\r\n\r\n1", "does not end"),
            ("--B\r\nContent-Disposition: form-data\r\n\r\n1\r\n--B--", "no name"),
            ("--B\r\nContent-Disposition: form-data; name=\"a\r\n\r\n1\r\n--B--", "no name"),
            ("--Bx\r\n", "goes on"),
            ("--B\r\nX: y", "headers do not end"),
            ("--B", "goes on"),
        ] {
            let said = read(body).unwrap_err();
            assert!(said.contains(why), "{body:?}: {said}");
        }
    }

    #[test]
    fn a_boundary_may_be_quoted() {
        let of = |value: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::CONTENT_TYPE, value.parse().unwrap());
            boundary(&headers).ok()
        };
        assert_eq!(of("multipart/form-data; charset=utf-8; boundary=\"a b;c\""), Some("a b;c".into()));
        assert_eq!(of("multipart/form-data;boundary=----X1"), Some("----X1".into()));
        assert_eq!((of("multipart/form-data"), of("multipart/form-data; boundary=")), (None, None));
    }
}
