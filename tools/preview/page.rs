//! The picture in a browser: a page, the stream of pictures, the last one as PNG, its figures.

use super::connection;
use super::guard::{Decision, Guard};
use anyhow::{Context, Result};
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::{StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use futures_util::stream;
use report::live::LivePicture;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use tokio::sync::watch;

const PAGE: &str = "<!doctype html><meta charset=utf-8><title>fringecell preview</title>\
    <style>body{background:#111;color:#ddd;font:14px sans-serif;margin:1em}img{max-width:100%}</style>\
    <p>red: clipped; with --modulation teal to yellow: modulation, blue: without light. <a href=/frame.png style=color:#9cf>PNG</a> \
    <a href=/figures.json style=color:#9cf>figures</a></p><img src=/stream alt=picture>";

/// The last picture, encoded.
#[derive(Debug, Clone, Default)]
struct Shown {
    jpeg: Bytes,
    picture: Option<Arc<LivePicture>>,
    figures: Bytes,
}

/// A page on an address until the program ends.
pub(super) struct Page {
    /// Address that it is served at.
    pub address: SocketAddr,
    shown: watch::Sender<Shown>,
}

impl Page {
    /// Listens, and serves from a thread of its own.
    ///
    /// # Errors
    /// The address is taken, or the system refuses a thread.
    pub(super) fn serve(address: SocketAddr) -> Result<Self> {
        let listener = TcpListener::bind(address).with_context(|| {
            format!("--serve {address}: cannot listen there; choose another port, or 0 for any")
        })?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let (shown, seen) = watch::channel(Shown::default());
        let router = router(seen, Guard::new(None, &address));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        std::thread::Builder::new().name("page".into()).spawn(move || {
            runtime.block_on(async {
                if let Ok(listener) = tokio::net::TcpListener::from_std(listener) {
                    connection::serve(&listener, router, true).await;
                }
            });
        })?;
        Ok(Self { address, shown })
    }

    /// Shows another picture instead.
    pub(super) fn show(&self, picture: Arc<LivePicture>, jpeg: Vec<u8>, figures: String) {
        self.shown.send_replace(Shown { jpeg: jpeg.into(), picture: Some(picture), figures: figures.into() });
    }
}

fn router(seen: watch::Receiver<Shown>, guard: Guard) -> Router {
    let html = [(header::CONTENT_TYPE, "text/html; charset=utf-8")];
    Router::new()
        .route("/", get(move || async move { (html, PAGE) }))
        .route("/frame.png", get(png))
        .route("/figures.json", get(figures))
        .route("/stream", get(motion))
        .with_state(seen)
        .layer(middleware::from_fn_with_state(guard, admit))
}

/// A name that an attacker points at this computer is refused.
async fn admit(State(guard): State<Guard>, request: Request, next: Next) -> Response {
    match guard.decide(request.method(), request.uri(), request.headers()) {
        Decision::Serve => next.run(request).await,
        Decision::Refuse(status, reason) => {
            (StatusCode::from_u16(status).unwrap_or(StatusCode::FORBIDDEN), reason).into_response()
        }
        Decision::KeepToken(_) => StatusCode::NOT_FOUND.into_response(),
    }
}

/// The last picture of one kind; before the first one there is none.
fn last(kind: &'static str, bytes: Bytes) -> Response {
    if bytes.is_empty() {
        return (StatusCode::SERVICE_UNAVAILABLE, "no picture yet").into_response();
    }
    ([(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "no-store")], bytes).into_response()
}

async fn png(State(seen): State<watch::Receiver<Shown>>) -> Response {
    let picture = seen.borrow().picture.clone();
    // Takes a tenth of a second, which other viewers need not wait for.
    let encoded =
        tokio::task::spawn_blocking(move || picture.and_then(|picture| picture.to_png().ok())).await;
    last("image/png", encoded.ok().flatten().unwrap_or_default().into())
}

async fn figures(State(seen): State<watch::Receiver<Shown>>) -> Response {
    let bytes = seen.borrow().figures.clone();
    last("application/json", bytes)
}

/// Motion JPEG: one part for each picture; a slow viewer misses some.
async fn motion(State(seen): State<watch::Receiver<Shown>>) -> Response {
    let parts = stream::unfold((seen, true), |(mut seen, first)| async move {
        if !first || seen.borrow().jpeg.is_empty() {
            seen.changed().await.ok()?;
        }
        let jpeg = seen.borrow_and_update().jpeg.clone();
        let head = format!("--picture\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n", jpeg.len());
        let part = [head.as_bytes(), &jpeg, b"\r\n"].concat();
        Some((Ok::<_, std::convert::Infallible>(Bytes::from(part)), (seen, false)))
    });
    ([(header::CONTENT_TYPE, "multipart/x-mixed-replace; boundary=picture")], Body::from_stream(parts))
        .into_response()
}
