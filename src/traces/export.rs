//! How spans leave the process: OTLP over HTTP, protobuf (opentelemetry.io/docs/specs/otlp).
//!
//! The SDK's batch processor has a thread of its own, so the client may block: it is the one that webhooks use, and no second.
//! At most `OTEL_BSP_MAX_QUEUE_SIZE` spans (2,048) wait; beyond that they are dropped where they end, which takes no longer
//! than queueing one. The usual `OTEL_*` variables say the rest: sampler, headers, the service's name.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use bytes::Bytes;
use opentelemetry::KeyValue;
use opentelemetry_http::{HttpClient, HttpError, Request, Response};
use opentelemetry_otlp::{ExporterBuildError, Protocol, SpanExporter, WithExportConfig, WithHttpConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::SdkTracerProvider;
use thiserror::Error;
use uuid::Uuid;

/// How long a receiver may take, and how long it may take to answer a connection.
const WITHIN: Duration = Duration::from_secs(10);
const CONNECTED_WITHIN: Duration = Duration::from_secs(2);
/// Bytes of an answer that are read: it says how many spans were not taken.
const ANSWER: u64 = 64 << 10;
/// What a receiver's own address is completed with.
const PATH: &str = "/v1/traces";

#[derive(Debug, Error)]
pub enum TracesError {
    #[error("{0} is not the address of an OTLP receiver: http://HOST:PORT, or https")]
    Address(String),
    #[error("traces cannot be exported: {0}")]
    Exporter(#[from] ExporterBuildError),
}

/// The URL that spans are sent to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoint(String);

impl Endpoint {
    /// What was asked for, or what the usual variables say; `None` where neither does.
    pub fn of(asked: Option<&str>, variable: impl Fn(&str) -> Option<String>) -> Result<Option<Self>, TracesError> {
        let variable = |name: &str| variable(name).filter(|value| !value.is_empty());
        let is = |name: &str, value: &str| variable(name).is_some_and(|own| own.eq_ignore_ascii_case(value));
        if is("OTEL_SDK_DISABLED", "true") || is("OTEL_TRACES_EXPORTER", "none") {
            return Ok(None);
        }
        let base = |address: &str| format!("{}{PATH}", address.trim_end_matches('/'));
        let url = match asked {
            Some(address) => Some(base(address.trim_end_matches('/').trim_end_matches(PATH))),
            None => variable("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
                .or_else(|| variable("OTEL_EXPORTER_OTLP_ENDPOINT").map(|address| base(&address))),
        };
        let is_right = |url: &String| {
            let parsed = url.parse::<ureq::http::Uri>().ok();
            parsed.is_some_and(|uri| uri.host().is_some() && matches!(uri.scheme_str(), Some("http" | "https")))
        };
        match url {
            Some(url) if !is_right(&url) => Err(TracesError::Address(url)),
            url => Ok(url.map(Self)),
        }
    }
}

pub(super) fn provider(endpoint: &Endpoint, role: &'static str) -> Result<SdkTracerProvider, TracesError> {
    let config = ureq::Agent::config_builder()
        .timeout_global(Some(WITHIN))
        .timeout_connect(Some(CONNECTED_WITHIN))
        .max_redirects(0)
        .http_status_as_error(false)
        .user_agent(concat!("mapfit/", env!("CARGO_PKG_VERSION")))
        .build();
    let client = Client { agent: config.into(), is_away: AtomicBool::new(false) };
    let exporter = SpanExporter::builder()
        .with_http()
        .with_http_client(client)
        .with_protocol(Protocol::HttpBinary)
        .with_endpoint(&endpoint.0)
        .build()?;
    Ok(SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource(role)).build())
}

/// Who makes the spans: `OTEL_SERVICE_NAME` and `OTEL_RESOURCE_ATTRIBUTES` before what is known here.
fn resource(role: &'static str) -> Resource {
    let own = [
        KeyValue::new("service.name", "mapfit"),
        KeyValue::new("service.version", env!("CARGO_PKG_VERSION")),
        KeyValue::new("service.instance.id", Uuid::now_v7().to_string()),
        KeyValue::new("process.pid", i64::from(std::process::id())),
        KeyValue::new("mapfit.role", role),
    ];
    let given = Resource::builder().build();
    let is_named = given.get(&"service.name".into()).is_some_and(|name| !name.as_str().starts_with("unknown_service"));
    let added = own.into_iter().filter(|own| match own.key.as_str() {
        "service.name" => !is_named,
        _ => given.get(&own.key).is_none(),
    });
    Resource::builder().with_attributes(added).build()
}

/// Blocks the exporter's thread, which has nothing else to do.
#[derive(Debug)]
struct Client {
    agent: ureq::Agent,
    /// Said once when the receiver goes, and once when it is back.
    is_away: AtomicBool,
}

impl Client {
    fn send(&self, request: Request<Bytes>) -> Result<Response<Bytes>, ureq::Error> {
        let (parts, body) = request.into_parts();
        let mut answer = self.agent.run(ureq::http::Request::from_parts(parts, &body[..]))?;
        let bytes = answer.body_mut().with_config().limit(ANSWER).read_to_vec()?;
        Ok(answer.map(|_| bytes.into()))
    }

    fn tell(&self, is_away: bool, why: &dyn std::fmt::Display) {
        match (is_away, self.is_away.swap(is_away, Ordering::Relaxed)) {
            (true, false) => tracing::warn!(%why, "the receiver of traces takes none; they are dropped until it does"),
            (false, true) => tracing::info!("the receiver of traces is back"),
            _ => {}
        }
    }
}

#[async_trait]
impl HttpClient for Client {
    async fn send_bytes(&self, request: Request<Bytes>) -> Result<Response<Bytes>, HttpError> {
        match self.send(request) {
            Ok(answer) => {
                self.tell(!answer.status().is_success(), &answer.status());
                Ok(answer)
            }
            Err(error) => {
                self.tell(true, &error);
                Err(error.into())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_endpoint_is_what_was_asked_for_or_what_the_usual_variables_say() {
        let of = |asked: Option<&str>, variables: &[(&str, &str)]| {
            let find =
                |name: &str| variables.iter().find(|(own, _)| *own == name).map(|(_, value)| (*value).to_owned());
            Endpoint::of(asked, find).map(|endpoint| endpoint.map(|endpoint| endpoint.0))
        };
        let url = |text: &str| Some(text.to_owned());
        assert_eq!(of(None, &[]).unwrap(), None);
        assert_eq!(of(Some("http://a:4318"), &[]).unwrap(), url("http://a:4318/v1/traces"));
        assert_eq!(of(Some("https://a/otlp/v1/traces/"), &[]).unwrap(), url("https://a/otlp/v1/traces"));
        let base = ("OTEL_EXPORTER_OTLP_ENDPOINT", "http://b:4318/");
        let whole = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "http://c/x");
        assert_eq!(of(None, &[base]).unwrap(), url("http://b:4318/v1/traces"));
        assert_eq!(of(None, &[base, whole]).unwrap(), url("http://c/x"));
        assert_eq!(of(Some("http://a"), &[base, whole]).unwrap(), url("http://a/v1/traces"));
        assert_eq!(of(Some("http://a"), &[("OTEL_SDK_DISABLED", "TRUE")]).unwrap(), None);
        assert_eq!(of(None, &[("OTEL_EXPORTER_OTLP_ENDPOINT", "")]).unwrap(), None);
        for wrong in ["collector:4318", "ftp://a", "http://", "a b"] {
            assert!(matches!(of(Some(wrong), &[]), Err(TracesError::Address(_))), "{wrong}");
        }
    }
}
