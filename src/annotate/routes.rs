//! Requests of the page, by address. All are below `/TOKEN/`.
//!
//! | address | gives |
//! | --- | --- |
//! | `GET /`, `/FILE` | the page and its scripts |
//! | `GET /api/setup` | wireframe, names, suggested nodes |
//! | `GET /api/sequences` | the list |
//! | `GET /api/sequences/ID` | one sequence or track |
//! | `GET /api/sequences/ID/frames/N` | a frame |
//! | `GET /api/sequences/ID/proposals` | proposed marks |
//! | `PUT /api/sequences/ID/marks` | saves marks |
//! | `PUT /api/sequences/ID/range` | saves neutral and apex frame |
//! | `POST /api/fit` | fits marks |
//! | `POST /api/sequences/ID/preview` | corrects a frame of a track without saving |
//! | `PUT /api/sequences/ID/corrections` | corrects a frame of a track |
//! | `POST /api/sequences/ID/retrack` | tracks again |
//! | `PUT /api/sequences/ID/look` | saves what a person found when looking at a track |
//!
//! A sequence is looked up in the list by its id, a frame by its number: no part of an address ever becomes a path.

use axum::{
    Json, Router,
    extract::{DefaultBodyLimit, Path, State, rejection::JsonRejection},
    http::{
        StatusCode,
        header::{CACHE_CONTROL, CONTENT_TYPE},
    },
    middleware,
    response::{IntoResponse, Response},
    routing::{MethodFilter, MethodRouter, get, on, post},
};
use serde::{Serialize, de::DeserializeOwned};

use super::{
    App, RequestError, Shared, Work,
    desk::Desk,
    frames::Picture,
    messages::{SaveFrames, SaveMarks, ToFit},
    page,
    retrack::{Correct, Retrack, SetLook, TrackDesk},
    security,
    serve::{BODY_LIMIT, Limits, whole_body},
};

/// The addresses of the page.
pub fn router(app: Shared, limits: Limits) -> Router {
    Router::new()
        .route("/{token}/", get(index))
        .route("/{token}/{file}", get(file))
        .route("/{token}/api/setup", get(setup))
        .route("/{token}/api/sequences", get(list))
        .route("/{token}/api/sequences/{id}", get(opened))
        .route("/{token}/api/sequences/{id}/frames/{number}", get(picture))
        .route("/{token}/api/sequences/{id}/proposals", get(proposals))
        .route(
            "/{token}/api/sequences/{id}/marks",
            change(MethodFilter::PUT, |app, id, r: &SaveMarks| desk(app)?.save_marks(id, r)),
        )
        .route(
            "/{token}/api/sequences/{id}/range",
            change(MethodFilter::PUT, |app, id, r: &SaveFrames| desk(app)?.save_frames(id, r)),
        )
        .route("/{token}/api/fit", post(fit))
        .route(
            "/{token}/api/sequences/{id}/preview",
            change(MethodFilter::POST, |app, id, r: &Correct| tracks(app)?.preview(id, r)),
        )
        .route(
            "/{token}/api/sequences/{id}/corrections",
            change(MethodFilter::PUT, |app, id, r: &Correct| tracks(app)?.correct(id, r)),
        )
        .route(
            "/{token}/api/sequences/{id}/retrack",
            change(MethodFilter::POST, |app, id, r: &Retrack| tracks(app)?.retrack(id, r)),
        )
        .route("/{token}/api/sequences/{id}/look", change(MethodFilter::PUT, |app, id, r: &SetLook| tracks(app)?.look(id, r)))
        .fallback(|| async { RequestError::NotFound("no such page".to_owned()) })
        .layer(DefaultBodyLimit::max(BODY_LIMIT))
        .layer(middleware::from_fn_with_state(limits, whole_body))
        .layer(middleware::from_fn_with_state(app.clone(), security::check))
        .with_state(app)
}

/// Token (checked before) and id of a sequence.
type Id = Path<(String, String)>;

async fn index() -> Response {
    asset("")
}

async fn file(Path((_, name)): Id) -> Response {
    asset(&name)
}

fn asset(name: &str) -> Response {
    match page::file(name) {
        Some((kind, content)) => ([(CONTENT_TYPE, kind), (CACHE_CONTROL, "no-store")], content).into_response(),
        None => RequestError::NotFound("no such file".to_owned()).into_response(),
    }
}

/// Runs blocking work on a separate thread and answers with JSON.
async fn answer<T: Serialize + Send + 'static>(
    app: Shared,
    work: impl FnOnce(&App) -> Result<T, RequestError> + Send + 'static,
) -> Response {
    match tokio::task::spawn_blocking(move || work(&app)).await {
        Ok(Ok(value)) => ([(CACHE_CONTROL, "no-store")], Json(value)).into_response(),
        Ok(Err(error)) => error.into_response(),
        Err(_) => (StatusCode::INTERNAL_SERVER_ERROR, "the request could not be worked on").into_response(),
    }
}

fn desk(app: &App) -> Result<&Desk, RequestError> {
    match &app.work {
        Work::Marks(desk) => Ok(desk),
        Work::Tracks(_) => {
            Err(RequestError::NotFound("this page corrects tracks; marks are made with `grimace annotate DATASET`".into()))
        }
    }
}

fn tracks(app: &App) -> Result<&TrackDesk, RequestError> {
    match &app.work {
        Work::Tracks(tracks) => Ok(tracks),
        Work::Marks(_) => {
            Err(RequestError::NotFound("this page makes marks; tracks are corrected with `grimace annotate --tracks OUT`".into()))
        }
    }
}

fn json<T: Serialize>(value: &T) -> Result<serde_json::Value, RequestError> {
    serde_json::to_value(value).map_err(RequestError::failed)
}

/// A request's body, or the reason why it cannot be read.
type Body<T> = Result<Json<T>, JsonRejection>;

/// Answers a request with a body.
async fn answer_body<B, T>(
    app: Shared,
    request: Body<B>,
    work: impl FnOnce(&App, &B) -> Result<T, RequestError> + Send + 'static,
) -> Response
where
    B: DeserializeOwned + Send + 'static,
    T: Serialize + Send + 'static,
{
    match request {
        Ok(Json(value)) => answer(app, move |app| work(app, &value)).await,
        Err(rejection) => (rejection.status(), Json(serde_json::json!({ "error": rejection.body_text() }))).into_response(),
    }
}

async fn setup(State(app): State<Shared>) -> Response {
    answer(app, |app| {
        Ok(match &app.work {
            Work::Marks(desk) => page::setup(&desk.bench, "marks", &desk.title(), &desk.key()),
            Work::Tracks(tracks) => page::setup(&tracks.bench, "tracks", &tracks.title(), ""),
        })
    })
    .await
}

async fn list(State(app): State<Shared>) -> Response {
    answer(app, |app| match &app.work {
        Work::Marks(desk) => json(&desk.list()),
        Work::Tracks(tracks) => json(&tracks.list()),
    })
    .await
}

async fn opened(State(app): State<Shared>, Path((_, id)): Id) -> Response {
    answer(app, move |app| match &app.work {
        Work::Marks(desk) => json(&desk.opened(&id)?),
        Work::Tracks(tracks) => json(&tracks.opened(&id)?),
    })
    .await
}

async fn picture(State(app): State<Shared>, Path((_, id, number)): Path<(String, String, u32)>) -> Response {
    let work = move || match &app.work {
        Work::Marks(desk) => desk.picture(&id, number),
        Work::Tracks(tracks) => tracks.picture(&id, number),
    };
    match tokio::task::spawn_blocking(work).await {
        Ok(Ok(Picture { mime, bytes })) => {
            ([(CONTENT_TYPE, mime), (CACHE_CONTROL, "private, max-age=600")], bytes).into_response()
        }
        Ok(Err(error)) => error.into_response(),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

async fn proposals(State(app): State<Shared>, Path((_, id)): Id) -> Response {
    answer(app, move |app| desk(app)?.proposed(&id)).await
}

async fn fit(State(app): State<Shared>, request: Body<ToFit>) -> Response {
    answer_body(app, request, |app, request| Ok(desk(app)?.fit(request))).await
}

/// Answers requests with a body that act on one sequence or track.
fn change<B, T>(method: MethodFilter, work: fn(&App, &str, &B) -> Result<T, RequestError>) -> MethodRouter<Shared>
where
    B: DeserializeOwned + Send + 'static,
    T: Serialize + Send + 'static,
{
    on(method, move |State(app): State<Shared>, Path((_, id)): Id, request: Body<B>| {
        answer_body(app, request, move |app, request| work(app, &id, request))
    })
}
