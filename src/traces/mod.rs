//! Traces: what became of a job, from its request to its artifact, across processes.
//!
//! OpenTelemetry's model and SDK, W3C Trace Context between processes. A request that submits has a span, its submission one
//! under it; the job's row carries that one's `traceparent`, so every attempt, in whichever process, is a span under the
//! submission, with a span for each of its stages:
//!
//! ```text
//! POST /v1/jobs > submit > attempt > claim, load, fit, covariance, store, finish
//! ```
//!
//! Spans go out in batches, from a thread of their own, through a queue of bounded length (`export`). Nothing waits for it: what a
//! receiver that is away does not take is dropped. Where nothing is exported nothing is recorded, and a `traceparent` that
//! a client sent is passed on in the job's row all the same.

mod export;

use std::borrow::Cow;
use std::time::{Duration, SystemTime};

use opentelemetry::trace::{
    SpanContext, SpanId, SpanKind, Status, TraceContextExt, TraceFlags, TraceId, TraceState, Tracer, TracerProvider,
};
use opentelemetry::{Context, KeyValue, Value};
use opentelemetry_sdk::trace::SdkTracerProvider;

pub use export::{Endpoint, TracesError};

/// How long the last spans may take to go out when a process ends.
const LAST_WITHIN: Duration = Duration::from_secs(2);
/// What the spans say made them.
const SCOPE: &str = "mapfit";

/// Where a process's spans go; nowhere by default.
#[derive(Debug, Clone, Default)]
pub struct Traces(Option<SdkTracerProvider>);

impl Traces {
    /// Spans go to this endpoint. `role` is what the process does: `serve` or `worker`.
    pub fn to(endpoint: &Endpoint, role: &'static str) -> Result<Self, TracesError> {
        Ok(Self(Some(export::provider(endpoint, role)?)))
    }

    pub fn are_kept(&self) -> bool {
        self.0.is_some()
    }

    /// Begins a span under another process's, or another of this one's; it may have begun before.
    pub fn begin(
        &self,
        name: impl Into<Cow<'static, str>>,
        kind: SpanKind,
        parent: &Context,
        began: Option<SystemTime>,
    ) -> Span {
        let Some(provider) = &self.0 else { return Span { context: parent.clone(), is_kept: false } };
        let tracer = provider.tracer(SCOPE);
        let mut builder = tracer.span_builder(name).with_kind(kind);
        builder.start_time = began;
        Span { context: parent.with_span(tracer.build_with_context(builder, parent)), is_kept: true }
    }

    /// Sends what has not gone out yet, within `LAST_WITHIN`.
    pub fn end(&self) {
        if let Some(provider) = &self.0
            && let Err(error) = provider.shutdown_with_timeout(LAST_WITHIN)
        {
            tracing::debug!(%error, "the last spans did not go out");
        }
    }
}

/// A span under way; it ends when it is dropped. Where nothing is kept it stands for its parent.
#[derive(Debug)]
pub struct Span {
    context: Context,
    is_kept: bool,
}

impl Span {
    /// For spans under this one.
    pub fn context(&self) -> &Context {
        &self.context
    }

    pub fn set(&self, name: &'static str, value: impl Into<Value>) {
        if self.is_kept {
            self.context.span().set_attribute(KeyValue::new(name, value));
        }
    }

    /// What it was for did not happen.
    pub fn fail(&self, why: impl Into<Cow<'static, str>>) {
        if self.is_kept {
            self.context.span().set_status(Status::error(why));
        }
    }

    /// For another process.
    pub fn traceparent(&self) -> Option<String> {
        traceparent(&self.context)
    }
}

impl Drop for Span {
    fn drop(&mut self) {
        if self.is_kept {
            self.context.span().end();
        }
    }
}

/// The context of a `traceparent` from elsewhere: `00-TRACE-SPAN-FLAGS`, in lower-case hexadecimal. `None` where it is no
/// such thing; of a version that is not known yet, what follows the flags is left out.
pub fn context_of(traceparent: &str) -> Option<Context> {
    let parts: Vec<&str> = traceparent.split('-').collect();
    let [version, trace, span, flags, rest @ ..] = &parts[..] else { return None };
    let is_hex = |text: &str, digits: usize| {
        text.len() == digits && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
    };
    let is_one = is_hex(version, 2) && is_hex(trace, 32) && is_hex(span, 16) && is_hex(flags, 2);
    if !is_one || *version == "ff" || (*version == "00" && !rest.is_empty()) {
        return None;
    }
    let (trace, span) = (TraceId::from_hex(trace).ok()?, SpanId::from_hex(span).ok()?);
    let sampled = TraceFlags::new(u8::from_str_radix(flags, 16).ok()?) & TraceFlags::SAMPLED;
    let context = SpanContext::new(trace, span, sampled, true, TraceState::NONE);
    context.is_valid().then(|| Context::new().with_remote_span_context(context))
}

/// The `traceparent` of a context that has a span.
pub fn traceparent(context: &Context) -> Option<String> {
    let span = context.span().span_context().clone();
    let sampled = u8::from(span.is_sampled());
    span.is_valid().then(|| format!("00-{}-{}-{sampled:02x}", span.trace_id(), span.span_id()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: &str = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";

    #[test]
    fn a_traceparent_comes_back_as_it_was() {
        let context = context_of(ONE).unwrap();
        assert!(context.span().span_context().is_sampled() && context.span().span_context().is_remote());
        assert_eq!(traceparent(&context).as_deref(), Some(ONE));
        let unsampled = ONE.replace("-01", "-00");
        assert_eq!(traceparent(&context_of(&unsampled).unwrap()), Some(unsampled));
        assert_eq!(
            traceparent(&context_of(&ONE.replace("00-4", "cc-4").replace("-01", "-01-more")).unwrap()).unwrap(),
            ONE
        );
        assert_eq!(traceparent(&Context::new()), None);
    }

    #[test]
    fn what_is_no_traceparent_is_none() {
        let zeros = format!("00-{}-00f067aa0ba902b7-01", "0".repeat(32));
        let upper = ONE.to_uppercase();
        let more = format!("{ONE}-more");
        let never = ONE.replace("00-4", "ff-4");
        for wrong in ["", "00", "00---", &zeros, &upper, &more, &never, &ONE[..54], "é0-4bf92f35-00f0-01"] {
            assert!(context_of(wrong).is_none(), "{wrong}");
        }
    }

    #[test]
    fn where_nothing_is_kept_a_span_stands_for_its_parent() {
        let traces = Traces::default();
        let parent = context_of(ONE).unwrap();
        let span = traces.begin("x", SpanKind::Internal, &parent, None);
        span.set("a", 1);
        assert_eq!(span.traceparent().as_deref(), Some(ONE));
        assert_eq!(traces.begin("x", SpanKind::Internal, &Context::new(), None).traceparent(), None);
    }
}
