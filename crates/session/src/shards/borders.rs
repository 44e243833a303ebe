//! Borders of shards: the flight, stepped once, with its state at regular numbers of pulses. Any number of
//! shards can use it: the state at a border is a few steps after the nearest one that is stored.

use super::fingerprint::Fingerprint;
use super::private::PrivateFolder;
use super::share::OneOf;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched, reads};
use vlscan_lidar::flight::FlightState;
use xxhash_rust::xxh3::xxh3_64;

/// The first bytes of every file of borders.
pub(super) const MAGIC: &[u8; 8] = b"VLINDEX\n";
/// Maximum number of stored states.
const MAX_STATES: usize = 2048;
/// Maximum size of all stored states together, bytes.
const MAX_BYTES: usize = 32 << 20;
/// Name of the file of the borders.
const FILE_NAME: &str = "flight.vlindex";
/// Pulses between stored states, at first; doubled when there are too many.
const FIRST_INTERVAL: u64 = 1024;

/// The number of pulses of a flight, and states from which shards begin.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Borders {
    fingerprint: Fingerprint,
    /// Pulses of all epochs.
    pub total: u64,
    /// Pulses before each epoch.
    epochs: Vec<u64>,
    /// Encoded states, ascending; none for a flight along a stream of poses.
    states: Vec<StoredState>,
}

/// The borders in a folder of shards.
#[derive(Debug)]
pub enum StoredBorders {
    /// They are complete.
    Found(Borders),
    /// The folder has none.
    Missing,
    /// The file does not match its checksum.
    Damaged,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredState {
    pulses: u64,
    epoch: u32,
    state: Vec<u8>,
}

/// A point of the flight.
#[derive(Clone, Debug)]
pub struct Border {
    /// Pulses before it.
    pub pulses: u64,
    /// Index of the epoch, from 0.
    pub epoch: u32,
    /// The state of the flight from which it continues.
    pub state: FlightState,
}

impl Borders {
    /// The pulses of a shard.
    pub fn range(&self, OneOf { number, of }: OneOf) -> Range<u64> {
        let at = |n: u32| (u128::from(self.total) * u128::from(n) / u128::from(of.max(1))) as u64;
        at(number)..at(number + 1)
    }

    /// The last epoch of a shard that ends before pulse `end`, or with the flight.
    pub fn last_epoch(&self, end: Option<u64>) -> u32 {
        let begun = |end: u64| self.epochs.partition_point(|&before| before < end);
        end.map_or(self.epochs.len(), begun).saturating_sub(1) as u32
    }

    /// Number of epochs.
    pub fn epochs(&self) -> u32 {
        self.epochs.len() as u32
    }

    /// Number of stored states.
    pub fn states(&self) -> usize {
        self.states.len()
    }

    /// The last stored state with less than `pulses` pulses before it; `None`: the flight's start is the
    /// nearest.
    ///
    /// # Errors
    /// [`Error::Input`] for a state that cannot be read.
    pub fn nearest(&self, pulses: u64) -> Result<Option<Border>> {
        let before = self.states.partition_point(|stored| stored.pulses < pulses);
        let read = |stored: &StoredState| {
            let state = postcard::from_bytes(&stored.state);
            let state = state.map_err(|e| {
                let message = format!("a state of the flight in {FILE_NAME} cannot be read: {e}");
                Error::input_with_help(message, "remove that file; it is computed again")
            })?;
            Ok(Border { pulses: stored.pulses, epoch: stored.epoch, state })
        };
        self.states[..before].last().map(read).transpose()
    }

    /// The file of the borders in a folder of shards.
    pub fn path(folder: &Path) -> PathBuf {
        folder.join(FILE_NAME)
    }

    /// Reads the borders of a folder.
    ///
    /// # Errors
    /// [`Error::Input`] for a file of another kind or version, and for a flight of another fingerprint.
    pub fn load(folder: &Path, fingerprint: &Fingerprint) -> Result<StoredBorders> {
        let path = Borders::path(folder);
        let bytes = match reads::read(&path) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(StoredBorders::Missing),
            bytes => bytes.map_err(|e| Error::io("read", &path, e))?,
        };
        let refuse = |reason: &str| {
            let help = "choose another folder for these shards, or remove the file: it will be written again";
            Error::not_divisible(format!("{} {reason}", path.display()), help)
        };
        let (magic, body) =
            bytes.split_at_checked(MAGIC.len()).ok_or_else(|| refuse("has another file format"))?;
        let sound = body.split_at_checked(8).filter(|(sum, body)| *sum == xxh3_64(body).to_le_bytes());
        // A checksum distinguishes a damaged beginning from a file of another kind.
        let body = match (magic == &MAGIC[..], sound) {
            (true, Some((_, body))) => body,
            (false, None) => return Err(refuse("has another file format")),
            _ => return Ok(StoredBorders::Damaged),
        };
        let borders: Result<Borders, _> = postcard::from_bytes(body);
        let borders = borders.map_err(|_| refuse("is of another version"))?;
        match borders.fingerprint.of_flight().difference(&fingerprint.of_flight()) {
            None => Ok(StoredBorders::Found(borders)),
            Some(what) => Err(refuse(&format!("belongs to another flight; they differ in {what}"))),
        }
    }

    /// Writes the borders to a folder, complete or not at all. Other processes may do the same at the same
    /// time.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn save(&self, folder: &Path) -> Result<PathBuf> {
        let path = Borders::path(folder);
        let body = postcard::to_stdvec(self).map_err(|e| Error::Internal(format!("borders: {e}")))?;
        let private = PrivateFolder::new(folder)?;
        let name = path.file_name().unwrap_or_default();
        let mut file = FileWriter::create(&private.path(name), true, Patched::Never)?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend(xxh3_64(&body).to_le_bytes());
        bytes.extend(body);
        file.append(&bytes)?;
        file.finish()?;
        private.publish(name)
    }
}

/// Collects the states of a flight while it is stepped.
#[derive(Debug)]
pub struct BordersBuilder {
    borders: Borders,
    interval: u64,
    bytes: usize,
    keeps_states: bool,
}

impl BordersBuilder {
    /// `keeps_states` is false for flights whose states cannot be stored.
    pub fn new(fingerprint: Fingerprint, keeps_states: bool) -> BordersBuilder {
        let borders = Borders { fingerprint, total: 0, epochs: Vec::new(), states: Vec::new() };
        BordersBuilder { borders, interval: FIRST_INTERVAL, bytes: 0, keeps_states }
    }

    /// Begins the next epoch after `pulses` pulses.
    pub fn begin_epoch(&mut self, pulses: u64) {
        self.borders.epochs.push(pulses);
    }

    /// The number of pulses before the next state to be added.
    pub fn next(&self) -> u64 {
        let last = self.borders.states.last().map_or(0, |stored| stored.pulses);
        if self.keeps_states { (last / self.interval + 1) * self.interval } else { u64::MAX }
    }

    /// Adds a state of the current epoch.
    ///
    /// # Errors
    /// [`Error::Internal`] for a state that cannot be encoded.
    pub fn add(&mut self, pulses: u64, state: &FlightState) -> Result<()> {
        let state =
            postcard::to_stdvec(state).map_err(|e| Error::Internal(format!("a state of the flight: {e}")))?;
        self.bytes += state.len();
        let epoch = self.borders.epochs.len().saturating_sub(1) as u32;
        self.borders.states.push(StoredState { pulses, epoch, state });
        while self.borders.states.len() > MAX_STATES
            || self.bytes > MAX_BYTES && self.borders.states.len() > 1
        {
            self.interval *= 2;
            let mut keep = true;
            self.borders.states.retain(|_| {
                keep = !keep;
                keep
            });
            self.bytes = self.borders.states.iter().map(|stored| stored.state.len()).sum();
        }
        Ok(())
    }

    /// Ends a flight of `pulses` pulses.
    pub fn finish(mut self, pulses: u64) -> Borders {
        self.borders.total = pulses;
        self.borders
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::DVec3;
    use vlscan_lidar::flight::{FlightOptions, FlightPlan};
    use vlscan_survey::{Survey, testkit};

    fn borders(total: u64, epochs: &[u64]) -> Borders {
        Borders { fingerprint: Fingerprint::default(), total, epochs: epochs.to_vec(), states: Vec::new() }
    }

    #[test]
    fn ranges_join_and_are_balanced() {
        for (total, of) in [(0, 3), (1, 7), (1000, 7), (5, 64), (u64::MAX / 2, 1000)] {
            let borders = borders(total, &[0]);
            let ranges: Vec<_> = (0..of).map(|number| borders.range(OneOf { number, of })).collect();
            assert_eq!((ranges[0].start, ranges[of as usize - 1].end), (0, total));
            assert!(ranges.windows(2).all(|pair| pair[0].end == pair[1].start));
            let lengths = ranges.iter().map(|range| range.end - range.start);
            assert!(lengths.clone().max().unwrap() - lengths.min().unwrap() <= 1);
        }
    }

    #[test]
    fn a_part_ends_in_the_epoch_of_its_last_pulse() {
        let borders = borders(300, &[0, 100, 200]);
        let ends = [Some(1), Some(100), Some(101), Some(200), Some(201), None];
        assert_eq!(ends.map(|end| borders.last_epoch(end)), [0, 0, 1, 1, 2, 2]);
    }

    #[test]
    fn few_states_are_kept_and_files_are_checked() {
        let mut leg = testkit::leg(0, testkit::scanner_settings(1000));
        leg.scanner.max_duration = Some(1.0);
        let survey = Survey { legs: vec![leg], ..testkit::survey(vec![testkit::device()]) };
        let flight = FlightPlan::new(&survey, DVec3::ZERO, &|_, _| None, &FlightOptions::default());
        let state = FlightState::start(&flight.unwrap().0);
        let mut fingerprint = Fingerprint::default();
        fingerprint.flight("seed", 1);
        let mut builder = BordersBuilder::new(fingerprint.clone(), true);
        builder.begin_epoch(0);
        let total = 5_000_000;
        while builder.next() < total {
            builder.add(builder.next(), &state).unwrap();
        }
        let made = builder.finish(total);
        assert!((MAX_STATES / 2..=MAX_STATES).contains(&made.states()), "{}", made.states());
        let near = made.nearest(3_000_000).unwrap().unwrap();
        assert!(near.pulses < 3_000_000 && near.pulses > 3_000_000 - total / MAX_STATES as u64 * 3);
        assert_eq!(format!("{:?}", near.state), format!("{state:?}"));
        assert!(made.nearest(0).unwrap().is_none());
        let dir = tempfile::tempdir().unwrap();
        let load = || Borders::load(dir.path(), &fingerprint).unwrap();
        assert!(matches!(load(), StoredBorders::Missing));
        let path = made.save(dir.path()).unwrap();
        let StoredBorders::Found(read) = load() else { panic!("they are there") };
        assert_eq!((read.total, read.states()), (total, made.states()));
        let mut other = Fingerprint::default();
        other.flight("seed", 2);
        assert!(Borders::load(dir.path(), &other).unwrap_err().to_string().contains("seed (1, 2)"));
        let mut bytes = std::fs::read(&path).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        assert!(matches!(load(), StoredBorders::Damaged));
        std::fs::write(&path, &bytes[..12]).unwrap();
        assert!(matches!(load(), StoredBorders::Damaged));
        std::fs::write(&path, "somebody's notes").unwrap();
        assert!(
            Borders::load(dir.path(), &fingerprint).unwrap_err().to_string().contains("another file format")
        );
    }

    #[test]
    fn every_changed_bit_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let path = borders(300, &[0, 100]).save(dir.path()).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        let load = || Borders::load(dir.path(), &Fingerprint::default());
        assert!(matches!(load(), Ok(StoredBorders::Found(_))));
        for bit in 0..8 * bytes.len() {
            bytes[bit / 8] ^= 1 << (bit % 8);
            std::fs::write(&path, &bytes).unwrap();
            assert!(matches!(load(), Ok(StoredBorders::Damaged) | Err(_)), "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }
}
