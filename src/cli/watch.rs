//! Progress on stderr: a bar on a terminal, plain lines elsewhere on request.

use super::{Console, Verbosity};
use crate::pipeline::{Progress, Snapshot};
use crate::quantity::{amount, duration};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, stderr};
use std::time::{Duration, Instant};

const BAR_PERIOD: Duration = Duration::from_millis(100);
const LINE_PERIOD: Duration = Duration::from_secs(2);

/// Runs `work` while another thread shows its progress. `legs` is the number of legs in the survey.
pub fn watched<T>(
    console: &Console,
    lines_wanted: bool,
    legs: usize,
    progress: &Progress,
    work: impl FnOnce() -> T,
) -> T {
    let terminal = stderr().is_terminal() && console.draws();
    if !console.shows(Verbosity::Normal) || !(terminal || lines_wanted) {
        return work();
    }
    let (done, is_done) = flume::bounded::<()>(1);
    std::thread::scope(|scope| {
        // A run whose progress cannot be shown for want of a thread goes on.
        let _ = std::thread::Builder::new().spawn_scoped(scope, move || {
            let start = Instant::now();
            let bar = if terminal { Some(bar()) } else { None };
            let period = if terminal { BAR_PERIOD } else { LINE_PERIOD };
            while let Err(flume::RecvTimeoutError::Timeout) = is_done.recv_timeout(period) {
                let text = line(&progress.snapshot(), legs, start.elapsed().as_secs_f64());
                match &bar {
                    Some(bar) => {
                        let part = progress.snapshot().done;
                        bar.set_position(if part.is_finite() { (part * 1000.0) as u64 } else { 0 });
                        bar.set_message(text);
                    }
                    None => console.say(text),
                }
            }
            if let Some(bar) = bar {
                bar.finish_and_clear();
            }
        });
        let result = work();
        drop(done);
        result
    })
}

fn bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(1000), ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template("{spinner} [{bar:24}] {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

fn line(now: &Snapshot, legs: usize, seconds: f64) -> String {
    let rate = now.pulses as f64 / seconds.max(1e-3);
    let mut text = format!(
        "leg {}/{legs}  {} pulses ({}/s)  {} echoes",
        now.leg + 1,
        amount(now.pulses as f64),
        amount(rate),
        amount(now.echoes as f64)
    );
    if now.done.is_finite() && now.done > 0.0 {
        let left = seconds * (1.0 - now.done).max(0.0) / now.done;
        text = format!("{:5.1} %  {text}  {} left", 100.0 * now.done, duration(left));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_has_no_percentage() {
        let now = Snapshot { pulses: 2000, echoes: 10, leg: 0, done: f64::NAN };
        assert_eq!(line(&now, 1, 2.0), "leg 1/1  2.00 k pulses (1.00 k/s)  10 echoes");
    }
}
