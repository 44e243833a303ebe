//! Start and end of the service.

use crate::api;
use crate::app::App;
use crate::bucket::Bucket;
use crate::config::ServeArgs;
use crate::engine::Engine;
use crate::files::Files;
use crate::pages;
use crate::program::{Program, ProgramError, sandbox};
use crate::security;
use crate::sessions::Sessions;
use crate::store::{Store, StoreError, make_private};
use crate::tokens::{TokenError, Tokens, random_name};
use crate::worker::Workshop;
use axum::Router;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::Semaphore;

/// Most streams of progress at the same time.
const MAX_STREAMS: usize = 256;
/// Most uploads that are received at the same time.
const MAX_UPLOADS: usize = 8;

/// Why the service does not start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Tokens.
    #[error(transparent)]
    Tokens(#[from] TokenError),
    /// vlscan.
    #[error(transparent)]
    Program(#[from] ProgramError),
    /// The folder of the service.
    #[error("{0}; choose another folder with --data")]
    Store(#[from] StoreError),
    /// An address that others reach.
    #[error(
        "--listen {0} can be reached from other machines and needs tokens: make one with `vlscan serve token OWNER >> FILE` and give \
         --token-file FILE"
    )]
    Open(std::net::SocketAddr),
    /// The commands of an engine.
    #[error("{0}")]
    Engine(String),
    /// No sandbox.
    #[error("{0}")]
    Sandbox(String),
    /// The system.
    #[error("{0}")]
    System(#[from] std::io::Error),
}

/// Serves until it is told to end.
///
/// # Errors
/// [`ServeError`].
pub fn serve(args: &ServeArgs) -> Result<(), ServeError> {
    let environment = std::env::var("VLSCAN_TOKEN").ok();
    let tokens = Tokens::read(args.token_file.as_deref(), environment.as_deref())?;
    let is_local = args.listen.ip().is_loopback();
    if !is_local && tokens.is_empty() {
        return Err(ServeError::Open(args.listen));
    }
    check_sandbox(args, is_local && tokens.is_empty())?;
    let program = Arc::new(Program::find(args.program.as_deref())?);
    let engine = Engine::of(args).map_err(ServeError::Engine)?;
    if let Some(engine) = &engine {
        engine.check().map_err(|e| ServeError::Engine(format!("--poll: {e}")))?;
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let holds = hold(&args.data)?;
    let store = Arc::new(Store::open(&args.data, kept(args, runtime.handle())?)?);
    let workshop = Arc::new(Workshop::new(store, program, args.clone(), tokens.owners(), engine));
    if let Some(id) = workshop.resume()? {
        return Err(ServeError::Engine(format!(
            "an engine has the job {id}; start the service with the options --submit, --poll and --cancel of then"
        )));
    }
    let workers = workshop.start()?;
    let app = Arc::new(App {
        workshop: Arc::clone(&workshop),
        tokens,
        sessions: Sessions::default(),
        secret: random_name(32),
        hosts: args.host.clone(),
        streams: Arc::new(Semaphore::new(MAX_STREAMS)),
        uploads: Arc::new(Semaphore::new(MAX_UPLOADS)),
        pictures: Arc::new(Semaphore::new(1)),
    });
    let done = runtime.block_on(listen(args, app));
    workshop.end();
    workers.into_iter().for_each(|worker| drop(worker.join()));
    drop(holds);
    Ok(done?)
}

/// Only one service uses a folder.
fn hold(folder: &Path) -> Result<std::fs::File, ServeError> {
    make_private(folder).map_err(StoreError::Files)?;
    let mut file = std::fs::File::options();
    let file = file.create(true).truncate(false).write(true).open(folder.join("lock"));
    let file = file.map_err(StoreError::Files)?;
    if file.try_lock().is_err() {
        let message = format!("another service uses the folder {}", folder.display());
        return Err(ServeError::Store(StoreError::Files(std::io::Error::other(message))));
    }
    Ok(file)
}

/// Where the files of uploads and results are kept.
fn kept(args: &ServeArgs, runtime: &tokio::runtime::Handle) -> Result<Files, ServeError> {
    match &args.store {
        None => Ok(Files::Folder),
        Some(address) => Ok(Files::Bucket(Bucket::new(address, runtime.clone())?)),
    }
}

fn check_sandbox(args: &ServeArgs, is_private: bool) -> Result<(), ServeError> {
    if args.no_sandbox && !is_private {
        return Err(ServeError::Sandbox(
            "--no-sandbox is for the loopback address without tokens".to_owned(),
        ));
    }
    if args.no_sandbox {
        return Ok(());
    }
    let held = sandbox()?;
    if !held.files {
        return Err(ServeError::Sandbox(
            "this system has no Landlock (Linux 5.13), which keeps jobs to their own files; --no-sandbox does without, on the loopback \
             address only and for files that you trust"
                .to_owned(),
        ));
    }
    if !held.network && !held.tcp {
        eprintln!(
            "vlscan serve: this system does not let the service take the network from jobs; docs/service.md tells what else does"
        );
    }
    Ok(())
}

async fn listen(args: &ServeArgs, app: Arc<App>) -> std::io::Result<()> {
    let listener = tokio::net::TcpListener::bind(args.listen).await?;
    let address = listener.local_addr()?;
    eprintln!("vlscan serve: http://{address}/ (Ctrl-C ends it)");
    axum::serve(listener, router(app)).with_graceful_shutdown(told_to_end()).await
}

/// All addresses of the service.
pub fn router(app: Arc<App>) -> Router {
    let guard = axum::middleware::from_fn_with_state(Arc::clone(&app), security::guard);
    api::router(&app.workshop.limits)
        .merge(pages::router())
        .fallback(api::absent)
        .layer(guard)
        .with_state(app)
}

#[cfg(unix)]
async fn told_to_end() {
    use tokio::signal::unix::{SignalKind, signal};
    let (Ok(mut interrupt), Ok(mut terminate)) =
        (signal(SignalKind::interrupt()), signal(SignalKind::terminate()))
    else {
        return std::future::pending().await;
    };
    tokio::select! {
        _ = interrupt.recv() => {}
        _ = terminate.recv() => {}
    }
    // Streams of progress would keep the service.
    tokio::spawn(async {
        tokio::time::sleep(std::time::Duration::from_secs(5)).await;
        std::process::exit(0);
    });
}

#[cfg(not(unix))]
async fn told_to_end() {
    let _ = tokio::signal::ctrl_c().await;
}
