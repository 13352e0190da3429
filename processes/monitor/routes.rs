//! What is served where. GET changes nothing; the one POST passes a command on to the command socket.

use super::assets::{ASSETS, Asset};
use super::connection::REQUEST_TIMEOUT;
use super::guard::{Decision, Guard};
use super::model::{Model, Viewer};
use super::{performance, pictures, reports, view};
use crate::supervisor::CONTENT_TYPE;
use crate::supervisor::command_socket::ask;
use crate::supervisor::protocol::{Answer, Request, Status};
use anyhow::{Result, bail};
use axum::Router;
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, FromRequest as _, Path, Request as HttpRequest, State};
use axum::http::{HeaderName, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use serde::Serialize;
use serde_json::json;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::Semaphore;
use tokio::sync::broadcast::error::RecvError;

/// Longest body of a request, bytes: the longest line of the command socket.
const MAX_BODY: usize = 4096;

/// Viewers that listen to events at once.
const MAX_VIEWERS: usize = 64;

/// Commands that wait for their answer at once: the command socket has other clients too.
const MAX_COMMANDS: usize = 8;

/// How old a status may be that several viewers share.
const STATUS_AGE: Duration = Duration::from_millis(900);

/// Headers of every answer: nothing from elsewhere, no frames, no guesses.
const HEADERS: [(HeaderName, &str); 4] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
];

/// A report has its styles and pictures inside, and no scripts.
const REPORT_POLICY: &str =
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'";

/// What the handlers share.
#[derive(Clone)]
struct Shared {
    model: Arc<Model>,
    commands: Arc<Semaphore>,
}

impl Shared {
    fn new(model: &Arc<Model>) -> Self {
        Self { model: Arc::clone(model), commands: Arc::new(Semaphore::new(MAX_COMMANDS)) }
    }
}

/// The metrics and nothing else.
pub fn metrics(model: &Arc<Model>) -> Router {
    let missing = || async { refuse(StatusCode::NOT_FOUND, "the metrics are at /metrics") };
    Router::new()
        .route("/metrics", get(prometheus))
        .fallback(missing)
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .with_state(Shared::new(model))
}

/// The page with all that it loads, and the metrics.
pub fn page(model: &Arc<Model>, guard: Guard) -> Router {
    let mut router = Router::new()
        .route("/metrics", get(prometheus))
        .route("/api/state", get(state))
        .route("/api/events", get(events))
        .route("/api/status", get(status))
        .route("/api/result/{number}", get(result))
        .route("/api/performance/{count}", get(performed))
        .route("/api/picture/{number}/{camera}/{projector}/{layer}", get(picture))
        .route("/api/cloud/{number}", get(cloud))
        .route("/report/{number}", get(report))
        .route("/api/command", post(command));
    for asset in &ASSETS {
        router = router.route(asset.path, get(move || async move { file(asset) }));
    }
    let missing = || async { refuse(StatusCode::NOT_FOUND, "there is nothing here; the page is at /") };
    router
        .fallback(missing)
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .layer(middleware::from_fn(move |request, next| guarded(guard.clone(), request, next)))
        .with_state(Shared::new(model))
}

/// Lets a request pass or answers it, and adds the headers of every answer.
async fn guarded(guard: Guard, request: HttpRequest, next: Next) -> Response {
    let mut response = match guard.decide(request.method(), request.uri(), request.headers()) {
        Decision::Serve => next.run(request).await,
        Decision::KeepToken(cookie) => {
            (StatusCode::SEE_OTHER, [(header::SET_COOKIE, cookie.as_str()), (header::LOCATION, "/")])
                .into_response()
        }
        Decision::Refuse(status, reason) => {
            refuse(StatusCode::from_u16(status).unwrap_or(StatusCode::FORBIDDEN), reason)
        }
    };
    for (name, value) in HEADERS {
        if !response.headers().contains_key(&name) {
            response.headers_mut().insert(name, axum::http::HeaderValue::from_static(value));
        }
    }
    response
}

fn refuse(status: StatusCode, reason: &str) -> Response {
    (status, json(&json!({ "refused": reason }))).into_response()
}

fn json<T: Serialize>(value: &T) -> Response {
    match serde_json::to_vec(value) {
        Ok(bytes) => ([(header::CONTENT_TYPE, "application/json")], bytes).into_response(),
        Err(error) => refuse(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

fn file(asset: &'static Asset) -> Response {
    let kind = [(header::CONTENT_TYPE, asset.kind), (header::CACHE_CONTROL, "no-cache")];
    let body = Bytes::from_static(asset.bytes);
    if asset.gzip {
        return (kind, [(header::CONTENT_ENCODING, "gzip")], body).into_response();
    }
    (kind, body).into_response()
}

/// Everything that a page needs when it opens or was away.
async fn state(State(shared): State<Shared>) -> Response {
    let model = &shared.model;
    let known = model.known();
    let last = known.ended.back().map(|ended| view::ended(&model.cell, ended));
    let history: Vec<_> = known.ended.iter().map(|ended| view::brief(&ended.result)).collect();
    json(&json!({
        "cell": view::cell(&model.cell, model.demo, model.run),
        "state": known.state,
        "last": last,
        "history": history,
        "scan": known.scan.as_ref().map(|shown| view::scan(&model.cell, &shown.scan.header)),
    }))
}

/// Performance of the last parts.
async fn performed(State(shared): State<Shared>, Path(count): Path<usize>) -> Response {
    let known: Vec<_> = shared.model.known().ended.iter().cloned().collect();
    json(&performance::performance(known.iter(), count))
}

/// Events as they happen; a viewer that is too slow loads everything anew.
async fn events(State(shared): State<Shared>) -> Response {
    if shared.model.viewers() >= MAX_VIEWERS {
        return refuse(StatusCode::SERVICE_UNAVAILABLE, "64 viewers are connected, which is the limit");
    }
    let stream = futures_util::stream::unfold(shared.model.viewer(), |mut viewer: Viewer| async {
        let event = match viewer.events.recv().await {
            Ok(update) => Event::default().event(update.kind).data(&*update.json),
            Err(RecvError::Lagged(_)) => Event::default().event("lost").data("{}"),
            Err(RecvError::Closed) => return None,
        };
        Some((Ok::<_, Infallible>(event), viewer))
    });
    Sse::new(stream).keep_alive(KeepAlive::new().interval(Duration::from_secs(5))).into_response()
}

/// Asks the cell, which answers within 20 ms.
async fn asked(shared: &Shared, request: Request) -> Result<Answer> {
    let socket = shared.model.socket.clone();
    tokio::task::spawn_blocking(move || ask(&socket, &request)).await?
}

async fn prometheus(State(shared): State<Shared>) -> Response {
    match asked(&shared, Request::Metrics {}).await {
        Ok(Answer::Metrics(text)) => ([(header::CONTENT_TYPE, CONTENT_TYPE)], text).into_response(),
        _ => refuse(StatusCode::SERVICE_UNAVAILABLE, "the cell did not answer"),
    }
}

async fn status(State(shared): State<Shared>) -> Response {
    let known = shared.model.known().status.clone();
    if let Some((_, status)) = known.filter(|(at, _)| at.elapsed() < STATUS_AGE) {
        return json(&*status);
    }
    match fresh_status(&shared).await {
        Ok(status) => {
            shared.model.known().status = Some((Instant::now(), Arc::clone(&status)));
            json(&*status)
        }
        Err(error) => refuse(StatusCode::SERVICE_UNAVAILABLE, &format!("the cell did not answer: {error:#}")),
    }
}

async fn fresh_status(shared: &Shared) -> Result<Arc<Status>> {
    match asked(shared, Request::Status {}).await? {
        Answer::Status(status) => Ok(Arc::from(status)),
        Answer::Refused(reason) => bail!(reason),
        _ => bail!("an unexpected answer"),
    }
}

/// Passes a command on; what the cell answers is the body, the status is the kind of answer.
async fn command(State(shared): State<Shared>, request: HttpRequest) -> Response {
    // A body that never comes would hold the place of a connection.
    let body = match tokio::time::timeout(REQUEST_TIMEOUT, Bytes::from_request(request, &())).await {
        Ok(Ok(body)) => body,
        Ok(Err(refused)) => return refused.into_response(),
        Err(_) => {
            let seconds = REQUEST_TIMEOUT.as_secs();
            let reason = format!("the body did not come within {seconds} s, which is the limit");
            return refuse(StatusCode::REQUEST_TIMEOUT, &reason);
        }
    };
    let request = match serde_json::from_slice(&body) {
        Ok(
            request @ (Request::Inspect { .. }
            | Request::Start { .. }
            | Request::Finish {}
            | Request::Abort {}
            | Request::Halt {}
            | Request::Reset {}
            | Request::Prepare { .. }
            | Request::Unprepare { .. }
            | Request::Restart { .. }),
        ) => request,
        Ok(_) => return refuse(StatusCode::FORBIDDEN, "the page has no such command; use `fringecell`"),
        Err(error) => return refuse(StatusCode::BAD_REQUEST, &format!("not a command: {error}")),
    };
    let Ok(_place) = shared.commands.try_acquire() else {
        return refuse(
            StatusCode::SERVICE_UNAVAILABLE,
            "8 commands wait for their answer, which is the limit",
        );
    };
    match asked(&shared, request).await {
        Ok(answer) => {
            let status = match answer {
                Answer::NotReady { .. } => StatusCode::CONFLICT,
                Answer::Refused(_) => StatusCode::UNPROCESSABLE_ENTITY,
                _ => StatusCode::OK,
            };
            (status, json(&answer)).into_response()
        }
        Err(error) => refuse(StatusCode::SERVICE_UNAVAILABLE, &format!("the cell did not answer: {error:#}")),
    }
}

/// Does work that takes milliseconds beside the loop that serves.
async fn beside<T: Send + 'static>(
    shared: &Shared,
    work: impl FnOnce(&Model) -> Result<T> + Send + 'static,
) -> Result<T> {
    let model = Arc::clone(&shared.model);
    tokio::task::spawn_blocking(move || work(&model)).await?
}

async fn result(State(shared): State<Shared>, Path(number): Path<u64>) -> Response {
    match beside(&shared, move |model| reports::result(model, number)).await {
        Ok(Some(result)) => json(&result),
        Ok(None) => refuse(StatusCode::NOT_FOUND, "nothing is known of this cycle"),
        Err(error) => refuse(StatusCode::INTERNAL_SERVER_ERROR, &format!("{error:#}")),
    }
}

async fn report(State(shared): State<Shared>, Path(number): Path<u64>) -> Response {
    let kind = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (header::CONTENT_SECURITY_POLICY, REPORT_POLICY),
    ];
    match beside(&shared, move |model| reports::html(model, number)).await {
        Ok(Some(html)) => (kind, html).into_response(),
        Ok(None) => refuse(StatusCode::NOT_FOUND, "nothing is known of this cycle"),
        Err(error) => refuse(StatusCode::INTERNAL_SERVER_ERROR, &format!("{error:#}")),
    }
}

/// The scan after the cycle of this number, if it is the last one.
fn shown(model: &Model, number: u64) -> Option<Arc<super::model::ShownScan>> {
    model.known().scan.clone().filter(|shown| shown.scan.header.number == number)
}

const GONE: &str = "this scan was replaced by a newer one";

async fn picture(
    State(shared): State<Shared>,
    Path((number, camera, projector, layer)): Path<(u64, u32, u32, String)>,
) -> Response {
    let Some(shown) = shown(&shared.model, number) else { return refuse(StatusCode::GONE, GONE) };
    match beside(&shared, move |model| pictures::png(&model.cell, &shown, camera, projector, &layer)).await {
        Ok(png) => ([(header::CONTENT_TYPE, "image/png")], png).into_response(),
        Err(error) => refuse(StatusCode::NOT_FOUND, &format!("{error:#}")),
    }
}

async fn cloud(State(shared): State<Shared>, Path(number): Path<u64>) -> Response {
    match shown(&shared.model, number) {
        Some(shown) => {
            ([(header::CONTENT_TYPE, "application/octet-stream")], shown.packed.clone()).into_response()
        }
        None => refuse(StatusCode::GONE, GONE),
    }
}
