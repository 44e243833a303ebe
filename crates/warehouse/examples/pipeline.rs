//! Lines of text are numbered and checked by several threads, and come out in their order, in bounded memory.
//!
//!     seq 1 1000000 | cargo run --release -p vlscan-warehouse --example pipeline

use std::io::{BufRead, BufWriter, Write, stdin, stdout};
use std::sync::Arc;
use vlscan_base::{Error, Result};
use vlscan_warehouse::{Collect, JobQueue, Outcome, Policy, Schedule, Stop, Tasks, run};

/// Lines that one thread works on.
struct Lines(Vec<String>);

impl Tasks for Lines {
    fn tasks(&self) -> u32 {
        self.0.len() as u32
    }
}

/// Text that is printed.
struct Text(String);

impl Outcome for Text {}

struct Printer(BufWriter<std::io::Stdout>);

impl Collect<Text> for Printer {
    type Summary = ();
    type Error = Error;

    fn take(&mut self, Text(text): Text, _more_waiting: bool) -> Result<()> {
        self.0.write_all(text.as_bytes()).map_err(failed)
    }

    fn finish(mut self) -> Result<()> {
        self.0.flush().map_err(failed)
    }

    fn abort(self) {}
}

fn failed(error: std::io::Error) -> Error {
    Error::io("write", std::path::Path::new("standard output"), error)
}

/// The number of divisors of a number; a line that is none has none.
fn divisors(line: &str) -> usize {
    let number: u64 = line.parse().unwrap_or(0);
    (1..).take_while(|i| i * i <= number).filter(|i| number.is_multiple_of(*i)).count()
}

fn main() -> Result<()> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let policy = Policy::Warehouse { size: 1000, factor: 4 };
    run(
        Schedule { threads, policy, leg_barrier: false },
        &Arc::new(JobQueue::new(threads)),
        &Stop::new(),
        None,
        || |Lines(lines)| Ok(Text(lines.iter().map(|line| format!("{line} {}\n", divisors(line))).collect())),
        |feed| {
            let mut lines = Vec::new();
            for line in stdin().lock().lines() {
                lines.push(line.map_err(failed)?);
                if lines.len() >= feed.size() as usize {
                    feed.put(Lines(std::mem::take(&mut lines)))?;
                }
            }
            feed.put(Lines(lines))
        },
        Printer(BufWriter::new(stdout())),
    )
}
