//! Start and end of the service.

use crate::api;
use crate::app::App;
use crate::config::ServeArgs;
use crate::engine::{Engine, EngineError};
use crate::files::Files;
use crate::opening::read_id;
use crate::pages;
use crate::program::{Program, ProgramError, sandbox};
use crate::security;
use crate::sessions::Sessions;
use crate::shares::Shares;
use crate::store::{Store, StoreError, make_private};
use crate::tokens::{TokenError, Tokens, hash, hex, random_name};
use crate::worker::Workshop;
use axum::Router;
use std::env::VarError;
use std::path::Path;
use std::sync::Arc;

/// Most streams of progress at the same time, and of an owner.
const MAX_STREAMS: (usize, usize) = (1024, 128);
/// Most uploads that are received at the same time.
const MAX_UPLOADS: (usize, usize) = (16, 4);
/// Most pictures that are drawn at the same time.
const MAX_PICTURES: (usize, usize) = (4, 1);

/// Most requests that are checked at the same time.
const MAX_REQUESTS: (usize, usize) = (16, 2);

/// Why the service does not start.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Tokens.
    #[error(transparent)]
    Tokens(#[from] TokenError),
    /// vlscan.
    #[error(transparent)]
    Program(#[from] ProgramError),
    /// The folder of the service.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The address.
    #[error("cannot listen on {0}: {1}\nhelp: choose another address or port with --listen")]
    Listen(std::net::SocketAddr, std::io::Error),
    /// An address that others reach.
    #[error(
        "--listen {0} can be reached from other machines and needs tokens: make one with `vlscan serve token OWNER >> FILE` and give \
         --token-file FILE"
    )]
    Open(std::net::SocketAddr),
    /// A name that others reach.
    #[error(
        "--host {0} is for a service that others reach, and there are no tokens: make one with `vlscan serve token OWNER >> FILE` and \
         give --token-file FILE, or give --open to serve everybody"
    )]
    OpenHost(String),
    /// Tokens and --open.
    #[error("--open is for a service without tokens, but VLSCAN_TOKEN is set")]
    OpenWithTokens,
    /// A token that is not text.
    #[error("VLSCAN_TOKEN is not valid UTF-8\nhelp: make a token with `vlscan serve token OWNER`")]
    TokenNotText,
    /// The commands of an engine.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// An engine that cannot be asked for jobs.
    #[error("--poll: {0}")]
    Poll(std::io::Error),
    /// A job that an engine computes, while no engine is given.
    #[error(
        "an engine has the job {0}; start the service with the options --submit, --poll and --cancel of then"
    )]
    WithoutEngine(String),
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
    let environment = match std::env::var("VLSCAN_TOKEN") {
        Ok(token) => Some(token),
        Err(VarError::NotPresent) => None,
        Err(VarError::NotUnicode(_)) => return Err(ServeError::TokenNotText),
    };
    let tokens = Tokens::read(args.token_file.as_deref(), environment.as_deref())?;
    let is_local = args.listen.ip().is_loopback();
    if !is_local && tokens.is_empty() {
        return Err(ServeError::Open(args.listen));
    }
    if args.open && !tokens.is_empty() {
        return Err(ServeError::OpenWithTokens);
    }
    let foreign = args.host.iter().find(|name| !is_loopback_name(name));
    if let Some(name) = foreign.filter(|_| tokens.is_empty() && !args.open) {
        return Err(ServeError::OpenHost(name.clone()));
    }
    let program = Arc::new(Program::find(args.program.as_deref())?);
    check_sandbox(args, &program.path, is_local && tokens.is_empty() && foreign.is_none())?;
    let engine = Engine::of(args)?;
    if let Some(engine) = &engine {
        engine.check().map_err(ServeError::Poll)?;
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    let listener = runtime.block_on(tokio::net::TcpListener::bind(args.listen));
    let listener = listener.map_err(|e| ServeError::Listen(args.listen, e))?;
    let holds = hold(&args.data)?;
    let store = Arc::new(Store::open(&args.data, Files::of(args.store.as_deref(), runtime.handle())?)?);
    let id = read_id(store.root())?.unwrap_or_default();
    let workshop = Arc::new(Workshop::new(store, program, args.clone(), tokens.owners(), engine));
    if let Some(id) = workshop.resume()? {
        return Err(ServeError::WithoutEngine(id));
    }
    let workers = workshop.start()?;
    let app = Arc::new(App {
        workshop: Arc::clone(&workshop),
        tokens,
        sessions: Sessions::of(&id),
        secret: form_secret(&id),
        hosts: args.host.clone(),
        streams: Shares::new(MAX_STREAMS.0, MAX_STREAMS.1),
        uploads: Shares::new(MAX_UPLOADS.0, MAX_UPLOADS.1),
        pictures: Shares::new(MAX_PICTURES.0, MAX_PICTURES.1),
        requests: Shares::new(MAX_REQUESTS.0, MAX_REQUESTS.1),
    });
    let done = runtime.block_on(listen(listener, app));
    workshop.end();
    workers.into_iter().for_each(|worker| drop(worker.join()));
    drop(holds);
    Ok(done?)
}

/// The secret by which forms are recognised. It follows from the id of the service, so forms that are open
/// outlive a restart.
fn form_secret(id: &str) -> String {
    if id.is_empty() { random_name(32) } else { hex(&hash(&format!("forms of {id}"))) }
}

/// True if a name leads to this machine only, whatever a proxy does.
fn is_loopback_name(name: &str) -> bool {
    let name = name.trim_end_matches('.').trim_matches(['[', ']']);
    name.eq_ignore_ascii_case("localhost") || name.parse().is_ok_and(|ip: std::net::IpAddr| ip.is_loopback())
}

/// Only one service uses a folder.
fn hold(folder: &Path) -> Result<std::fs::File, ServeError> {
    make_private(folder).map_err(StoreError::Files)?;
    let mut file = std::fs::File::options();
    let file = file.create(true).truncate(false).write(true).open(folder.join("lock"));
    let file = file.map_err(StoreError::Files)?;
    if file.try_lock().is_err() {
        let message = format!(
            "another service uses the folder {}; choose another folder with --data",
            folder.display()
        );
        return Err(ServeError::Store(StoreError::Files(std::io::Error::other(message))));
    }
    Ok(file)
}

fn check_sandbox(args: &ServeArgs, program: &Path, is_private: bool) -> Result<(), ServeError> {
    if args.no_sandbox && !is_private {
        return Err(ServeError::Sandbox(
            "--no-sandbox is for the loopback address without tokens".to_owned(),
        ));
    }
    if args.no_sandbox {
        return Ok(());
    }
    let held = sandbox(program).map_err(|e| ServeError::Sandbox(e.to_string()))?;
    if !held.files {
        return Err(ServeError::Sandbox(
            "this system has no Landlock (Linux 5.13), which keeps jobs to their own files; --no-sandbox does without, on the loopback \
             address only and for files that you trust"
                .to_owned(),
        ));
    }
    if !held.calls {
        return Err(ServeError::Sandbox(format!(
            "there are no seccomp filters for this system ({}), which keep jobs to one process and from sockets; --no-sandbox does without, \
             on the loopback address only and for files that you trust",
            std::env::consts::ARCH
        )));
    }
    if !held.root {
        eprintln!(
            "vlscan serve: warning: this system does not let the service give jobs a root of their own (user namespaces): jobs cannot open \
             the files of others, but can find out which names exist (docs/service.md, Threats)"
        );
    }
    Ok(())
}

async fn listen(listener: tokio::net::TcpListener, app: Arc<App>) -> std::io::Result<()> {
    let address = listener.local_addr()?;
    // Before the service says that it is there: whoever reads that may end it.
    let ended = told_to_end()?;
    reload_on_hangup(&app)?;
    eprintln!("vlscan serve: http://{address}/ (Ctrl-C ends it)");
    axum::serve(listener, router(app)).with_graceful_shutdown(ended).await
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

/// Reads the file of tokens again whenever the process gets SIGHUP.
#[cfg(unix)]
fn reload_on_hangup(app: &Arc<App>) -> std::io::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    if !app.tokens.has_file() {
        return Ok(());
    }
    let mut hangup = signal(SignalKind::hangup())?;
    let app = Arc::clone(app);
    tokio::spawn(async move {
        while hangup.recv().await.is_some() {
            match app.tokens.reload() {
                Ok(lost) => {
                    app.sessions.end_of(&lost);
                    app.workshop.set_owners(app.tokens.owners());
                    eprintln!("vlscan serve: the token file was read again");
                }
                Err(error) => eprintln!("vlscan serve: the tokens stay the same: {error}"),
            }
        }
    });
    Ok(())
}

#[cfg(not(unix))]
fn reload_on_hangup(_: &Arc<App>) -> std::io::Result<()> {
    Ok(())
}

#[cfg(unix)]
fn told_to_end() -> std::io::Result<impl Future<Output = ()>> {
    use tokio::signal::unix::{SignalKind, signal};
    let (mut interrupt, mut terminate) = (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?);
    Ok(async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        // Streams of progress would keep the service.
        tokio::spawn(async {
            tokio::time::sleep(std::time::Duration::from_secs(5)).await;
            std::process::exit(0);
        });
    })
}

#[cfg(not(unix))]
fn told_to_end() -> std::io::Result<impl Future<Output = ()>> {
    Ok(async {
        let _ = tokio::signal::ctrl_c().await;
    })
}
