//! MCAP files of several scanners as one: `/NAME/points` and `/NAME/odom` for each scanner, `/tf` for all.

use super::container::{ChannelPlan, Container};
use super::records::{Message, Messages};
use super::{CHANNELS, ODOMETRY, POINTS, TRANSFORMS};
use crate::out::{Destination, OutputStream};
use crate::settings::{SOFTWARE, state};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{Patched, reads};

/// Merges the files of scanners, each with its name, by the times of their messages; messages of a file keep
/// their order. `is_partial` marks a file of runs that have not ended. Returns the number of messages and of
/// bytes.
///
/// # Errors
/// [`Error::Io`]; [`Error::Input`] for files that this program has not written.
pub(crate) fn merge(
    parts: &[(String, PathBuf)],
    path: &Path,
    replace: bool,
    is_partial: bool,
) -> Result<(u64, u64)> {
    let mut out = OutputStream::open(&Destination::Path(path.to_path_buf()), replace, Patched::Never)?;
    let names = parts.iter().map(|(name, _)| [format!("/{name}/points"), format!("/{name}/odom")]);
    let topics: Vec<[String; 2]> = names.collect();
    let mut plans = vec![plan(TRANSFORMS, CHANNELS[TRANSFORMS].topic)];
    for [points, odometry] in &topics {
        plans.extend([plan(POINTS, points), plan(ODOMETRY, odometry)]);
    }
    let mut container = Container::begin(SOFTWARE, &plans, &mut out)?;
    let mut files = Vec::new();
    for (_, path) in parts {
        files.push(BufReader::new(reads::open(path).map_err(|e| Error::open(path, e))?));
    }
    let mut sources = Vec::new();
    for (file, (_, path)) in files.iter_mut().zip(parts) {
        let mut messages = Messages::begin(file, path)?;
        let next = messages.read_next()?;
        sources.push((messages, next));
    }
    let mut count = 0;
    while let Some(part) = earliest(sources.iter().map(|(_, next)| next.as_ref())) {
        let (messages, next) = &mut sources[part];
        let following = messages.read_next()?;
        let Some(message) = std::mem::replace(next, following) else { break };
        let channel = match usize::from(message.channel).checked_sub(1) {
            Some(TRANSFORMS) => 0,
            Some(POINTS) => 1 + 2 * part,
            Some(ODOMETRY) => 2 + 2 * part,
            _ => continue,
        };
        container.message(channel, message.time_ns, &[&message.data], &mut out)?;
        count += 1;
    }
    container.finish(&[("state", state(is_partial))], &mut out)?;
    let bytes = out.len();
    out.finish()?;
    Ok((count, bytes))
}

/// A channel of this topic, like the one with the index in the file of a single scanner.
fn plan(index: usize, topic: &str) -> ChannelPlan<'_> {
    let ChannelPlan { message, definition, .. } = CHANNELS[index];
    ChannelPlan { topic, message, definition }
}

/// The index of the file whose next message has the earliest time, the first one of several; `None` after the
/// last messages of all.
fn earliest<'m>(next: impl Iterator<Item = Option<&'m Message>>) -> Option<usize> {
    let times = next.enumerate().filter_map(|(part, message)| Some((message?.time_ns, part)));
    times.min().map(|(_, part)| part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_ordered_by_time_and_keep_their_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let written = |name: &str, messages: &[(usize, u64, &[u8])]| {
            let path = folder.path().join(name);
            let place = Destination::Path(path.clone());
            let mut out = OutputStream::open(&place, false, Patched::Never).unwrap();
            let mut container = Container::begin(SOFTWARE, &CHANNELS, &mut out).unwrap();
            for (channel, time_ns, data) in messages {
                container.message(*channel, *time_ns, &[*data], &mut out).unwrap();
            }
            container.finish(&[], &mut out).unwrap();
            out.finish().unwrap();
            (name.to_owned(), path)
        };
        let front: [(usize, u64, &[u8]); 3] =
            [(TRANSFORMS, 5, b"ab"), (POINTS, 3, b"early"), (ODOMETRY, 30, b"")];
        let rear: [(usize, u64, &[u8]); 3] = [(POINTS, 4, b"x"), (TRANSFORMS, 30, b"yz"), (POINTS, 40, b"w")];
        let parts = [written("front", &front), written("rear", &rear)];
        let path = folder.path().join("both.mcap");
        let (count, bytes) = merge(&parts, &path, false, false).unwrap();
        let merged = std::fs::read(&path).unwrap();
        assert_eq!((count, bytes), (6, merged.len() as u64));
        let text = String::from_utf8_lossy(&merged).into_owned();
        for topic in ["/tf", "/front/points", "/front/odom", "/rear/points", "/rear/odom"] {
            assert!(text.contains(topic), "{topic}");
        }
        let mut source = merged.as_slice();
        let mut messages = Messages::begin(&mut source, &path).unwrap();
        // Channels from 1: transforms, points and odometry of the front, points and odometry of the rear.
        let expected: [(u16, u64, &[u8]); 6] =
            [(4, 4, b"x"), (1, 5, b"ab"), (2, 3, b"early"), (3, 30, b""), (1, 30, b"yz"), (4, 40, b"w")];
        for (channel, time_ns, data) in expected {
            let found = messages.read_next().unwrap();
            assert_eq!(found, Some(Message { channel, time_ns, data: data.to_vec() }));
        }
        assert_eq!(messages.read_next().unwrap(), None);
    }
}
