//! What carries the scanner: position and attitude per step.
