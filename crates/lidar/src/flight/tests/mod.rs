//! Whole flights.

mod advance;
mod corrected;
mod firing;
mod golden;
mod pattern;
mod replay;
mod reported;
mod scan_angles;
mod times;
mod velocity;
