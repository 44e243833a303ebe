//! vlscan as a service: an interface for programs by OGC API - Processes, and pages for a browser.
//!
//! The service computes nothing itself. It receives files and requests, keeps them in a folder, and has each
//! job computed by a process of `vlscan` that can reach no files but its own. docs/service.md describes use,
//! limits and threats.
//!
//! | file | what it does |
//! |---|---|
//! | `config` | the command line, and the limits it sets |
//! | `tokens` | who may use the service |
//! | `names` | names of files that others choose |
//! | `program` | the program vlscan: its options as JSON Schema, its catalogue, how it is started |
//! | `processes` | the processes, as they are described to programs |
//! | `request` | from inputs to a command, the files it reads and the hash of all that determines its result |
//! | `records`, `error`, `schema`, `store`, `queue` | uploads, jobs and leases, in SQLite |
//! | `place` | the place of a job in the queue, and when it is expected to be finished |
//! | `opening`, `inspect` | whether folder, database and bucket belong together, and what the database does not list |
//! | `uploads`, `archives`, `reservations`, `missing` | files that are received, archives that are expanded, disk space until they are listed, and files that are named and not there |
//! | `submit` | from a request to a job in the queue |
//! | `files`, `bucket`, `no_bucket` | where files of uploads and results are kept; `no_bucket` takes the place of `bucket` without the feature `s3` |
//! | `worker` | threads that have jobs computed |
//! | `job_folder`, `steps`, `execution` | the folder of a job, what is executed in it, and how |
//! | `messages`, `terms` | progress, warnings and errors of what is executed, in the terms of requests |
//! | `engine`, `template`, `tasks` | jobs that an existing engine computes, and what its tasks do |
//! | `view`, `scene_map` | pictures of results and of scenes, drawn when pages ask for them |
//! | `confine`, `own_root`, `calls` | restrictions of the processes that compute |
//! | `beneath` | files below folders that these processes can write |
//! | `answers` | failures, documents, links |
//! | `query` | parameters of addresses |
//! | `app`, `shares`, `sessions` | what all requests share, and the part of each owner; who asks |
//! | `security` | which requests are admitted, headers of answers |
//! | `api` | the interface for programs |
//! | `pages` | the pages |
//! | `server` | start and end |
//! | `main` | the program |

#![deny(unsafe_code)]

pub mod answers;
pub mod api;
pub mod app;
pub mod archives;
pub mod beneath;
#[cfg_attr(not(feature = "s3"), path = "no_bucket.rs")]
pub mod bucket;
#[cfg(target_os = "linux")]
pub mod calls;
pub mod config;
pub mod confine;
pub mod engine;
pub mod error;
pub mod execution;
pub mod files;
pub mod inspect;
mod job_folder;
pub mod messages;
pub mod missing;
pub mod names;
pub mod opening;
#[cfg(target_os = "linux")]
mod own_root;
pub mod pages;
pub mod place;
pub mod processes;
pub mod program;
pub mod query;
pub mod queue;
pub mod records;
pub mod request;
mod reservations;
pub mod scene_map;
mod schema;
pub mod security;
pub mod server;
pub mod sessions;
pub mod shares;
pub mod steps;
pub mod store;
pub mod submit;
pub mod tasks;
pub mod template;
pub mod terms;
pub mod tokens;
pub mod uploads;
pub mod view;
pub mod worker;
