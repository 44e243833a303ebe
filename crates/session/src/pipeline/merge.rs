//! Merging of shards: the stages of a run whose producer reads the blocks of shards, and whose workers encode
//! their batches for the outputs. Neither survey nor scene are needed.

use super::beam_counts::BeamCounts;
use super::collector::{Ended, PassEnd};
use super::crs;
use super::fly::run_stages;
use super::pass::RunContext;
use super::run::Report;
use super::worker::{Measured, Pieces};
use crate::output::{OutputContext, OutputPlan, OutputRequest, OutputSummary};
use crate::shards::{BlockHead, ShardFile, ShardFileError, ShardSet};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_lidar::pulse::Batch;
use vlscan_warehouse::{Feed, Outcome, RunError, Schedule, Tasks};

/// A block of an open shard.
struct Block {
    number: usize,
    pulses: u32,
    leg: u32,
    /// The selected echoes, all or those from and to the end of the selection.
    echoes: Range<u32>,
    /// Fraction of the blocks of all shards that are done after this one, 0–1.
    done: f64,
}

/// Consecutive blocks of an open shard.
struct BlockTask {
    shard: Arc<ShardFile>,
    blocks: Vec<Block>,
}

/// Minimum size of a task, unless its shard ends: handing over a task takes as long as reading some ten
/// thousand bytes.
const TASK_BYTES: u64 = 256 << 10;

impl Tasks for BlockTask {
    fn tasks(&self) -> u32 {
        self.blocks.iter().fold(0, |sum, block| sum.saturating_add(block.pulses))
    }
}

/// Position in the blocks of all shards.
struct Blocks<'a> {
    shards: &'a ShardSet,
    /// The shard that is being read, and its next block.
    current: Option<(Arc<ShardFile>, usize)>,
    next_shard: u32,
    /// The selected echoes.
    selected: Range<u64>,
    /// Echoes and pulses before the next block.
    echoes: u64,
    pulses: u64,
}

impl Blocks<'_> {
    /// The next blocks with selected echoes if they are of `epoch`.
    fn take(&mut self, epoch: u32) -> Result<Option<BlockTask>> {
        loop {
            let Some(shard) = self.shard()? else { return Ok(None) };
            let (mut blocks, mut bytes) = (Vec::new(), 0);
            while bytes < TASK_BYTES
                && let Some((block, length)) = self.take_block(&shard, epoch)
            {
                blocks.push(block);
                bytes += length;
            }
            if !blocks.is_empty() {
                return Ok(Some(BlockTask { shard, blocks }));
            }
            if self.current.as_ref().is_some_and(|(shard, at)| *at < shard.blocks()) {
                return Ok(None);
            }
        }
    }

    /// The shard that is being read, or the next one with blocks when its own are used up.
    fn shard(&mut self) -> Result<Option<Arc<ShardFile>>> {
        loop {
            if let Some((shard, at)) = &self.current
                && *at < shard.blocks()
            {
                return Ok(Some(shard.clone()));
            }
            if self.next_shard >= self.shards.head.of {
                return Ok(None);
            }
            self.current = Some((Arc::new(self.shards.shard(self.next_shard)?), 0));
            self.next_shard += 1;
        }
    }

    /// The next block of the current shard with selected echoes if it is of `epoch`, and its length.
    fn take_block(&mut self, shard: &ShardFile, epoch: u32) -> Option<(Block, u64)> {
        let (_, at) = self.current.as_mut()?;
        loop {
            let head = shard.block(*at)?;
            if head.epoch != epoch || self.echoes >= self.selected.end {
                return None;
            }
            let within = |at: u64| at.saturating_sub(self.echoes).min(u64::from(head.echoes)) as u32;
            let echoes = within(self.selected.start)..within(self.selected.end);
            let number = *at;
            *at += 1;
            self.echoes += u64::from(head.echoes);
            self.pulses += u64::from(head.pulses);
            // Blocks without echoes hold poses and pulses.
            if self.echoes > self.selected.start || self.selected.start == 0 {
                let done = self.done();
                let BlockHead { pulses, leg, length, .. } = head;
                return Some((Block { number, pulses, leg, echoes, done }, length));
            }
        }
    }

    fn done(&self) -> f64 {
        if self.selected == ALL_ECHOES {
            return self.pulses as f64 / (self.shards.head.total as f64).max(1.0);
        }
        let selected = (self.selected.end - self.selected.start) as f64;
        (self.echoes.saturating_sub(self.selected.start) as f64 / selected.max(1.0)).min(1.0)
    }

    fn produce<R: Outcome, W: FnMut(BlockTask) -> Result<R>>(
        &mut self,
        epoch: u32,
        feed: &mut Feed<'_, BlockTask, R, W>,
    ) -> Result<()> {
        while !feed.state().is_stopped() {
            match self.take(epoch)? {
                // A block is as large as a chunk of the run that wrote it, so it is complete for every
                // schedule.
                Some(block) => feed.put(block)?,
                None => break,
            }
        }
        Ok(())
    }
}

/// The facts about survey and scene that outputs depend on.
///
/// # Errors
/// [`Error::Input`] when they cannot be read.
pub fn output_context(shards: &ShardSet) -> Result<OutputContext> {
    let context = postcard::from_bytes(&shards.head.context);
    context.map_err(|e| Error::input(format!("the shards lack data that the outputs need: {e}")))
}

/// Warnings about values of points that the outputs of shards do not hold, and about an unlikely or missing
/// coordinate reference system.
///
/// # Errors
/// The errors of [`OutputRequest::check`], but for existing files: those are checked where files are written.
pub fn merge_warnings(shards: &ShardSet, outputs: &OutputRequest) -> Result<Diagnostics> {
    let context = output_context(shards)?;
    let epochs = shards.head.epochs.max(1);
    let request = OutputRequest { epochs, force: true, ..outputs.clone() };
    let mut found = request.check(&context)?.warnings().clone();
    crs::check_merged(outputs, &context, &mut found);
    Ok(found)
}

/// Writes the outputs of the run that the shards belong to.
///
/// # Errors
/// [`Error::Input`] for outputs that need data missing from the shards, and for damaged shards, all of which
/// are named; [`Error::Io`], [`Error::ClosedPipe`].
pub fn merge(
    shards: &ShardSet,
    outputs: OutputRequest,
    schedule: Schedule,
    control: RunContext<'_>,
) -> Result<Report> {
    merge_echoes(shards, outputs, ALL_ECHOES, schedule, control)
}

/// All echoes, and everything else that shards hold.
const ALL_ECHOES: Range<u64> = 0..u64::MAX;

/// [`merge`] of only the echoes in a range, counted from 0 over all shards.
pub(super) fn merge_echoes(
    shards: &ShardSet,
    outputs: OutputRequest,
    selected: Range<u64>,
    schedule: Schedule,
    control: RunContext<'_>,
) -> Result<Report> {
    schedule.check().map_err(RunError::from)?;
    let context = output_context(shards)?;
    check_records(shards, &outputs)?;
    let epochs = shards.head.epochs.max(1);
    let mut request = OutputRequest { epochs, ..outputs };
    request.cloud.creation = shards.head.creation;
    let output = Arc::new(OutputPlan::new(request, &context)?);
    let is_damaged = AtomicBool::new(false);
    let started = Instant::now();
    let blocks = Blocks { shards, current: None, next_shard: 0, selected, echoes: 0, pulses: 0 };
    let merged = merge_epochs(blocks, &output, epochs, schedule, control, &is_damaged);
    if merged.is_err() && is_damaged.load(Relaxed) {
        shards.verify(control.stop)?;
    }
    let (summary, interrupted) = merged?;
    let pulses = control.progress.snapshot().pulses;
    let (seconds, warnings) = (started.elapsed().as_secs_f64(), output.warnings().clone());
    Ok(Report { summary, pulses, seconds, interrupted, warnings })
}

fn merge_epochs(
    mut blocks: Blocks<'_>,
    output: &Arc<OutputPlan>,
    epochs: u32,
    schedule: Schedule,
    control: RunContext<'_>,
    is_damaged: &AtomicBool,
) -> Result<(OutputSummary, bool)> {
    let mut writer = None;
    let open_outputs = &control.stop.outputs();
    for epoch in 0..epochs {
        let is_last = epoch + 1 == epochs;
        let end = PassEnd { check: None, is_last, keeps_partial: false, open_outputs };
        let ended = run_stages(
            schedule,
            control,
            output,
            writer.take(),
            end,
            || {
                let (mut batch, mut buffer) = (Batch::default(), Vec::new());
                move |task: BlockTask| encode(output, &task, &mut batch, &mut buffer, is_damaged)
            },
            |feed| blocks.produce(epoch, feed),
        )?;
        match ended {
            Ended::Complete(summary) => return Ok((summary, false)),
            Ended::Interrupted(writer) => {
                writer.discard();
                return Ok((OutputSummary::default(), true));
            }
            Ended::NextEpoch(open) => writer = Some(open),
        }
    }
    Err(Error::input("the shards contain no epoch of the scene; compute them again"))
}

fn encode(
    output: &OutputPlan,
    task: &BlockTask,
    batch: &mut Batch,
    buffer: &mut Vec<u8>,
    is_damaged: &AtomicBool,
) -> Result<Pieces> {
    let damaged = |reason: ShardFileError| {
        is_damaged.store(true, Relaxed);
        Error::input(format!("{} {reason}", task.shard.path().display()))
    };
    let mut pieces = Vec::with_capacity(task.blocks.len());
    for block in &task.blocks {
        task.shard.read(block.number, batch, buffer).map_err(damaged)?;
        batch.echoes.truncate(block.echoes.end as usize);
        batch.echoes.drain(..block.echoes.start as usize);
        pieces.push(Ok(Measured {
            encoded: output.encode(batch, None),
            pulses: u64::from(block.pulses),
            echoes: block.echoes.len() as u64,
            leg: block.leg,
            done: block.done,
            beam_counts: BeamCounts::NONE,
        }));
    }
    Ok(Pieces(pieces))
}

/// Rejects outputs that need records which the shards do not hold.
pub(super) fn check_records(shards: &ShardSet, outputs: &OutputRequest) -> Result<()> {
    let (held, needed) = (shards.head.records, outputs.records());
    let mut problems = Diagnostics::default();
    let needs = [
        (needed.waveforms && !held.waveforms, "waveforms", "--waveforms"),
        (outputs.cloud.misses && !held.pulses, "pulses without echoes", "--misses"),
        (needed.pulses && !outputs.cloud.misses && !held.pulses, "pulses", "--pulses"),
        (
            needed.truth && !held.truth && !needed.colours && !needed.velocities,
            "true causes of echoes",
            "--columns",
        ),
        (needed.velocities && !held.velocities, "radial velocities", "--columns Doppler"),
        (needed.colours && !held.colours, "colours of surfaces", "--columns Red,Green,Blue"),
        (
            needed.scanner_axes && !held.scanner_axes,
            "positions in the axes of the scanner",
            "--columns ScannerX,ScannerY,ScannerZ",
        ),
    ];
    for (_, what, option) in needs.into_iter().filter(|(is_missing, ..)| *is_missing) {
        problems
            .error(None, format!("the shards do not contain {what}"))
            .help(format!("compute the shards with {option}"));
    }
    problems.finish(false).map(drop)
}
