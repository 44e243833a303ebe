//! Point clouds in memory, and waveforms of single pulses, from files of all formats that are read.
//!
//! A point takes at most 46 bytes of memory.
//!
//! | file | what it does |
//! |---|---|
//! | `points` | the points |
//! | `read` | reads files and tables of points |
//! | `wave`, `read_packets` | waveforms from text and from LAS |

mod points;
mod read;
mod read_packets;
#[cfg(test)]
mod table_tests;
mod wave;

pub use points::Points;
pub use read::{points_of_table, read_points};
pub use read_packets::read_packet;
pub use wave::{Wave, read_wave};
