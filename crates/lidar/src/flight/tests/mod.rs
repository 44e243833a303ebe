//! Whole flights.

mod advance;
mod corrected;
mod firing;
mod golden;
mod replay;
mod reported;
