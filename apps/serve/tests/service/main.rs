//! The service as a program: started on a free port of the loopback address, asked over HTTP.
//!
//! | file | what it tests |
//! |---|---|
//! | `client` | starting the service; a small HTTP client |
//! | `command` | the commands, and the restrictions of processes |
//! | `http` | versions of files, tokens, cookies and names of hosts |
//! | `interface` | the interface for programs |
//! | `ogc` | the requirements of OGC API - Processes |
//! | `jobs` | queue, results, interruptions |
//! | `messages` | warnings and errors of jobs |
//! | `engine` | jobs that an engine computes |
//! | `opening` | folders and databases at the start |
//! | `limits` | what an owner takes, of the disk and of others' turns; names of results and areas |
//! | `takeover` | a program in place of vlscan that tries to leave its sandbox |
//! | `hostile` | what others may send: files, names, requests |
//! | `browser` | pages, as a browser without scripts uses them |
//! | `pages` | examples, uploads, forms that are shown again, lists of jobs |

mod browser;
mod client;
mod command;
mod engine;
mod hostile;
mod http;
mod interface;
mod jobs;
mod limits;
mod messages;
mod ogc;
mod opening;
mod pages;
mod takeover;
