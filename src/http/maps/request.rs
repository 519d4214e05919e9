//! A request for one representation of a map, from its address to the answer.
//!
//! Every GET below `/v1/maps/{id}` goes the same way: find the record (404), read the parameters and settle the format
//! (422, 406), answer 304 where the client has it, else load the arrays, compute off the async threads, and tag the
//! result. A handler says only what is its own.

use axum::extract::{FromRequestParts, RawPathParams};
use axum::http::request::Parts;
use axum::http::{HeaderMap, Uri};
use axum::response::Response;

use crate::http::shared::compute::{Leash, Queue};
use crate::http::shared::negotiate::{Format, negotiate};
use crate::http::shared::params::Params;
use crate::http::shared::problem::Problem;
use crate::http::shared::tag::Tag;
use crate::http::shared::{AppState, Caller};
use crate::jobs::MapRecord;
use crate::map::FittedMap;
use crate::uncertainty::Kind;

/// The names of both covariances, the default first.
pub const KINDS: [(&str, Kind); 2] = [("propagated", Kind::Propagated), ("posterior", Kind::Posterior)];

/// A request for a map, its record found.
pub struct MapRequest {
    pub state: AppState,
    pub caller: Caller,
    pub record: MapRecord,
    pub params: Params,
    /// Of the record, where that is what is asked for: name and labels may change.
    pub version: String,
    headers: HeaderMap,
    uri: Uri,
}

impl FromRequestParts<AppState> for MapRequest {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &AppState) -> Result<Self, Problem> {
        let Ok(caller) = Caller::from_request_parts(parts, state).await;
        // More of the path may be parameters: the first is the map's id.
        let path = RawPathParams::from_request_parts(parts, state).await;
        let id = path.ok().and_then(|path| path.iter().next().map(|(_, id)| id.to_owned()));
        let id = id.ok_or_else(|| Problem::not_found("there is no such map"))?;
        Ok(Self {
            record: state.map_record(&caller, &id).await?,
            caller,
            params: Params::of(&parts.uri),
            version: String::new(),
            headers: parts.headers.clone(),
            uri: parts.uri.clone(),
            state: state.clone(),
        })
    }
}

/// A request whose representation has to be made.
pub struct Wanted {
    pub state: AppState,
    pub caller: Caller,
    pub record: MapRecord,
    pub format: Format,
    tag: Tag,
}

/// What a settled request comes to.
pub enum Settled {
    /// The client has this representation.
    Unchanged(Response),
    Wanted(Box<Wanted>),
}

impl MapRequest {
    /// Settles the format among those on offer, the default first; every fault of the parameters is answered here.
    pub fn settle(mut self, offered: &[Format]) -> Result<Settled, Problem> {
        let format = negotiate(&self.headers, &mut self.params, offered)?;
        self.params.finish()?;
        let tag = Tag::of(&self.uri, format, &self.version);
        Ok(match tag.not_modified(&self.headers) {
            Some(response) => Settled::Unchanged(response),
            None => Settled::Wanted(Box::new(Wanted {
                state: self.state,
                caller: self.caller,
                record: self.record,
                format,
                tag,
            })),
        })
    }

    /// Answers with what `make` makes of the map's arrays in one go.
    pub async fn answer(
        self,
        offered: &[Format],
        make: impl FnOnce(&FittedMap, &MapRecord, Format) -> Result<Vec<u8>, Problem> + Send + 'static,
    ) -> Result<Response, Problem> {
        self.answer_while(offered, move |map, record, format, _| make(map, record, format)).await
    }

    /// Answers with what `make` makes of them step by step, as long as its leash holds.
    pub async fn answer_while(
        self,
        offered: &[Format],
        make: impl FnOnce(&FittedMap, &MapRecord, Format, &Leash) -> Result<Vec<u8>, Problem> + Send + 'static,
    ) -> Result<Response, Problem> {
        match self.settle(offered)? {
            Settled::Unchanged(response) => Ok(response),
            Settled::Wanted(wanted) => wanted.from_map(make).await,
        }
    }
}

impl Wanted {
    /// The representation `make` makes of the map's arrays; nothing where nobody waits for it any more.
    pub async fn from_map(
        self,
        make: impl FnOnce(&FittedMap, &MapRecord, Format, &Leash) -> Result<Vec<u8>, Problem> + Send + 'static,
    ) -> Result<Response, Problem> {
        let (turn, map) = self.state.turn_with(Queue::Answers, &self.record).await?;
        let (record, format) = (self.record.clone(), self.format);
        let form = move |leash: &Leash| {
            leash.goes_on()?;
            make(&map, &record, format, leash)
        };
        let body = turn.run(form).await?;
        self.respond(body)
    }

    /// The representation, made already.
    pub fn respond(self, body: Vec<u8>) -> Result<Response, Problem> {
        let body = self.state.answers.take(body.len())?.body(body);
        Ok(self.tag.respond(self.format, body))
    }
}
