//! Whole flights.

mod advance;
mod corrected;
mod golden;
mod replay;
mod reported;
