//! What a recorded point cloud says about its flight, its instrument and its scene.

#![deny(unsafe_code)]
