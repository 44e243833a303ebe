//! Record of a complete cell: its line of the manifest.

use super::inputs::Inputs;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use vlscan_base::error::{Error, Result};
use xxhash_rust::xxh3::xxh3_64;

/// The line of a cell in the manifest. Nothing in it depends on where and when the cell was computed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Name of the cell: SCENE-VARIANT-SEED.
    pub cell: String,
    /// Name of the scene, or of the plot.
    pub scene: String,
    /// Name of the variant.
    pub variant: String,
    /// Seed of the run.
    pub seed: u64,
    /// Group of the cell, which a split keeps together.
    pub group: String,
    /// train, validation or test; empty without a split.
    pub split: String,
    /// Version of vlscan.
    pub version: String,
    /// Scene, variant and options as written in the campaign file.
    pub options: serde_json::Value,
    /// The files that were read, with checksums of their contents (XXH3, 64 bits).
    pub inputs: BTreeMap<String, String>,
    /// The files that were searched for and not found.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub absent: BTreeSet<String>,
    /// The folders whose files were listed, with checksums of the names in them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub folders: BTreeMap<String, String>,
    /// Why there is nothing else, if the cell failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Number of pulses that were emitted.
    #[serde(default)]
    pub pulses: u64,
    /// Number of points in the output.
    #[serde(default)]
    pub points: u64,
    /// Area of the polygon, or of the box of the points, m².
    #[serde(default)]
    pub area_m2: f64,
    /// Point density, points per m²: `points / area_m2`.
    #[serde(default)]
    pub points_per_m2: f64,
    /// Corners of the box around the points, m.
    #[serde(default)]
    pub bounds: Option<[[f64; 3]; 2]>,
    /// The files of the cell, with sizes and checksums.
    #[serde(default)]
    pub files: Vec<FileRecord>,
}

/// A file of a cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FileRecord {
    /// Path below the folder of the data set.
    pub path: String,
    /// Points; rows of tables.
    pub records: u64,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Checksum of its contents.
    pub sum: String,
}

/// Text before the checksum at the end of a line, and after it.
const SUM_KEY: &str = ",\"sum\":\"";
const SUM_END: &str = "\"}";

impl Record {
    /// The record as a line of JSON, the last key of which is the checksum of everything before it (XXH3, 64
    /// bits), with the brace that closes it.
    ///
    /// # Errors
    /// [`Error::Internal`] for numbers that JSON has not.
    pub fn line(&self) -> Result<String> {
        let line = serde_json::to_string(self).map_err(|e| Error::Internal(format!("a record: {e}")))?;
        let sum = xxh3_64(line.as_bytes());
        let open = line.strip_suffix('}').unwrap_or(&line);
        Ok(format!("{open}{SUM_KEY}{sum:016x}{SUM_END}\n"))
    }

    /// The record of a line; `None` if any byte of it has changed.
    pub fn parse(line: &[u8]) -> Option<Record> {
        let text = std::str::from_utf8(line).ok()?.strip_suffix('\n')?;
        let (open, sum) = text.strip_suffix(SUM_END)?.rsplit_once(SUM_KEY)?;
        let whole = format!("{open}}}");
        if format!("{:016x}", xxh3_64(whole.as_bytes())) != sum {
            return None;
        }
        serde_json::from_str(&whole).ok()
    }

    /// True if the same cell, described by `wanted`, would have this record again: version, options, group,
    /// the contents of all files that were read, and the absence of those that were searched for and not
    /// found.
    pub fn is_current(&self, wanted: &Record, inputs: &mut Inputs) -> bool {
        let head = |record: &Record| {
            let Record { cell, scene, variant, seed, group, split, version, .. } = record.clone();
            (cell, scene, variant, seed, group, split, version)
        };
        head(self) == head(wanted) && self.options == wanted.options && inputs.are_as_in(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_of_a_line_counts() {
        let record = Record { cell: "a".to_owned(), points: 7, area_m2: 0.1, ..Record::default() };
        let line = record.line().unwrap().into_bytes();
        assert_eq!(Record::parse(&line), Some(record));
        for at in 0..line.len() {
            let mut damaged = line.clone();
            damaged[at] ^= 1;
            assert_eq!(Record::parse(&damaged), None, "{at}");
            assert_eq!(Record::parse(&line[..at]), None, "{at}");
        }
        assert!(serde_json::from_slice::<serde_json::Value>(&line).unwrap()["sum"].is_string());
    }
}
