//! Progress on stderr: a bar on a terminal, plain lines elsewhere on request, lines of JSON for programs.

use super::{Console, Verbosity, messages};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, stderr};
use std::time::{Duration, Instant};
use vlscan_base::quantity::{amount, duration};
use vlscan_session::{Progress, Snapshot};

const BAR_PERIOD: Duration = Duration::from_millis(100);
const LINE_PERIOD: Duration = Duration::from_secs(2);
/// Time without a pulse after which the bar disappears until the next one.
const IDLE_PERIOD: Duration = Duration::from_secs(1);
const BAR: &str = "{spinner} [{bar:6}] {msg}";
/// Time after which a terminal shows the current stage.
const PATIENCE: Duration = Duration::from_secs(1);
const STEP: &str = "{spinner} {msg} ({elapsed})";

/// Does work without a known length, of which `step` is the first step, and shows on a terminal which step
/// goes on and for how long.
pub fn during<T>(console: &Console, step: &'static str, work: impl FnOnce() -> T) -> T {
    let draws = stderr().is_terminal() && console.draws();
    if draws || console.is_json() {
        console.begin(step);
    }
    if !draws {
        return work();
    }
    let (done, is_done) = flume::bounded::<()>(1);
    std::thread::scope(|scope| {
        let shows = std::thread::Builder::new().spawn_scoped(scope, move || {
            if !is_running(&is_done, PATIENCE) {
                return;
            }
            let display =
                ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr()).with_elapsed(PATIENCE);
            if let Ok(style) = ProgressStyle::with_template(STEP) {
                display.set_style(style);
            }
            console.display(Some(display.clone()));
            while is_running(&is_done, BAR_PERIOD) {
                display.set_message(console.step());
                display.tick();
            }
            console.display(None);
            display.finish_and_clear();
        });
        let result = work();
        drop(done);
        // What is printed next finds an empty line.
        let _ = shows.map(std::thread::ScopedJoinHandle::join);
        result
    })
}

/// Runs `work` while another thread shows its progress. `legs` is the number of legs in the survey;
/// `is_complete` is true of the outcome of work that was done to its end.
pub fn watched<T>(
    console: &Console,
    shows_lines: bool,
    legs: usize,
    progress: &Progress,
    work: impl FnOnce() -> T,
    is_complete: impl FnOnce(&T) -> bool,
) -> T {
    let terminal = stderr().is_terminal() && console.draws();
    if !console.shows(Verbosity::Normal) || !(terminal || shows_lines || console.is_json()) {
        return work();
    }
    let start = Instant::now();
    let result = while_shown(console, terminal, legs, progress, work);
    if console.is_json() {
        let last = messages::progress(&progress.snapshot(), legs, start.elapsed().as_secs_f64());
        console.progress(if is_complete(&result) { messages::completed(last) } else { last });
    }
    result
}

/// Runs `work` while another thread shows its progress, as a bar if `draws` is set.
fn while_shown<T>(
    console: &Console,
    draws: bool,
    legs: usize,
    progress: &Progress,
    work: impl FnOnce() -> T,
) -> T {
    let (done, is_done) = flume::bounded::<()>(1);
    std::thread::scope(|scope| {
        // A run continues if its progress cannot be shown for want of a thread.
        let _ = std::thread::Builder::new().spawn_scoped(scope, move || {
            let start = Instant::now();
            if draws {
                draw_bar(console, progress, legs, start, &is_done);
                return;
            }
            let mut shown = 0;
            while is_running(&is_done, LINE_PERIOD) {
                let now = progress.snapshot();
                // A stream that is silent needs no lines.
                if now.pulses != shown || now.done.is_finite() {
                    let seconds = start.elapsed().as_secs_f64();
                    match console.is_json() {
                        true => console.progress(messages::progress(&now, legs, seconds)),
                        false => console.say(line(&now, legs, seconds)),
                    }
                }
                shown = now.pulses;
            }
        });
        let result = work();
        drop(done);
        result
    })
}

fn is_running(is_done: &flume::Receiver<()>, period: Duration) -> bool {
    matches!(is_done.recv_timeout(period), Err(flume::RecvTimeoutError::Timeout))
}

/// Draws a bar until the work is done, but none while nothing happens: before the first pulse, and while a
/// stream is silent.
fn draw_bar(
    console: &Console,
    progress: &Progress,
    legs: usize,
    start: Instant,
    is_done: &flume::Receiver<()>,
) {
    let mut bar: Option<ProgressBar> = None;
    let (mut shown, mut changed) = (0, Instant::now());
    while is_running(is_done, BAR_PERIOD) {
        let now = progress.snapshot();
        if now.pulses != shown {
            (shown, changed) = (now.pulses, Instant::now());
        }
        if shown == 0 || changed.elapsed() > IDLE_PERIOD {
            console.display(None);
            bar.take().inspect(ProgressBar::finish_and_clear);
            continue;
        }
        let bar = bar.get_or_insert_with(|| {
            let bar = new_bar();
            console.display(Some(bar.clone()));
            bar
        });
        bar.set_position(if now.done.is_finite() { (now.done * 1000.0) as u64 } else { 0 });
        bar.set_message(bar_text(&now, legs, start.elapsed().as_secs_f64()));
    }
    console.display(None);
    bar.inspect(ProgressBar::finish_and_clear);
}

fn new_bar() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(1000), ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template(BAR) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

/// Progress next to the bar, short enough for a line of 80 characters.
fn bar_text(now: &Snapshot, legs: usize, seconds: f64) -> String {
    let leg = if legs > 1 { format!("leg {}/{legs}  ", now.leg + 1) } else { String::new() };
    let rate = amount(now.pulses as f64 / seconds.max(1e-3));
    let text = format!("{leg}{} pulses ({rate}/s)", amount(now.pulses as f64));
    match time_left(now, seconds) {
        Some(left) => format!("{:5.1} %  {text}  {left} left", 100.0 * now.done),
        None => text,
    }
}

fn time_left(now: &Snapshot, seconds: f64) -> Option<String> {
    let is_known = now.done.is_finite() && now.done > 0.0;
    is_known.then(|| duration(seconds * (1.0 - now.done).max(0.0) / now.done))
}

fn line(now: &Snapshot, legs: usize, seconds: f64) -> String {
    let rate = now.pulses as f64 / seconds.max(1e-3);
    let text = format!(
        "leg {}/{legs}  {} pulses ({}/s)  {} echoes",
        now.leg + 1,
        amount(now.pulses as f64),
        amount(rate),
        amount(now.echoes as f64)
    ) + &tiles(now);
    match time_left(now, seconds) {
        Some(left) => format!("{:5.1} %  {text}  {left} left", 100.0 * now.done),
        None => text,
    }
}

/// Loaded part of a scene of tiles.
fn tiles(now: &Snapshot) -> String {
    let Some(tiles) = &now.tiles else { return String::new() };
    format!(
        "  {} tiles loaded, {} in memory, {:.2} % hits",
        tiles.loaded,
        tiles.resident.0,
        100.0 * tiles.hit_rate()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_fits_into_a_line_of_80_characters() {
        // Spinner, blanks and brackets take five, the bar six.
        for legs in [1, 9999] {
            let now = Snapshot { pulses: 123_456_789_012, echoes: 0, leg: 8887, done: 0.001, tiles: None };
            let text = bar_text(&now, legs, 999.0);
            assert!(5 + 6 + text.chars().count() < 80, "{text}");
        }
    }

    #[test]
    fn a_stream_has_no_percentage() {
        let now = Snapshot { pulses: 2000, echoes: 10, leg: 0, done: f64::NAN, tiles: None };
        assert_eq!(line(&now, 1, 2.0), "leg 1/1  2.00 k pulses (1.00 k/s)  10 echoes");
    }
}
