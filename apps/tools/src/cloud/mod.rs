//! Point clouds, and waveforms of single pulses, from files of all formats that are read.
//!
//! A point takes at most 54 bytes, in memory up to a limit and in temporary files beyond. [`cloud_facts`]
//! describes a cloud without keeping its points.
//!
//! | file | what it does |
//! |---|---|
//! | `points`, `positions` | the points; their positions |
//! | `points_part` | the points of a block |
//! | `column` | a value of each point, in memory and in temporary files |
//! | `source` | where a cloud comes from |
//! | `read` | reads files and tables of points |
//! | `wave`, `read_packets` | waveforms from text and from LAS |
//! | `facts`, `facts_part` | facts about a cloud, in bounded memory; of a block of points |
//! | `facts_text` | facts as text and as JSON |
//! | `occupancy` | the area that points cover |
//! | `classes` | names of point classes |
//! | `extent` | the error about a cloud that has too many cells |

mod classes;
mod column;
mod extent;
mod facts;
mod facts_part;
mod facts_text;
mod occupancy;
mod points;
mod points_part;
mod positions;
mod read;
mod read_packets;
mod source;
#[cfg(test)]
mod table_tests;
mod wave;

pub(crate) use classes::NOISE;
pub use classes::class_name;
pub(crate) use extent::{in_command, too_many_cells};
pub use facts::{CloudSummary, cloud_facts};
pub use facts_part::{LineFacts, Span};
pub use points::Points;
pub(crate) use points_part::is_placed;
pub use read::{points_of_table, read_attributes, read_points, read_within};
pub use read_packets::read_packet;
pub use source::CloudSource;
pub use wave::{Wave, read_wave};
