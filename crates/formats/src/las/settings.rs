//! Choices for LAS, LAZ and COPC.

use serde::{Deserialize, Serialize};

/// LAS version.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum LasVersion {
    /// 1.4 with point data record format 6.
    #[default]
    V14,
    /// 1.0 with point data record format 1 (`--las10`).
    V10,
}

vlscan_choice::choices! {
    /// Dimensions in the extra bytes.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum ExtraDimensions: default ExtraDimensions::All {
        /// `echo_width`, `fullwaveIndex`, `hitObjectId`, `heliosAmplitude`, and then `device`, `range`,
        /// `incidence_angle`.
        All = "all",
        /// The first four, as HELIOS++.
        Helios = "helios",
        /// No extra bytes, for programs that reject them.
        None = "none",
    }
}

/// Settings of LAS and LAZ (spec outputs §4).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct LasSettings {
    /// LAS version.
    pub version: LasVersion,
    /// Metres per unit of the coordinates; `None`: 0.0001, or the next power of ten at which the scene fits
    /// into 32 bits.
    pub scale: Option<f64>,
    /// Dimensions in the extra bytes.
    pub extra: ExtraDimensions,
    /// Number of points in the header of LAS on a pipe, which is then written without delay, with the scene's
    /// box as bounds: more points are an error, and most readers tolerate fewer. `None`: the points are
    /// spooled, and the header is exact. On a seekable output the header is always patched at the end.
    pub at_most: Option<u64>,
    /// Waveforms as packets that the points refer to (LAS 1.4 with point format 9); `None`: no packets, point
    /// format 6.
    pub packets: Option<PacketPlace>,
    /// If set, COPC has 256 times the colours of the points unless one has more than 8 bits. Formats that
    /// write points as they arrive cannot wait for the last colour.
    #[serde(skip)]
    pub widen_colours: bool,
}

vlscan_choice::choices! {
    /// Location of the waveform packets of LAS.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum PacketPlace {
        /// In the file of the points, as an extended variable length record after them.
        Inside = "inside",
        /// In a file of the same name with the extension .wdp.
        Beside = "beside",
    }
}
