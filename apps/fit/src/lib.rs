//! Estimates of flight, instrument and scene from a recorded point cloud.
//!
//! | module | what it does |
//! |---|---|
//! | `columns`, `marks`, `rows` | values of very many points in little memory |
//! | `limit` | the number of points that a memory limit allows |
//! | `flight` | a flight and its scanner from GPS times, positions and scan angles |
//! | `scene` | a scene from classified points: terrain, roofs, foliage as voxels |
//! | `spinning` | noise and detection of a spinning sensor from a recorded revolution |
//! | `still` | the scan pattern of a sensor that stood still |

#![deny(unsafe_code)]

mod columns;
pub mod flight;
mod limit;
mod marks;
mod rows;
pub mod scene;
pub mod spinning;
pub mod still;
